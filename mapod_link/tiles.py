"""Tiles of the map, asked for and put together from their pieces; what misses is asked for again.

A piece is placed by its cells in the endless grid, so it does not matter which question it answers.
Source: planner link, section 3, ASK and TILE.
"""

import math
import struct
from collections import deque
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from mapod_link.asking import ASK_TILE, IN_WINDOW, ask_body
from mapod_link.frames import int16
from mapod_link.scans import Scans

F32 = npt.NDArray[np.float32]
TILE_HEAD = struct.Struct("<HBBhhHH3sBHH")
LAYERS = (
    *("class", "height", "variance", "slope", "cause", "age", "z", "edge", "foothold"),
    *("filled", "filled_sigma", "foothold_sigma"),
)
CLASS, CAUSE = 0, 4
NUMBERS = {  # of the other layers: type, scale, not known
    1: ("<i2", 1e-3, -32_768),
    2: ("<u2", 1e-6, 65_535),
    3: ("<u2", 1e-4, 65_535),
    5: ("<u2", 1e-1, 65_535),
    6: ("<i2", 1e-3, -32_768),
    7: ("<u2", 1e-3, 65_535),
    8: ("<u2", 1e-4, 65_535),
    9: ("<i2", 1e-3, -32_768),
    10: ("<u2", 1e-4, 65_535),
    11: ("<u2", 1e-4, 65_535),
}
MOST_CELLS, MOST_EDGE = 401 * 401, 32_767  # the grid's places are told modulo 65 536
AT_A_TIME = 4
RETRY_S = 0.5  # no piece of any tile for so long: something got lost
DEAF_S = 1.0  # without an answer: it may not know us
END_RETRY_S = 0.05  # after an answer's last piece: time for those that overtook each other
REFUSALS = {
    1: "the sender has no such layer",
    2: "the sender takes this for no cells, or too many",
    3: "too many tiles at a time",
    4: "no map is announced",
}
TOO_MANY = 3


class TilePiece(NamedTuple):
    """One TILE frame; its length fits what it says."""

    id: int
    layer: int
    status: int
    i: int  # lowest column of the rectangle, modulo 65 536
    j: int
    width: int  # of the rectangle, cells
    height: int
    first: int  # cell of this piece: row * width + column
    geom_id: int
    cell_m: float
    values: F32  # (count,): class, m, m^2, rad, code, s or share; NaN: not known

    @property
    def is_last(self) -> bool:
        return self.first + self.values.size == self.width * self.height


def maybe_tile_piece(body: bytes) -> TilePiece | None:
    """None if length, count and rectangle do not fit each other."""
    if len(body) < TILE_HEAD.size:
        return None
    tile_id, layer, status, i, j, width, height, first3, geom_id, count, cell_mm = (
        TILE_HEAD.unpack_from(body)
    )
    data, first = body[TILE_HEAD.size :], int.from_bytes(first3, "little")
    place = (tile_id, layer, status, i, j, width, height, first, geom_id, cell_mm / 1000)
    if status or layer >= len(LAYERS):  # of a layer of later days: nothing that can be read
        nothing = np.zeros(0, np.float32)
        return TilePiece(*place, nothing) if not status or not (count or data) else None
    size = {CLASS: -(-count // 4), CAUSE: count}.get(layer, 2 * count)
    if len(data) != size or count == 0 or first + count > width * height:
        return None
    return TilePiece(*place, _values(layer, data, count))


def _values(layer: int, data: bytes, count: int) -> F32:
    if layer == CLASS:
        quads = np.frombuffer(data, np.uint8)[:, None] >> np.array([0, 2, 4, 6], np.uint8) & 3
        classes = quads.reshape(-1)[:count].astype(np.float32)
        classes[classes == 3] = 0  # not of this version: unknown
        return classes
    if layer == CAUSE:
        return np.frombuffer(data, np.uint8).astype(np.float32)
    kind, scale, unknown = NUMBERS[layer]
    raw = np.frombuffer(data, kind).astype(np.int32)
    return np.where(raw == unknown, np.nan, raw * scale).astype(np.float32)


class Tile:
    """A rectangle of one layer, growing as its pieces arrive.

    Attributes:
        values: (height, width) float32: class 0 unknown, 1 free, 2 obstacle; height m;
            variance m^2; slope rad; cause a code (section 3), 0: not told, or not here yet;
            age s; z m; edge m; foothold 0 to 1; filled m; both sigmas m; NaN: not
            known, or not here yet.
        here: (height, width): which cells have been told at all.
        place: world cell (column, row) of values[0, 0], modulo 65 536; None until known.
        geom_id, cell_m: of the map that it was cut from, once a piece is here.
        t_ms: sender's clock of the oldest and of the newest piece; (0, 0) before.
        refusal: why there will be no answer; "" while there may be.
        due_s: when to ask for it, while it is under way.
    """

    def __init__(
        self,
        tile_id: int,
        layer: str,
        place: tuple[int, int],
        shape: tuple[int, int],
        in_window: bool,
    ) -> None:
        self.id, self.layer, self.shape = tile_id, layer, shape
        self._asked_place, self._in_window = place, in_window
        self.values: F32 = np.empty(shape, np.float32)
        self.here: npt.NDArray[np.bool_] = np.empty(shape, np.bool_)
        self.place: tuple[int, int] | None = None
        self.refusal = ""
        self.begin_anew()

    @property
    def complete(self) -> bool:
        return bool(self.here.all())

    @property
    def done(self) -> bool:
        """Nothing more will come: complete, or refused."""
        return bool(self.refusal) or self.complete

    def begin_anew(self) -> None:
        """Nothing is here nor asked for, as before the first piece."""
        self.due_s = -math.inf
        self.place = None if self._in_window else self._asked_place
        self.geom_id, self.cell_m, self.t_ms = -1, math.nan, (0, 0)
        self._clear()

    def question(self) -> bytes:
        """Body of an ASK for the first block of rows that are not whole."""
        what, layer = ASK_TILE, LAYERS.index(self.layer)
        if self.place is None:
            return ask_body(self.id, what | IN_WINDOW, layer, self._asked_place, self.shape)
        whole = np.append(self.here.all(axis=1), True)
        first = int(np.argmin(whole))
        rows = int(np.argmax(whole[first:]))
        place = self.place[0], self.place[1] + first
        return ask_body(self.id, what, layer, place, (rows, self.shape[1]))

    def put(self, piece: TilePiece, t_ms: int) -> bool:
        """Take a piece of any question about these cells; False if it is not of this rectangle."""
        place = self.place or (piece.i, piece.j)
        row = int16(piece.j - place[1])
        fits = piece.width == self.shape[1] and 0 <= row <= self.shape[0] - piece.height
        if not fits or int16(piece.i - place[0]):
            return False
        if piece.geom_id != self.geom_id:  # the map was begun anew: what is here is of the old one
            self._clear()
            self.t_ms = t_ms, t_ms
        self.place, self.geom_id, self.cell_m = place, piece.geom_id, piece.cell_m
        self.t_ms = self.t_ms[0], t_ms
        first = row * self.shape[1] + piece.first
        self.values.reshape(-1)[first : first + piece.values.size] = piece.values
        self.here.reshape(-1)[first : first + piece.values.size] = True
        return True

    def _clear(self) -> None:
        self.here[:] = False
        self.values[:] = 0 if self.layer in (LAYERS[CLASS], LAYERS[CAUSE]) else np.nan


class Tiles:
    """One receiver's tiles: at most four under way at a time, the others wait; and its scans."""

    def __init__(self) -> None:
        self.scans = Scans()
        self._waiting: deque[Tile] = deque()
        self._under_way: dict[int, Tile] = {}  # by id
        self._next_id = 1
        self._unanswered = 0  # questions in a row
        self._first_asked_s = math.inf  # of those questions

    def ask(
        self, layer: str, place: tuple[int, int], shape: tuple[int, int], in_window: bool
    ) -> Tile:
        """A tile to be filled; ValueError: no such layer, no cells, or too many."""
        height, width = shape
        if layer not in LAYERS:
            raise ValueError(f"layer must be one of {', '.join(LAYERS)}, is {layer!r}")
        if not (
            0 < width <= MOST_EDGE and 0 < height <= MOST_EDGE and height * width <= MOST_CELLS
        ):
            raise ValueError(
                f"a tile must have 1 to {MOST_CELLS} cells, and up to {MOST_EDGE} along an edge, "
                f"has width {width} and height {height}"
            )
        tile = Tile(self._next_id, layer, place, shape, in_window)
        self._next_id = self._next_id % 0xFFFF + 1
        self._waiting.append(tile)
        return tile

    def drop(self, tile: Tile) -> None:
        tile.refusal = tile.refusal or "it was dropped"

    def questions(self, now_s: float) -> list[bytes]:
        """Bodies of the ASK frames that are due."""
        self._under_way = {i: tile for i, tile in self._under_way.items() if not tile.done}
        if not self._under_way:
            self._answered()
        while self._waiting and len(self._under_way) < AT_A_TIME:
            tile = self._waiting.popleft()
            if not tile.done:
                self._under_way[tile.id] = tile
        due = [tile for tile in self._under_way.values() if tile.due_s <= now_s]
        for tile in due:
            self._unanswered += 1
            self._first_asked_s = min(self._first_asked_s, now_s)
            nobody = self._unanswered > AT_A_TIME  # seems to be there
            tile.due_s = now_s + (2 * RETRY_S if nobody else RETRY_S)
        questions, scan = [tile.question() for tile in due], self.scans.maybe_question(now_s)
        return questions if scan is None else [scan, *questions]

    def take(self, now_s: float, piece: TilePiece, t_ms: int) -> None:
        """One TILE frame; of no tile under way: left alone."""
        tile = self._under_way.get(piece.id)
        if tile is None or LAYERS.index(tile.layer) != piece.layer:
            return
        self._answered()
        for other in self._under_way.values():  # the sender is busy with one after the other
            other.due_s = max(other.due_s, now_s + RETRY_S)
        if piece.status == TOO_MANY:
            return
        if piece.status:
            tile.refusal = REFUSALS.get(piece.status, f"refused with status {piece.status}")
        elif tile.put(piece, t_ms) and piece.is_last:
            tile.due_s = now_s + END_RETRY_S

    def is_unheard(self, now_s: float) -> bool:
        """Questions stay without any answer."""
        return now_s - self._first_asked_s > DEAF_S

    def _answered(self) -> None:
        self._unanswered, self._first_asked_s = 0, math.inf

    def begin_anew(self) -> None:
        """Another run of the sender: nobody knows any more what was asked."""
        self.scans.begin_anew()
        for tile in self._under_way.values():
            tile.begin_anew()
