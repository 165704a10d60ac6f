"""What is true of a simulated drive: the ground, who walked there, and where the robot was.

It stands in a recording as metadata of the name "truth", all of it text: `path` and `people` are
JSON, `ground` is base64 of zlib of heights in millimetres (i16, little-endian; -32768: none), rows
along map y. Firm things that begin below the robot's height count, soft ones do not.
"""

import base64
import binascii
import json
import math
import os
import struct
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from core.records import FREE, OBSTACLE
from recording.mcap_stream import MAGIC, METADATA, MOST_BYTES, RECORD, metadata_of
from tools.floor import BOUND_M, DANGER_M, SAMPLE_M, edges_of, floor_of
from tools.sweep.look import Look

F64 = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
NAME, FORM = "truth", "1"
SQUARED = "place_error_m squared"  # its mean makes the score
NEAR_M = 0.4  # of a true obstacle, or of somebody: an obstacle may be told there
HALF = 0.5  # of a cell, in danger
MOST_SAMPLES = 100_000_000
NOTHING_MM = -32768
MOST_M = 1e6  # seconds, too
SPREAD = np.array([-1.0, 0.0, 1.0]) / 3.0  # of the samples in a cell, along an edge


class TruthError(Exception):
    """The truth in a recording cannot be read; the text says why."""


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """Heights (rows, columns) every SAMPLE_M, NaN: none; x_m, y_m is the lowest corner."""

    heights_m: F64
    x_m: float
    y_m: float


def truth_metadata(
    scene: str, seed: int, ground: Ground, path: F64, people: Sequence[F64]
) -> dict[str, str]:
    """The truth as text.

    Args:
        path: (n, 4) host seconds, x, y, yaw; people: for each row (k, 3) x, y, radius.
    """
    heights = ground.heights_m
    mm = np.where(np.isnan(heights), NOTHING_MM, np.clip(np.round(heights * 1000), -32767, 32767))
    packed = zlib.compress(mm.astype("<i2").tobytes(), 9)
    return {
        "form": FORM,
        "scene": scene,
        "seed": str(seed),
        "sample_m": str(SAMPLE_M),
        "rows": str(heights.shape[0]),
        "columns": str(heights.shape[1]),
        "x_m": repr(ground.x_m),
        "y_m": repr(ground.y_m),
        "ground": base64.b64encode(packed).decode(),
        "path": json.dumps(np.round(path, 4).tolist(), separators=(",", ":")),
        "people": json.dumps([np.round(now, 3).tolist() for now in people], separators=(",", ":")),
    }


def maybe_truth_in(files: Sequence[Path]) -> dict[str, str] | None:
    """The metadata in any of a recording's files; None where nobody wrote it. Raises OSError."""
    for path in files:
        with path.open("rb") as file:
            file.seek(len(MAGIC))
            while len(head := file.read(RECORD.size)) == RECORD.size:
                opcode, length = RECORD.unpack(head)
                if opcode != METADATA or length > MOST_BYTES:
                    file.seek(length, os.SEEK_CUR)
                    continue
                try:
                    name, entries = metadata_of(file.read(length))
                except (struct.error, UnicodeDecodeError):
                    break  # whoever plays it will tell
                if name == NAME:
                    return entries
    return None


class DriveTruth:
    """The truth of one drive, against which maps are held. Raises TruthError."""

    def __init__(self, metadata: Mapping[str, str]) -> None:
        if metadata.get("form") != FORM:
            raise TruthError(f"truth of form {metadata.get('form')}, not {FORM}")
        try:
            ground = _ground_from(metadata)
            path = np.array(json.loads(metadata["path"]), dtype=float).reshape(-1, 4)
            people = json.loads(metadata["people"])
            self._people = [np.array(now, dtype=float).reshape(-1, 3) for now in people]
        except (KeyError, ValueError, TypeError, zlib.error, binascii.Error) as error:
            raise TruthError(f"the truth in it is damaged: {error!r}") from None
        if not len(path) or len(self._people) not in (0, len(path)):
            raise TruthError("the truth in it is damaged: no path, or people of another")
        if not (np.abs(path) < MOST_M).all():
            raise TruthError("the truth in it is damaged: a path that cannot be")
        self._x_m, self._y_m = ground.x_m, ground.y_m
        self._path_s, self._path = path[:, 0], path[:, 1:].copy()
        self._path[:, 2] = np.unwrap(path[:, 3])
        rows, columns = self._samples(path[:, 1], path[:, 2])
        within = (rows >= 0) & (rows < ground.heights_m.shape[0])
        within &= (columns >= 0) & (columns < ground.heights_m.shape[1])
        begins = list(zip(rows[within].tolist(), columns[within].tolist(), strict=True))
        self._danger = ~floor_of(ground.heights_m, begins, DANGER_M)
        floor = floor_of(ground.heights_m, begins, BOUND_M)
        obstacle = ~floor | edges_of(ground.heights_m, BOUND_M)
        self._near = widened(obstacle, math.ceil(NEAR_M / SAMPLE_M))

    def figures(self, look: Look) -> dict[str, float]:
        """What this look is worth; {} where the drive had not begun, or was over."""
        if not self._path_s[0] <= look.t_s <= self._path_s[-1]:
            return {}
        x, y, yaw = (float(np.interp(look.t_s, self._path_s, self._path[:, k])) for k in range(3))
        away_m2 = (x - look.pose[0]) ** 2 + (y - look.pose[1]) ** 2
        cell_m2 = look.cell_m**2
        place = (x, y, yaw - look.pose[2])
        return {
            "free_on_danger_m2": self._free_on_danger(look, place) * cell_m2,
            "false_obstacle_m2": self._false_obstacles(look, place) * cell_m2,
            SQUARED: away_m2,
        }

    def _free_on_danger(self, look: Look, place: tuple[float, float, float]) -> int:
        x, y = _centres(look, look.cells == FREE)
        share = np.zeros(len(x))
        for dy in SPREAD * look.cell_m:
            for dx in SPREAD * look.cell_m:
                share += self._at(self._danger, *_turned(x + dx, y + dy, place))
        return int((share >= HALF * SPREAD.size**2).sum())

    def _false_obstacles(self, look: Look, place: tuple[float, float, float]) -> int:
        x, y = _turned(*_centres(look, look.cells == OBSTACLE), place)
        true = self._at(self._near, x, y, beyond=True)
        if self._people:
            now = int(np.searchsorted(self._path_s, look.t_s, side="right")) - 1
            for person_x, person_y, radius_m in self._people[now].tolist():
                true |= np.hypot(x - person_x, y - person_y) <= radius_m + NEAR_M
        return int((~true).sum())

    def _at(self, layer: Bools, x: F64, y: F64, beyond: bool = False) -> Bools:
        """At places (n,); `beyond` the ground that is known."""
        rows, columns = self._samples(x, y)
        inside = (rows >= 0) & (rows < layer.shape[0])
        inside &= (columns >= 0) & (columns < layer.shape[1])
        found = np.full(x.shape, beyond)
        found[inside] = layer[rows[inside], columns[inside]]
        return found

    def _samples(self, x: F64, y: F64) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        rows = np.floor((y - self._y_m) / SAMPLE_M).astype(np.int64)
        return rows, np.floor((x - self._x_m) / SAMPLE_M).astype(np.int64)


def _ground_from(metadata: Mapping[str, str]) -> Ground:
    rows, columns = int(metadata["rows"]), int(metadata["columns"])
    if float(metadata["sample_m"]) != SAMPLE_M or not 0 < rows * columns <= MOST_SAMPLES:
        raise ValueError("samples that cannot be")
    unpack = zlib.decompressobj()
    packed = base64.b64decode(metadata["ground"], validate=True)
    data = unpack.decompress(packed, 2 * rows * columns)
    mm = np.frombuffer(data, "<i2").reshape(rows, columns)
    heights_m = np.where(mm == NOTHING_MM, np.nan, mm / 1000.0)
    x_m, y_m = float(metadata["x_m"]), float(metadata["y_m"])
    if not math.isfinite(x_m) or not math.isfinite(y_m):
        raise ValueError("a place that cannot be")
    return Ground(heights_m, x_m, y_m)


def _centres(look: Look, which: Bools) -> tuple[F64, F64]:
    """Of these cells, from the robot: x and y (n,), along map x and y."""
    rows, columns = np.nonzero(which)
    x, y = look.offsets_m()
    return x[columns], y[rows]


def _turned(x: F64, y: F64, place: tuple[float, float, float]) -> tuple[F64, F64]:
    """Places (n,) seen from the robot as told, where they truly are: x, y and turn of the robot."""
    c, s = math.cos(place[2]), math.sin(place[2])
    return place[0] + c * x - s * y, place[1] + s * x + c * y


def widened(mask: Bools, samples: int) -> Bools:
    """The mask, and all within so many samples of it along either axis."""
    out = mask
    for axis in (0, 1):
        part = out.copy()
        for k in range(1, samples + 1):
            low, high = [slice(None)] * 2, [slice(None)] * 2
            low[axis], high[axis] = slice(None, -k), slice(k, None)
            part[tuple(low)] |= out[tuple(high)]
            part[tuple(high)] |= out[tuple(low)]
        out = part
    return out
