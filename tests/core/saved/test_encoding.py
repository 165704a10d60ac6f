"""The file of a saved map: the same arrays come back, and every damage is refused with a reason."""

import hashlib
import io
import math
import struct
import zipfile
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from config_file import with_changes
from core.mapping.mapper import Mapper
from core.records import OBSTACLE
from core.saved.check import VERSION, check_state
from core.saved.encoding import (
    COMMENT_BYTES,
    MARK,
    Arrays,
    StateError,
    arrays_from_bytes,
    bytes_from_arrays,
)
from core.saved.state import restore
from core.saved.surface import KEPT
from tests.core.saved.test_state import LATER_S, METHODS, SHIPPED, STATE, config_of, saved, states
from tests.support.cases import examples

DATA = bytes_from_arrays(STATE["surface"])


@pytest.mark.parametrize("method", METHODS)
def test_a_state_survives_its_file_bit_by_bit(method: str) -> None:
    read = arrays_from_bytes(bytes_from_arrays(STATE[method]))
    assert read.keys() == STATE[method].keys()
    for name, array in STATE[method].items():
        assert read[name].dtype == array.dtype
        np.testing.assert_array_equal(read[name], array)
    check_state(read, config_of(method))
    assert method != "surface" or {f"cells.{name}" for name in KEPT} <= read.keys()


def test_the_file_is_an_npz_without_pickles_and_the_same_state_gives_the_same_bytes() -> None:
    with np.load(io.BytesIO(DATA), allow_pickle=False) as archive:
        assert archive["version"] == VERSION
        np.testing.assert_array_equal(archive["pose"], STATE["surface"]["pose"])
    assert bytes_from_arrays(saved()) == DATA


@settings(max_examples=examples(60), deadline=None)
@given(place=st.integers(0, len(DATA) - 1), bit=st.integers(0, 7))
def test_a_flipped_bit_is_refused_wherever_it_is(place: int, bit: int) -> None:
    damaged = bytearray(DATA)
    damaged[place] ^= 1 << bit
    with pytest.raises(StateError):
        arrays_from_bytes(bytes(damaged))


@settings(max_examples=examples(40), deadline=None)
@given(length=st.integers(0, len(DATA) - 1), more=st.binary(max_size=20))
def test_a_cut_or_continued_file_is_refused(length: int, more: bytes) -> None:
    for damaged in (DATA[:length], DATA[len(DATA) - length :], DATA + b"\0" + more):
        with pytest.raises(StateError):
            arrays_from_bytes(damaged)


@settings(max_examples=examples(60), deadline=None)
@given(data=st.binary(max_size=300))
def test_no_bytes_are_taken_for_a_map_and_none_make_it_raise_anything_else(data: bytes) -> None:
    with pytest.raises(StateError):
        arrays_from_bytes(data)


def test_what_is_no_saved_map_is_refused_with_a_reason() -> None:
    other = io.BytesIO()
    np.savez(other, pose=np.zeros(4))
    for data, reason in (
        (b"", "empty"),
        (other.getvalue(), "no saved map"),
        (DATA[:-1], "end is missing"),
        (DATA[:100] + b"x" + DATA[101:], "damaged"),
    ):
        with pytest.raises(StateError, match=reason):
            arrays_from_bytes(data)


def test_a_file_that_names_the_same_bytes_a_thousand_times_is_refused_unread() -> None:
    whole = bytes_from_arrays({"pose": np.zeros(1000)})
    with zipfile.ZipFile(io.BytesIO(whole)) as archive:
        begin = archive.start_dir
    entry = whole[begin : -22 - COMMENT_BYTES]
    end = struct.pack(
        "<4s4H2LH", b"PK\5\6", 0, 0, 1000, 1000, 1000 * len(entry), begin, COMMENT_BYTES
    )
    body = whole[:begin] + 1000 * entry + end
    with pytest.raises(StateError, match="longer than itself"):
        arrays_from_bytes(body + MARK + hashlib.sha256(body).hexdigest().encode())


def changed(method: str, **entries: Any) -> Arrays:
    """A state of which some entries are others; None: they are missing. `__` stands for a dot."""
    arrays = {name: array.copy() for name, array in STATE[method].items()}
    for key, value in entries.items():
        name = key.replace("__", ".")
        old = arrays.pop(name, None)
        if value is not None:
            arrays[name] = value(old) if callable(value) else value
    return arrays


def put(index: Any, value: float) -> Any:

    def change(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
        array[index] = value
        return array

    return change


NEW = np.array(VERSION + 1, dtype=np.int64)
WRONG: list[tuple[str, dict[str, Any], str]] = [
    ("surface", {"format": np.array("something else")}, "no saved map"),
    ("surface", {"format": None}, "no saved map"),
    ("surface", {"version": NEW}, "newer version"),
    ("surface", {"version": np.array(0, dtype=np.int64)}, "another version"),
    ("surface", {"version": np.array(1.0)}, "version"),
    ("surface", {"settings": None}, "settings"),
    ("surface", {"settings": lambda old: old[:-1]}, "settings"),
    ("surface", {"pose": None}, "pose: is missing"),
    ("surface", {"pose": put(0, math.nan)}, "pose"),
    ("surface", {"pose": put(3, math.inf)}, "pose"),
    ("surface", {"pose": np.zeros(3)}, "pose: must have the shape"),
    ("surface", {"pose": np.zeros(4, dtype=np.float32)}, "pose: must be of type"),
    ("surface", {"travel_m": np.array(math.nan)}, "travel_m"),
    ("surface", {"motion": put(0, math.nan)}, "motion"),
    ("surface", {"window__cells": put((3, 3), 2)}, "window.cells"),
    ("surface", {"window__cells": np.zeros((100, 101), np.int8)}, "window.cells: must have"),
    ("surface", {"window__corner": put(0, 2**40)}, "window.corner"),
    ("surface", {"window__epoch": np.array(-1)}, "window.epoch"),
    ("surface", {"extra": np.zeros(1)}, "does not know: extra"),
    ("surface", {"cells__at": put(0, -1)}, "cells.at"),
    ("surface", {"cells__at": put(-1, 101 * 101)}, "cells.at"),
    ("surface", {"cells__at": lambda old: old[::-1].copy()}, "cells.at: holds a cell twice"),
    ("surface", {"error__static": np.array([0.2, 0.0])}, "error.static"),
    ("surface", {"cells__ground_m": None}, "cells.ground_m: is missing"),
    ("surface", {"cells__var_m2": put(0, -1e-3)}, "cells.var_m2"),
    ("surface", {"cells__stands": put(0, 100.0)}, "cells.stands"),
    ("surface", {"cells__top_m": put(0, math.inf)}, "cells.top_m"),  # -inf would be none
    ("reference_plane", {"plane__average_m": put((0, 0), 1.0)}, "nothing was counted"),
    ("reference_plane", {"plane__states": put((0, 0), OBSTACLE)}, "nothing was counted"),
    ("reference_plane", {"plane__count": put((0, 0), 1)}, "plane.average_m"),
    ("reference_plane", {"plane__count": put((0, 0), -1)}, "plane.count"),
    ("reference_plane", {"plane__states": put((0, 0), 5)}, "plane.states"),
    ("reference_plane", {"cells__at": np.zeros(0, np.int32)}, "does not know"),
]


@pytest.mark.parametrize(
    ("method", "entries", "reason"), WRONG, ids=[f"{'+'.join(w[1])}: {w[2]}" for w in WRONG]
)
def test_a_state_that_can_not_be_true_is_refused_with_a_reason_and_changes_nothing(
    method: str, entries: dict[str, Any], reason: str
) -> None:
    mapper = Mapper(config_of(method))
    with pytest.raises(StateError, match=reason):
        restore(mapper, changed(method, **entries), config_of(method), LATER_S)
    assert not states(mapper).any()
    assert not mapper.continued


@pytest.mark.parametrize(
    "entries",
    [
        {"a\x1b[31m": np.zeros(1)},
        {"settings": np.array(["map.method=\x1b[2J"])},
        {4000 * "a": np.zeros(1)},
    ],
)
def test_no_reason_steers_the_terminal_that_shows_it_or_fills_it(entries: Arrays) -> None:
    data = bytes_from_arrays({**STATE["surface"], **entries})
    with pytest.raises(StateError) as refused:
        check_state(arrays_from_bytes(data), SHIPPED)
    assert str(refused.value).isprintable()
    assert len(str(refused.value)) < 600


def test_a_map_made_with_other_settings_is_refused_and_the_key_named() -> None:
    for section, key, value in (
        ("map", "method", "reference_plane"),
        ("map", "cells", 151),
        ("map", "cell_m", 0.1),
        ("obstacle", "window_cells", 51),
        ("obstacle", "h_pos_m", 0.12),
        ("obstacle", "h_neg_m", -0.12),
    ):
        config = with_changes(SHIPPED, **{section: {key: value}})
        with pytest.raises(StateError, match=f"made with {section}.{key}="):
            restore(Mapper(config), STATE["surface"], config, LATER_S)
