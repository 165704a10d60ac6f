"""Layers of the map as pictures that know where they lie: PNG with a world file, and ROS's pgm.

A picture's first row is the map's highest y; x grows to the right. One pixel is one cell.
Sources: W3C, PNG specification; ESRI, world files; wiki.ros.org/map_server, 2. Map format.
"""

import json
import math
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from core.mapping.layers import UNITS, LayerView
from core.records import FREE, OBSTACLE

SIGNATURE = b"\x89PNG\r\n\x1a\n"
GREY, RGBA = 0, 6  # PNG's kinds of colour
LEVELS = 65_534  # of a 16-bit pixel, from 1 on; 0: not known
STATE_RGBA = {FREE: (0, 158, 115, 255), OBSTACLE: (213, 94, 0, 255)}  # all else is transparent
OCCUPIED_PIXEL, FREE_PIXEL, UNKNOWN_PIXEL = 0, 254, 205  # of a pgm
OCCUPIED_FROM, FREE_BELOW = 0.65, 0.1  # share of black; an unknown pixel has 0.196


def png_from(pixels: npt.NDArray[Any]) -> bytes:
    """(rows, columns) of u16 is grey, (rows, columns, 4) of u8 is coloured."""
    is_grey = pixels.ndim == 2
    rows, columns = pixels.shape[:2]
    content = pixels.astype(">u2") if is_grey else pixels
    lines = b"".join(b"\0" + line.tobytes() for line in content)  # no filter
    head = struct.pack(">IIBBBBB", columns, rows, *((16, GREY) if is_grey else (8, RGBA)), 0, 0, 0)
    chunks = [(b"IHDR", head), (b"IDAT", zlib.compress(lines)), (b"IEND", b"")]
    return SIGNATURE + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in chunks
    )


def world_file(view: LayerView) -> str:
    """Size of a pixel, no turn, and the middle of the first pixel, which is the map's top left."""
    cell_m, rows = view.cell_m, view.values.shape[0]
    x_m, y_m = (view.corner_i + 0.5) * cell_m, (view.corner_j + rows - 0.5) * cell_m
    return "".join(f"{number:.9g}\n" for number in (cell_m, 0.0, 0.0, -cell_m, x_m, y_m))


def state_pixels(view: LayerView) -> npt.NDArray[np.uint8]:
    """(rows, columns, 4): what is not known is transparent."""
    pixels = np.zeros((*view.values.shape, 4), np.uint8)
    for state, rgba in STATE_RGBA.items():
        pixels[view.values == state] = rgba
    return pixels[::-1]


def value_pixels(view: LayerView) -> tuple[npt.NDArray[np.uint16], float, float]:
    """(rows, columns), and what they mean: value = offset + scale * pixel; 0 is not known."""
    known = np.isfinite(view.values)
    values = view.values.astype(np.float64)
    low = float(values[known].min(initial=math.inf)) if known.any() else 0.0
    high = float(values[known].max(initial=-math.inf)) if known.any() else 0.0
    scale = (high - low) / (LEVELS - 1) or 1.0
    levels = np.round((np.where(known, values, low) - low) / scale) + 1
    pixels = np.where(known, levels, 0).astype(np.uint16)
    return pixels[::-1], scale, low - scale


def write_png(folder: Path, view: LayerView) -> list[Path]:
    """Picture, world file, and for a layer of values what a pixel means."""
    picture = folder / f"{view.name}.png"
    about: dict[str, object] = {"layer": view.name, "cell_m": view.cell_m, "frame": "map"}
    if view.name == "state":
        picture.write_bytes(png_from(state_pixels(view)))
        about |= {"free": STATE_RGBA[FREE], "obstacle": STATE_RGBA[OBSTACLE]}
        about |= {"unknown": "transparent"}
    else:
        pixels, scale, offset = value_pixels(view)
        picture.write_bytes(png_from(pixels))
        about |= {"unit": UNITS[view.name], "scale": scale, "offset": offset, "unknown": 0}
    world, words = picture.with_suffix(".pgw"), picture.with_suffix(".json")
    world.write_text(world_file(view), encoding="ascii")
    words.write_text(json.dumps(about, indent=1) + "\n", encoding="ascii")
    return [picture, world, words]


def write_ros(folder: Path, view: LayerView) -> list[Path]:
    """map.pgm and map.yaml of the layer "state"; what is not known stays unknown."""
    rows, columns = view.values.shape
    pixels = np.full((rows, columns), UNKNOWN_PIXEL, np.uint8)
    pixels[view.values == OBSTACLE] = OCCUPIED_PIXEL
    pixels[view.values == FREE] = FREE_PIXEL
    picture, words = folder / "map.pgm", folder / "map.yaml"
    picture.write_bytes(f"P5\n{columns} {rows}\n255\n".encode() + pixels[::-1].tobytes())
    x_m, y_m = view.corner_i * view.cell_m, view.corner_j * view.cell_m
    lines = [
        f"image: {picture.name}",
        "mode: trinary",
        f"resolution: {view.cell_m:.9g}",
        f"origin: [{x_m:.9g}, {y_m:.9g}, 0.0]",
        "negate: 0",
        f"occupied_thresh: {OCCUPIED_FROM}",
        f"free_thresh: {FREE_BELOW}",
    ]
    words.write_text("\n".join(lines) + "\n", encoding="ascii")
    return [picture, words]
