"""Other layers of the map, asked for piece by piece at a bounded rate; and single cells.

One block of rows is under way at a time, so that the sender's wire and loop have room for the map
itself. A layer is put together from its blocks, each where it lies in the world.
"""

import math
from collections.abc import Iterable

import numpy as np

from core.mapping.causes import CAUSES
from mapod_link.receiver import Receiver
from mapod_link.tiles import LAYERS, REFUSALS, Tile
from tools.view.window import F32, LAYER, Window, message, moved
from tools.why.words import describe_cell

UNITS = {
    "height": ("m", "height above the ground"),
    "variance": ("m²", "variance of the height"),
    "slope": ("rad", "slope"),
    "cause": ("", "cause"),
    "age": ("s", "age of the newest beam"),
    "z": ("m", "height in the map frame"),
    "edge": ("m", "way to the next edge"),
    "foothold": ("", "foothold: 0 none, 1 good"),
    "filled": ("m", "height in the map frame, filled in"),
    "filled_sigma": ("m", "1 sigma of the height filled in"),
    "foothold_sigma": ("m", "largest 1 sigma under the foot"),
}
RANGES = {"edge": (0.0, 0.5), "foothold": (0.0, 1.0)}  # of those that end somewhere: the whole
OF_A_CELL = ("height", "variance", "slope", "cause", "age", "z")  # asked for of a single one
CAUSE = "cause"
OFFERED = tuple(name for name in LAYERS if name in UNITS)
NOT_HEARD = "the robot is not heard: this is old"
NO_SUCH_LAYER = REFUSALS[1]
BLOCK_CELLS = 4096
BLOCK_S = 0.1  # from one block to the next, at least: 40 000 cells a second
PATIENCE_S = 3.0  # for a block
ANSWER_S = 1.0  # for a cell


class Layer:
    """One layer of the present window, as far as it has arrived."""

    def __init__(self, name: str, window: Window) -> None:
        self.name, self.version, self.row = name, 1, 0
        self._encoded = (0, b"")  # version, message
        self._at, self._values = window, nothing_of(window)

    def follow(self, window: Window) -> None:
        """The window has moved on; of another epoch nothing is left."""
        if (window.epoch, window.size) != (self._at.epoch, self._at.size):
            self._at, self._values = window, nothing_of(window)
            self.row, self.version = 0, self.version + 1
            return
        values = moved(self._values, window.i - self._at.i, window.j - self._at.j, math.nan)
        if values is not self._values:
            self._values, self.version = values, self.version + 1
        self._at = window

    def put(self, tile: Tile) -> None:
        """What has arrived of a block of whole rows, which was asked for in the world's cells."""
        if tile.place is None:
            return
        column, row = tile.place[0] - self._at.i, tile.place[1] - self._at.j
        size, (height, width) = self._at.size, tile.shape
        first, last = max(row, 0), min(row + height, size)
        left, right = max(column, 0), min(column + width, size)
        if first < last and left < right:
            part = np.s_[first - row : last - row, left - column : right - column]
            here = tile.here[part]
            self._values[first:last, left:right][here] = tile.values[part][here]
            self.version += 1

    def encoded(self) -> bytes:
        """The message to pages; the same bytes until something is new."""
        if self._encoded[0] != self.version:
            at = self._at
            header = {"name": self.name, "unit": UNITS[self.name][0], "i": at.i, "j": at.j,
                      "size": at.size, "cell_m": at.cell_m, "t_s": at.t_s}  # fmt: skip
            payload = self._values.astype("<f4", copy=False).tobytes()
            self._encoded = self.version, message(LAYER, header, payload)
        return self._encoded[1]


def nothing_of(window: Window) -> F32:
    return np.full((window.size, window.size), np.nan, np.float32)


class Layers:
    """The layers that some page wants.

    Attributes:
        refused: why this run of the sender gives no such layer, by name.
    """

    def __init__(self, receiver: Receiver, block_cells: int = BLOCK_CELLS) -> None:
        self.refused: dict[str, str] = {}
        self._receiver, self._block_cells = receiver, block_cells
        self._layers: dict[str, Layer] = {}
        self._under_way: tuple[Layer, Tile, int] | None = None  # and the epoch of the question
        self._asked_s, self._epoch = -math.inf, 0

    def maybe_layer(self, name: str) -> Layer | None:
        return self._layers.get(name)

    def poll(self, now_s: float, window: Window | None, wanted: Iterable[str]) -> None:
        """To be called 10 times a second: take what has arrived, ask for the next block."""
        if window is None:
            return
        if window.epoch != self._epoch:
            self._epoch = window.epoch
            self.refused.clear()
        names = [name for name in wanted if name not in self.refused]
        for name in self._layers.keys() - set(names):
            del self._layers[name]
        for name in names:
            self._layers.setdefault(name, Layer(name, window)).follow(window)
        self._take(now_s, window.epoch)
        if self._under_way is None and self._layers and now_s - self._asked_s >= BLOCK_S - 0.01:
            self._ask(now_s, window)

    def _ask(self, now_s: float, window: Window) -> None:
        name, layer = next(iter(self._layers.items()))
        self._layers[name] = self._layers.pop(name)  # the others first, then this one again
        rows = min(max(1, self._block_cells // window.size), window.size - layer.row)
        place = window.i, window.j + layer.row
        tile = self._receiver.ask_tile(name, *place, window.size, rows)
        layer.row = (layer.row + rows) % window.size
        self._under_way, self._asked_s = (layer, tile, window.epoch), now_s

    def _take(self, now_s: float, epoch: int) -> None:
        if self._under_way is None:
            return
        layer, tile, asked_epoch = self._under_way
        late = now_s - self._asked_s > PATIENCE_S or epoch != asked_epoch
        if late:
            self._receiver.tiles.drop(tile)
        if tile.done:
            self._under_way = None
            if tile.refusal == NO_SUCH_LAYER:
                self.refused[layer.name] = tile.refusal
            elif self._layers.get(layer.name) is layer and epoch == asked_epoch:
                layer.put(tile)


def about(name: str) -> dict[str, object]:
    """A layer in the message `hello`; of codes, each one's word; where there is one, its range."""
    unit, label = UNITS[name]
    words = {"words": {code: cause.word for code, cause in CAUSES.items()}} if name == CAUSE else {}
    told = {"range": RANGES[name]} if name in RANGES else {}
    return {"name": name, "unit": unit, "label": label, **words, **told}


def word(code: float | None) -> str | None:
    """The rule that made a cell what it is; None where it is not known."""
    cause = None if code is None or math.isnan(code) else CAUSES.get(int(code))
    return cause.word if cause else None


class CellQuestion:
    """What is known of one cell, asked for in several layers at once."""

    def __init__(self, now_s: float, receiver: Receiver, i: int, j: int) -> None:
        self._receiver, self._i, self._j, self._until_s = receiver, i, j, now_s + ANSWER_S
        geom, (left, low) = receiver.geom, receiver.origin or (0, 0)
        self._cell_m = geom.cell_m if geom else math.nan
        inside = geom is not None and 0 <= i - left < geom.width and 0 <= j - low < geom.height
        self._state = receiver.cell(i - left, j - low) if inside else 0
        heard = not receiver.stale(now_s)
        self._text = "outside of the map" if not inside else "" if heard else NOT_HEARD
        asked = OF_A_CELL if inside and heard else ()
        self._tiles = {name: receiver.ask_tile(name, i, j, 1, 1) for name in asked}

    def maybe_answer(self, now_s: float) -> dict[str, object] | None:
        """The message `cell` once all layers are here, or the time is over; None before."""
        if now_s < self._until_s and not all(tile.done for tile in self._tiles.values()):
            return None
        self.drop()
        values = {name: float(tile.values[0, 0]) for name, tile in self._tiles.items()}
        return {
            "type": "cell", "i": self._i, "j": self._j,
            "x_m": (self._i + 0.5) * self._cell_m, "y_m": (self._j + 0.5) * self._cell_m,
            "state": self._state, "height_m": values.get("height"),
            "variance_m2": values.get("variance"), "slope_rad": values.get("slope"),
            "z_m": values.get("z"), "age_s": values.get("age"), "cause": word(values.get("cause")),
            "text": self._text or self._sentence(values),
        }  # fmt: skip

    def _sentence(self, values: dict[str, float]) -> str:
        """Why it is what it is, in words; "" from a sender that does not tell."""
        if "cause" not in self._tiles or not self._tiles["cause"].complete:
            return ""
        known = values["age"], values["height"], values["variance"]
        return describe_cell(int(values["cause"]), *known)

    def drop(self) -> None:
        """Nobody wants the answer any more."""
        for tile in self._tiles.values():
            self._receiver.tiles.drop(tile)
