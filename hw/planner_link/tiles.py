"""Answers to a planner that asks for a rectangle of the map: tiles, in pieces.

A piece is made when it is sent, from the map as it is then; nothing of a tile is kept but how far
it has been sent.
Source: planner link, section 3 (ASK, TILE; docs/protocols/planner-link.md).
"""

import math
from collections import deque
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from core.records import U8
from hw.planner_link.frames import TILE, TILE_HEAD, int16
from hw.planner_link.messages import IN_WINDOW, Ask
from hw.planner_link.scheduler import FrameScheduler
from jit import kernel

F32 = npt.NDArray[np.float32]
LAYERS = ("state", "height", "variance", "slope")  # by their number in ASK and TILE
STATE, HEIGHT, VARIANCE = 0, 1, 2
NO_LAYER, BAD_SIZE, TOO_MANY, NO_MAP = 1, 2, 3, 4  # why a tile can't be had
MOST_CELLS = 401 * 401
MOST_TILES = 4  # at a time
MOST_REFUSALS = 8  # waiting to be sent
PIECE_BYTES = 120  # of values, for which room is waited


class TileSource(Protocol):
    """Where the values of tiles come from; what is not to be trusted is already left out."""

    def values(self, layer: str, i: int, j: int, width: int, first: int, count: int) -> F32 | None:
        """Cells first..first + count (row-major) of the rectangle whose lowest cell is (i, j).

        Args:
            layer: "state" (1 obstacle, -1 free), "height" (m), "variance" (m2), "slope" (rad).
            i, j: world cell of the lowest column and row; `width` in cells.

        Returns:
            (count,), NaN where it is not known; None: there is no such layer.
        """


class NoTiles:
    """A source without any layer."""

    def values(self, layer: str, i: int, j: int, width: int, first: int, count: int) -> F32 | None:
        """Nothing."""
        return None


@dataclass(slots=True)
class Tile:
    """One rectangle that was asked for, and how far it has been sent."""

    ask: Ask
    status: int = 0
    corner: tuple[int, int] = (0, 0)  # world cell, once the first piece is due
    sent: int = 0  # cells; 0 also before the first piece


@kernel
def _pack_class(values: F32, trusted: bool, packed: U8) -> None:
    """Two bits a cell into ceil(n / 4) zeroed bytes."""
    for k in range(values.size):
        code = 2 if values[k] == 1.0 else (1 if values[k] == -1.0 and trusted else 0)
        packed[k // 4] |= code << 2 * (k % 4)


@kernel
def _pack_numbers(
    values: F32, scale: float, up: bool, least: int, most: int, none: int, packed: U8
) -> None:
    """Little-endian 16-bit numbers into 2 n bytes; `up` rounds up, else to the nearest."""
    for k in range(values.size):
        number = none
        if not math.isnan(values[k]):
            scaled = max(float(least), min(float(most), values[k] * scale))
            number = int(math.ceil(scaled - 1e-4) if up else math.floor(scaled + 0.5))
        packed[2 * k] = number & 0xFF
        packed[2 * k + 1] = number >> 8 & 0xFF


def pack_values(layer: int, values: F32, trusted: bool) -> bytes:
    """The values of a TILE frame: class in 2 bits a cell, all else in 2 bytes.

    Args:
        values: (n,) as a TileSource gives them.
        trusted: False: no free cell may be published.
    """
    count = values.size
    packed = np.zeros((count + 3) // 4 if layer == STATE else 2 * count, dtype=np.uint8)
    if layer == STATE:
        _pack_class(values, trusted, packed)
    elif layer == HEIGHT:
        _pack_numbers(values, 1e3, False, -32_767, 32_767, -32_768, packed)
    elif layer == VARIANCE:
        _pack_numbers(values, 1e6, True, 0, 65_534, 65_535, packed)
    else:
        _pack_numbers(values, 1e4, False, 0, 65_534, 65_535, packed)
    return packed.tobytes()


class Tiles:
    """What one planner has asked for and not got yet."""

    def __init__(self, cell_mm: int) -> None:
        self._cell_mm = cell_mm
        self._tiles: deque[Tile] = deque()
        self._refused: deque[Tile] = deque(maxlen=MOST_REFUSALS)
        self._warm()

    def _warm(self) -> None:
        """No kernel is compiled in the loop."""
        for layer in range(len(LAYERS)):
            pack_values(layer, np.zeros(1, dtype=np.float32), False)

    @property
    def waiting(self) -> bool:
        """Whether something is still to be sent."""
        return bool(self._tiles or self._refused)

    def forget(self) -> None:
        """A planner has started: what its forerunner wanted is nobody's wish."""
        self._tiles.clear()
        self._refused.clear()

    def take(self, ask: Ask) -> None:
        """One more tile; the same id again replaces the one under way."""
        self._tiles = deque(tile for tile in self._tiles if tile.ask.id != ask.id)
        if not 0 < ask.width * ask.height <= MOST_CELLS:
            self._refused.append(Tile(ask, BAD_SIZE))
        elif ask.layer >= len(LAYERS):
            self._refused.append(Tile(ask, NO_LAYER))
        elif len(self._tiles) >= MOST_TILES:
            self._refused.append(Tile(ask, TOO_MANY))
        else:
            self._tiles.append(Tile(ask))

    def publish(
        self,
        scheduler: FrameScheduler,
        budget: float,
        corner: tuple[int, int] | None,
        trusted: bool,
        geom_id: int,
        source: TileSource,
    ) -> None:
        """Pieces into the scheduler, under a budget of wire bytes.

        Args:
            corner: world cell of the window's lowest corner; None: no map is announced.
        """
        floor = scheduler.budget.credit - budget
        while self.waiting:
            room = scheduler.room(scheduler.budget.credit - floor, TILE_HEAD.size)
            if self._refused:
                if room < 0:
                    return
                scheduler.queue(TILE, self._head(self._refused.popleft(), geom_id, 0))
                continue
            tile = self._tiles[0]
            if corner is None:
                self._refuse(tile, NO_MAP)
                continue
            if tile.sent == 0:
                tile.corner = _corner_of(tile.ask, corner)
            if not self._publish_piece(scheduler, room, tile, trusted, geom_id, source):
                return

    def _refuse(self, tile: Tile, status: int) -> None:
        tile.status = status
        self._refused.append(self._tiles.popleft())

    def _publish_piece(
        self,
        scheduler: FrameScheduler,
        room: int,
        tile: Tile,
        trusted: bool,
        geom_id: int,
        source: TileSource,
    ) -> bool:
        """The next piece of a tile; False if there is too little room for it."""
        ask = tile.ask
        left = ask.width * ask.height - tile.sent
        whole = (left + 3) // 4 if ask.layer == STATE else 2 * left
        enough = min(whole, PIECE_BYTES, scheduler.most_room(TILE_HEAD.size))
        if room < max(2, enough):
            return False
        count = min(left, 4 * room if ask.layer == STATE else room // 2)
        layer = LAYERS[ask.layer]
        values = source.values(layer, *tile.corner, ask.width, tile.sent, count)
        if values is None:
            self._refuse(tile, NO_LAYER)
            return True
        head = self._head(tile, geom_id, count)
        scheduler.queue(TILE, head + pack_values(ask.layer, values, trusted))
        tile.sent += count
        if tile.sent == ask.width * ask.height:
            self._tiles.popleft()
        return True

    def _head(self, tile: Tile, geom_id: int, count: int) -> bytes:
        ask = tile.ask
        i, j = (int16(tile.corner[0]), int16(tile.corner[1])) if count else (ask.i, ask.j)
        return TILE_HEAD.pack(
            ask.id,
            ask.layer,
            tile.status,
            i,
            j,
            ask.width,
            ask.height,
            tile.sent.to_bytes(3, "little"),
            geom_id,
            count,
            self._cell_mm,
        )


def _corner_of(ask: Ask, corner: tuple[int, int]) -> tuple[int, int]:
    """World cell of a rectangle's lowest corner: the one nearest to the window that fits."""
    if ask.wants & IN_WINDOW:
        return corner[0] + ask.i, corner[1] + ask.j
    return corner[0] + int16(ask.i - corner[0]), corner[1] + int16(ask.j - corner[1])
