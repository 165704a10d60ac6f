"""States and scans as bytes on the way to the writer: what costs the loop least to write.

A line of JSON, then arrays. The obstacle map goes as the ring that it is; the writer unrolls it.
"""

import json
from typing import Any

import numpy as np
from msgspec.structs import astuple

from core.records import FREE, I8, OBSTACLE, PoseReport, Scan, StopZoneReport, SweepPoints
from recording.states import F32, CellWindow, ScanRecord, StateRecord

FREE_TOLD, OBSTACLE_TOLD = 1, 2


def pack_state(
    pose: PoseReport,
    zone: StopZoneReport | None,
    cells: I8,
    corner: tuple[int, int],
    cell_m: float,
    trusted: bool,
) -> tuple[bytes, bytes]:
    """The app's state at one instant, in two parts.

    Args:
        cells: (size, size), a ring; `corner`: the world cell with the lowest i and j in it.
    """
    head = {
        "pose": astuple(pose),
        "zone": None if zone is None else astuple(zone),
        "size": cells.shape[0],
        "corner": corner,
        "cell_m": cell_m,
        "trusted": trusted,
    }
    return json.dumps(head).encode() + b"\n", cells.tobytes()


def state_from(t_s: float, data: bytes) -> StateRecord:
    line, _, arrays = data.partition(b"\n")
    head: dict[str, Any] = json.loads(line)
    size, (corner_i, corner_j) = head["size"], head["corner"]
    ring = np.frombuffer(arrays, np.int8, size * size).reshape(size, size)
    cells = np.roll(ring, (-(corner_j % size), -(corner_i % size)), axis=(0, 1))
    states = np.zeros(cells.shape, np.uint8)
    states[cells == OBSTACLE] = OBSTACLE_TOLD
    if head["trusted"]:
        states[cells == FREE] = FREE_TOLD
    return StateRecord(
        t_s,
        PoseReport(*head["pose"]),
        None if head["zone"] is None else _zone(head["zone"]),
        CellWindow(states, corner_i, corner_j, head["cell_m"]),
    )


def _zone(values: list[Any]) -> StopZoneReport:
    given = dict(zip(StopZoneReport.__struct_fields__, values, strict=True))
    return StopZoneReport(**{**given, "sectors_m": tuple(given["sectors_m"])})


def pack_heights(
    size: int, corner: tuple[int, int], cell_m: float, row: int, heights: list[bytes]
) -> bytes:
    """Some rows of heights about the robot.

    Args:
        corner: the world cell with the lowest i and j of all rows, of `size` cells each.
        row: the first of these, from there on.
        heights: f32 heights of the rows, then their variances.
    """
    head = {"size": size, "corner": corner, "cell_m": cell_m, "row": row}
    return json.dumps(head).encode() + b"\n" + b"".join(heights)


class Heights:
    """Puts rows of heights together."""

    def __init__(self) -> None:
        self._layers = np.zeros((2, 0, 0), np.float32)
        self._next = -1  # row; -1: the first ones did not come

    def take(self, data: bytes) -> tuple[CellWindow, F32, F32] | None:
        """With the last rows: where all lie, as a window without states; heights, variances."""
        line, _, arrays = data.partition(b"\n")
        head: dict[str, Any] = json.loads(line)
        size, row, (corner_i, corner_j) = head["size"], head["row"], head["corner"]
        rows = np.frombuffer(arrays, "<f4").reshape(2, -1, size)
        if row == 0:
            self._layers, self._next = np.zeros((2, size, size), np.float32), 0
        if row != self._next:
            self._next = -1
            return None
        self._next = row + rows.shape[1]
        self._layers[:, row : self._next] = rows
        if self._next < size:
            return None
        unseen = np.zeros((size, size), np.uint8)
        window = CellWindow(unseen, corner_i, corner_j, head["cell_m"])
        return window, self._layers[0], self._layers[1]


def pack_scan(scan: Scan, points: SweepPoints | None) -> bytes:
    """A sweep, and where its returns are."""
    head: dict[str, Any] = {"t_s": scan.t_s, "beams": scan.ranges_m.shape[1]}
    head |= {
        "first_rad": scan.first_rad,
        "step_rad": scan.step_rad,
        "has_points": points is not None,
    }
    arrays: bytes = scan.ranges_m[0].astype("<f4").tobytes()
    if points is not None:
        arrays += points.points_m.astype("<f4").tobytes()
    return json.dumps(head).encode() + b"\n" + arrays


def scan_from(data: bytes) -> ScanRecord:
    line, _, arrays = data.partition(b"\n")
    head: dict[str, Any] = json.loads(line)
    ranges_m, points = np.split(np.frombuffer(arrays, "<f4"), [head["beams"]])
    points_map = points.reshape(-1, 3) if head["has_points"] else None
    return ScanRecord(head["t_s"], head["first_rad"], head["step_rad"], ranges_m, points_map)
