"""Saved maps as a target: what is no whole and possible map is refused with a reason.

The first byte says how the rest is taken: as a file; as a file whose digest is made right; or as
changes of a right map's arrays, which is then packed anew. A map that is let pass is gone on from.
"""

import hashlib
from functools import cache
from pathlib import Path

import numpy as np

from config_file import load_config, with_changes
from core.config import Config
from core.mapping.mapper import Mapper
from core.records import FREE
from core.saved.check import FORMAT, VERSION, check_state, settings_of, shapes_of
from core.saved.encoding import MARK, Arrays, StateError, arrays_from_bytes, bytes_from_arrays
from core.saved.state import restore
from tools.fuzz.program import instruction, instructions_of, refused

ROOT = Path(__file__).resolve().parents[2]
AS_IT_IS, DIGESTED, CHANGED, DROPPED, RETYPED = range(5)
METHODS = ("reference_plane", "certainty", "surface")
CELLS, MOST_STEPS = 25, 50
TYPES = ("i8", "i4", "i1", "f8", "f4", "U9", "?", "c16")


@cache
def config_of(method: str) -> Config:
    shipped = load_config((ROOT / "mapod.toml").read_text(encoding="utf-8"))
    sizes = {"cells": CELLS, "method": method}
    return with_changes(shipped, map=sizes, obstacle={"window_cells": CELLS})


@cache
def state_of(method: str) -> Arrays:
    """A right state of an empty map."""
    arrays: Arrays = {
        "format": np.array(FORMAT),
        "version": np.array(VERSION, dtype=np.int64),
        "settings": np.array(settings_of(config_of(method))),
    }
    for name, (dtype, shape) in shapes_of(config_of(method)).items():
        arrays[name] = np.zeros([1 if size is None else size for size in shape], dtype)
    if method == "reference_plane":
        arrays["plane.average_m"][...] = np.nan
    return arrays


def run(data: bytes) -> int:
    """1 where it is a map. Raises AssertionError."""
    way, method = data[0] % 5 if data else AS_IT_IS, METHODS[(data[0] if data else 0) // 5 % 3]
    content = data[1:]
    if way == DIGESTED:
        content += MARK + hashlib.sha256(content).hexdigest().encode("ascii")
    elif way != AS_IT_IS:
        content = bytes_from_arrays(changed(way, method, content))
    try:
        arrays = arrays_from_bytes(content)
        check_state(arrays, config_of(method))
        mapper = Mapper(config_of(method))
        restore(mapper, arrays, config_of(method), 100.0)
    except StateError as error:
        return refused(error)
    assert not (mapper.scanned.window.cells == FREE).any(), "free that nobody has seen"
    return 1


def changed(way: int, method: str, program: bytes) -> Arrays:
    """Arrays of a right state with bytes over them; or without some; or with others' types."""
    arrays = {name: array.copy() for name, array in state_of(method).items()}
    names = sorted(arrays)
    for kind, data in instructions_of(program, MOST_STEPS):
        name = names[kind % len(names)]
        if way == DROPPED:
            arrays.pop(name, None)
            if data:
                arrays[data[:40].decode("utf-8", "replace").replace("\0", "")] = np.zeros(2)
        elif name in arrays and way == RETYPED and data:
            shape = tuple(size % 30 for size in data[1:4])
            arrays[name] = np.zeros(shape, TYPES[data[0] % len(TYPES)])
        elif name in arrays and arrays[name].dtype.kind != "U" and len(data) > 2:
            raw = bytearray(arrays[name].tobytes())
            at = int.from_bytes(data[:2], "big") % max(1, len(raw))
            raw[at : at + len(data) - 2] = data[2:]
            whole = bytes(raw[: arrays[name].nbytes])
            arrays[name] = np.frombuffer(whole, arrays[name].dtype).reshape(arrays[name].shape)
    return arrays


def write_seeds(folder: Path) -> None:
    """A right map of each method with numbers changed, a small file, and one without its digest."""
    for number, method in enumerate(METHODS):
        names, state = sorted(state_of(method)), state_of(method)
        for k, name in enumerate(names):
            one = instruction(0, bytes(2) + b"\0\0\0\0\0\0\xf0\x3f")
            for way in (CHANGED, DROPPED, RETYPED):
                content = bytes([5 * number + way, k]) + one[1:]
                (folder / f"{method}-{name}-{way}").write_bytes(content)
        small = {name: state[name] for name in names if state[name].nbytes < 400}
        content = bytes_from_arrays(small)
        (folder / f"{method}-file").write_bytes(bytes([5 * number + AS_IT_IS]) + content)
        body = content[: -len(MARK) - 64]
        (folder / f"{method}-body").write_bytes(bytes([5 * number + DIGESTED]) + body)
