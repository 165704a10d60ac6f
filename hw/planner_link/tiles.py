"""Answers to a planner that asks for a rectangle of the map: tiles, in pieces.

A piece is made when it is sent, from the map as it is then; nothing of a tile is kept but how far
it has been sent.
Source: planner link, section 3 (ASK, TILE; docs/protocols/planner-link.md).
"""

from collections import deque
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from core.records import ObstacleMap
from hw.planner_link.frames import TILE, TILE_HEAD, int16
from hw.planner_link.messages import IN_WINDOW, Ask
from hw.planner_link.scheduler import FrameScheduler

F32 = npt.NDArray[np.float32]
LAYERS = (  # by number in ASK and TILE
    *("state", "height", "variance", "slope", "cause", "age", "z", "edge", "foothold"),
    *("filled", "filled_sigma", "foothold_sigma"),
)
STATE, CAUSE = 0, 4
NUMBERS = {  # of the other layers: scale, whether rounded up, least, most, not known
    1: (1e3, False, -32_767, 32_767, -32_768),
    2: (1e6, True, 0, 65_534, 65_535),
    3: (1e4, False, 0, 65_534, 65_535),
    5: (1e1, True, 0, 65_534, 65_535),
    6: (1e3, False, -32_767, 32_767, -32_768),
    7: (1e3, False, 0, 65_534, 65_535),
    8: (1e4, False, 0, 10_000, 65_535),
    9: (1e3, False, -32_767, 32_767, -32_768),
    10: (1e4, True, 0, 65_534, 65_535),
    11: (1e4, True, 0, 65_534, 65_535),
}
QUAD_SHIFTS = np.array([0, 2, 4, 6], np.uint8)  # four states a byte, the first lowest
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
            layer: "state" (1 obstacle, -1 free), "height" (m), "variance" (m2), "slope" (rad),
                "cause" (0 to 255; 0: not told), "age" (s), "z" (m), "edge" (m),
                "foothold" (0 to 1), "filled" (m), "filled_sigma" (m), "foothold_sigma" (m).
            i, j: world cell of the lowest column and row; `width` in cells.

        Returns:
            (count,), NaN where it is not known; None: there is no such layer.
        """


@dataclass(slots=True)
class Tile:
    """One rectangle that was asked for, and how far it has been sent."""

    ask: Ask
    status: int = 0  # why it can't be had
    corner: tuple[int, int] = (0, 0)  # world cell, once the first piece is due
    sent: int = 0  # cells; 0 also before the first piece

    @property
    def left(self) -> int:
        return self.ask.width * self.ask.height - self.sent

    def begin(self, window: ObstacleMap) -> None:
        """Its lowest corner is the one nearest to the window that fits."""
        i, j = self.ask.i, self.ask.j
        if not self.ask.wants & IN_WINDOW:
            i, j = int16(i - window.corner_i), int16(j - window.corner_j)
        self.corner = window.corner_i + i, window.corner_j + j


def pack_values(layer: int, values: F32, trusted: bool) -> bytes:
    """The values of a TILE frame: class in 2 bits a cell, cause in a byte, all else in 2.

    Args:
        values: (n,) as a TileSource gives them.
        trusted: False: no free cell may be published.
    """
    if layer == STATE:
        quads = np.zeros((-(-values.size // 4), 4), dtype=np.uint8)
        free = (values == -1) & trusted
        quads.reshape(-1)[: values.size] = np.where(values == 1, 2, free)
        return bytes(np.bitwise_or.reduce(quads << QUAD_SHIFTS, axis=1))
    if layer == CAUSE:
        return values.astype(np.uint8).tobytes()
    scale, up, least, most, unknown = NUMBERS[layer]
    scaled = np.clip(values.astype(np.float64) * scale, least, most)
    rounded = np.ceil(scaled - 1e-4) if up else np.floor(scaled + 0.5)
    return np.where(np.isnan(values), unknown, rounded).astype(np.int64).astype("<u2").tobytes()


def bytes_of(layer: int, cells: int) -> int:
    """How many bytes the values of so many cells take."""
    if layer == STATE:
        return (cells + 3) // 4
    return cells if layer == CAUSE else 2 * cells


def cells_in(layer: int, room: int) -> int:
    """How many cells' values so many bytes hold."""
    if layer == STATE:
        return 4 * room
    return room if layer == CAUSE else room // 2


class Tiles:
    """What one planner has asked for and not got yet."""

    def __init__(self, scheduler: FrameScheduler, cell_mm: int) -> None:
        self._scheduler, self._cell_mm = scheduler, cell_mm
        self._tiles: deque[Tile] = deque()
        self._refused: deque[Tile] = deque(maxlen=MOST_REFUSALS)

    @property
    def waiting(self) -> bool:
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
        self, budget: float, window: ObstacleMap | None, geom_id: int, source: TileSource | None
    ) -> None:
        """Pieces into the scheduler, under a budget of wire bytes; no window: none is announced."""
        scheduler = self._scheduler
        floor = scheduler.budget.credit - budget
        while self.waiting:
            room = scheduler.room(scheduler.budget.credit - floor, TILE_HEAD.size)
            if self._refused:
                if room < 0:
                    return
                scheduler.queue(TILE, self._head(self._refused.popleft(), geom_id, 0))
            elif window is None or source is None:
                self._refuse(NO_MAP if window is None else NO_LAYER)
            elif not self._publish_piece(room, window, geom_id, source):
                return

    def _refuse(self, status: int) -> None:
        self._tiles[0].status = status
        self._refused.append(self._tiles.popleft())

    def _publish_piece(
        self, room: int, window: ObstacleMap, geom_id: int, source: TileSource
    ) -> bool:
        """The next piece of the first tile; False if there is too little room for it."""
        tile = self._tiles[0]
        ask = tile.ask
        if tile.sent == 0:
            tile.begin(window)
        whole = bytes_of(ask.layer, tile.left)
        enough = min(whole, PIECE_BYTES, self._scheduler.most_body - TILE_HEAD.size)
        if room < max(2, enough):
            return False
        count = min(tile.left, cells_in(ask.layer, room))
        values = source.values(LAYERS[ask.layer], *tile.corner, ask.width, tile.sent, count)
        if values is None:
            self._refuse(NO_LAYER)
            return True
        packed = pack_values(ask.layer, values, window.trusted)
        self._scheduler.queue(TILE, self._head(tile, geom_id, count) + packed)
        tile.sent += count
        if not tile.left:
            self._tiles.popleft()
        return True

    def _head(self, tile: Tile, geom_id: int, count: int) -> bytes:
        ask = tile.ask
        i, j = (int16(tile.corner[0]), int16(tile.corner[1])) if count else (ask.i, ask.j)
        return TILE_HEAD.pack(
            *(ask.id, ask.layer, tile.status, i, j, ask.width, ask.height),
            tile.sent.to_bytes(3, "little"),
            *(geom_id, count, self._cell_mm),
        )
