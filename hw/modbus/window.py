"""The obstacle window as registers: packed into one of a few buffers, which views may keep.

Two bits a cell with the planner link's codes, lowest column in the lowest bits, row 0 at the
smallest y. A coarse cell is the worst of its cells: obstacle, then unknown, then free; what lies
outside the window is unknown. In steady state nothing of window size is allocated.
"""

import numpy as np

from core.records import I8, U8, ObstacleMap, PoseReport
from hw.modbus.layout import (
    COARSE_BLOCK,
    COARSE_CELLS,
    WINDOW_CELLS,
    Block,
    heading_cdeg,
    mm_signed,
    stride_of,
    window_block,
)
from jit import kernel

UNKNOWN, FREE, OBSTACLE = 0, 1, 2
HEAD_BYTES = 2 * (WINDOW_CELLS - 1000)


@kernel
def _pack(cells: I8, corner_i: int, corner_j: int, trusted: bool, out: U8, coarse: U8) -> None:
    """Write the ring `cells` (n, n) as n rows of whole big-endian registers.

    Into `coarse` (edge, edge) goes which codes each block of cells holds, as bits; the window lies
    in the middle of these blocks, and what is outside counts as unknown.
    """
    n, edge = cells.shape[0], coarse.shape[0]
    stride = (n + 7) // 8
    block = (n + edge - 1) // edge
    off = (edge * block - n) // 2
    for k in range(edge):
        outside = k * block < off or (k + 1) * block > off + n
        for m in range(edge):
            beside = m * block < off or (m + 1) * block > off + n
            coarse[k, m] = 1 if outside or beside else 0
    free = 1 if trusted else 0
    start = corner_i % n
    for row in range(n):
        line = cells[(corner_j + row) % n]
        blocks = coarse[(row + off) // block]
        at_block, left = off // block, block - off % block
        i = start
        for register in range(stride):
            word = 0
            for k in range(min(8, n - 8 * register)):
                cell = line[i]
                code = (cell == 1) * 2 + (cell == -1) * free
                word |= code << 2 * k
                blocks[at_block] |= 1 << code
                left -= 1
                if left == 0:
                    at_block, left = at_block + 1, block
                i += 1
                if i == n:
                    i = 0
            at = 2 * (row * stride + register)
            out[at] = word >> 8
            out[at + 1] = word & 0xFF


@kernel
def _pack_coarse(coarse: U8, out: U8) -> None:
    """Write the worst code of each block: obstacle, then unknown, then free."""
    edge = coarse.shape[0]
    stride = (edge + 7) // 8
    out[:] = 0
    for row in range(edge):
        for column in range(edge):
            held = coarse[row, column]
            code = 2 if held & 4 else (0 if held & 1 else 1)
            at = 2 * (row * stride + column // 8) + (1 if column % 8 < 4 else 0)
            out[at] |= code << 2 * (column % 4)


class Snapshot:
    """One map, whole: window block and coarse block as they go over the wire, but for their age."""

    def __init__(self, block: Block) -> None:
        self.window: U8 = np.zeros(2 * block.size, dtype=np.uint8)
        self.coarse: U8 = np.zeros(2 * COARSE_BLOCK.size, dtype=np.uint8)
        self.generation = 0  # 0: no map in it
        self.taken_s = float("-inf")  # when it was packed
        self.scan_s = float("-inf")  # of the newest scan in it
        self.x_mm = self.y_mm = 0  # middle of cell (0, 0)


class Packer:
    """Makes snapshots of one window size; their buffers are used again once nobody keeps them."""

    def __init__(self, size: int, cell_mm: int) -> None:
        self.size, self.cell_mm, self.stride = size, cell_mm, stride_of(size)
        self.block = window_block(size)
        self._held: U8 = np.zeros((COARSE_CELLS, COARSE_CELLS), dtype=np.uint8)
        self.coarse_block_cells = -(-size // COARSE_CELLS)  # cells along a coarse cell's edge
        self.coarse_cell_mm = min(65535, self.coarse_block_cells * cell_mm)
        self._pool = [Snapshot(self.block), Snapshot(self.block)]
        self.blank = Snapshot(self.block)  # no map: told while there is none, or none to be told
        unknown: I8 = np.zeros((size, size), dtype=np.int8)
        nowhere = ObstacleMap(unknown, 0, 0, np.zeros(0, dtype=np.int32), 0, False)
        self._put_cells(self.blank, nowhere)  # runs the kernels: none is compiled in the loop
        self._put_head(self.blank, nowhere)

    def pack(
        self,
        now_s: float,
        window: ObstacleMap,
        pose: PoseReport,
        generation: int,
        in_use: list[Snapshot],
    ) -> Snapshot:
        """The window as it is now, in a buffer that is not in use; ValueError: of another size."""
        if window.cells.shape != (self.size, self.size):
            raise ValueError(f"a window of {self.size} cells is due, not {window.cells.shape}")
        free = self._unused(in_use)
        free.generation, free.taken_s = generation, now_s
        free.scan_s = now_s - pose.age_scan_s
        self._put_cells(free, window)
        self._put_head(free, window)
        tail = {
            "generation_again": generation,
            "pose_x": mm_signed(pose.x_m),
            "pose_y": mm_signed(pose.y_m),
            "pose_heading": heading_cdeg(pose.yaw_rad),
        }
        _put(self.block, free.window, tail)
        return free

    def _unused(self, in_use: list[Snapshot]) -> Snapshot:
        """A buffer that nobody keeps; a new one only when more are kept than ever before."""
        for spare in self._pool:
            if all(spare is not used for used in in_use):
                return spare
        self._pool.append(Snapshot(self.block))
        return self._pool[-1]

    def _put_cells(self, into: Snapshot, window: ObstacleMap) -> None:
        out = into.window[HEAD_BYTES : HEAD_BYTES + 2 * self.size * self.stride]
        corner_i, corner_j = window.corner_i, window.corner_j
        _pack(window.cells, corner_i, corner_j, window.trusted, out, self._held)
        _pack_coarse(self._held, into.coarse[14:-2])

    def _put_head(self, into: Snapshot, window: ObstacleMap) -> None:
        """Where the cells of both maps lie; their ages are those of the instant of reading."""
        half_mm = self.cell_mm / 2
        into.x_mm = mm_signed((window.corner_i * self.cell_mm + half_mm) / 1000.0)
        into.y_mm = mm_signed((window.corner_j * self.cell_mm + half_mm) / 1000.0)
        head = {
            "generation": into.generation,
            "x": into.x_mm,
            "y": into.y_mm,
            "cell": self.cell_mm,
            "cells_edge": self.size,
            "stride": self.stride,
            "flags": int(window.trusted),
        }
        _put(self.block, into.window, head)
        off = (COARSE_CELLS * self.coarse_block_cells - self.size) // 2
        from_corner_mm = self.coarse_block_cells * half_mm - off * self.cell_mm
        coarse = {
            "coarse_generation": into.generation,
            "coarse_x": mm_signed((window.corner_i * self.cell_mm + from_corner_mm) / 1000.0),
            "coarse_y": mm_signed((window.corner_j * self.cell_mm + from_corner_mm) / 1000.0),
            "coarse_cell": self.coarse_cell_mm,
            "coarse_generation_again": into.generation,
        }
        _put(COARSE_BLOCK, into.coarse, coarse)


def _put(block: Block, into: U8, values: dict[str, int]) -> None:
    for name, value in values.items():
        block.put(into.data, name, value)
