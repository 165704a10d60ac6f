"""The obstacle map as pages get it: whole, or what has changed since they got it last."""

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeVar

import msgspec
import numpy as np
import numpy.typing as npt

from mapod_link.receiver import Receiver

U8 = npt.NDArray[np.uint8]
F32 = npt.NDArray[np.float32]
A = TypeVar("A", U8, F32)
WHOLE, CHANGED, LAYER, SCAN = 1, 2, 3, 4  # kinds of binary messages
HEAD = struct.Struct("<BBH")  # kind, 0, bytes of JSON that follow
CHANGE = np.dtype([("index", "<u4"), ("state", "u1")])  # packed: 5 bytes


def message(kind: int, header: Mapping[str, object], payload: bytes) -> bytes:
    """One binary message of the socket."""
    told = msgspec.json.encode(header)
    return HEAD.pack(kind, 0, len(told)) + told + payload


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """The map at one moment; nothing changes it any more."""

    t_s: float
    epoch: int  # of another one nothing may be kept
    i: int  # world cell (column, row) of cells[0, 0]
    j: int
    cell_m: float
    cells: U8  # (size, size), rows along map y: 0 unknown, 1 free, 2 obstacle

    @property
    def size(self) -> int:
        return len(self.cells)

    def whole(self, **more: object) -> bytes:
        header = {"i": self.i, "j": self.j, "size": self.size, "cell_m": self.cell_m,
                  "epoch": self.epoch, "t_s": self.t_s, **more}  # fmt: skip
        return message(WHOLE, header, self.cells.tobytes())

    def since(self, held: "Window | None", **more: object) -> bytes:
        """What a page needs that holds another one: nothing (b""), changes, or all of it."""
        if held is None or (held.epoch, held.size) != (self.epoch, self.size):
            return self.whole(**more)
        if held.cells is self.cells and (held.i, held.j) == (self.i, self.j):
            return b""
        kept = moved(held.cells, self.i - held.i, self.j - held.j, 0)
        index = np.flatnonzero(kept != self.cells)
        if index.size * CHANGE.itemsize > self.cells.size:
            return self.whole(**more)
        if not index.size and (held.i, held.j) == (self.i, self.j):
            return b""
        changes = np.empty(index.size, CHANGE)
        changes["index"], changes["state"] = index, self.cells.reshape(-1)[index]
        header = {"i": self.i, "j": self.j, "size": self.size, "t_s": self.t_s, **more}
        return message(CHANGED, header, changes.tobytes())


@dataclass(frozen=True, slots=True, eq=False)
class ScanLine:
    """The newest sweep's returns."""

    t_s: float
    points_m: F32  # (n, 3), map frame

    def message(self, **more: object) -> bytes:
        header = {"t_s": self.t_s, "n": len(self.points_m), **more}
        return message(SCAN, header, self.points_m.astype("<f4", copy=False).tobytes())


def scan_of(receiver: Receiver, now_s: float, before: ScanLine | None) -> ScanLine | None:
    """The newest; no points where none may be told any more; None before the first one of all."""
    scan = receiver.scan
    if scan is None:
        nothing = np.zeros((0, 3), np.float32)
        return ScanLine(now_s, nothing) if before and len(before.points_m) else before
    if before is not None and before.t_s == scan.arrived_s:
        return before
    return ScanLine(scan.arrived_s, scan.points_m.astype(np.float32))


def moved(cells: A, columns: int, rows: int, empty: float) -> A:
    """The same part of the world where the window has moved on; what has entered is `empty`."""
    if columns == rows == 0:
        return cells
    kept = np.full_like(cells, empty)
    height, width = cells.shape
    if abs(rows) < height and abs(columns) < width:
        to = _span(-rows, height), _span(-columns, width)
        kept[to] = cells[_span(rows, height), _span(columns, width)]
    return kept


def _span(step: int, length: int) -> slice:
    return slice(max(step, 0), length + min(step, 0))


def window_of(receiver: Receiver, t_s: float, epoch: int, before: Window | None) -> Window | None:
    """The map as it is now; unknown where it has gone; None before the first one of all."""
    if receiver.geom is None or receiver.origin is None:
        if before is None:
            return None
        nothing = np.zeros_like(before.cells)
        return Window(t_s, epoch, before.i, before.j, before.cell_m, nothing)
    cells = receiver.window()
    height, width = cells.shape
    if height != width:
        square = np.zeros((max(height, width),) * 2, np.uint8)
        square[:height, :width] = cells
        cells = square
    return Window(t_s, epoch, *receiver.origin, receiver.geom.cell_m, cells)
