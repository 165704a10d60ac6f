"""The kept ratios as a picture: a row each, a mark for each time kept, the newest one dark."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from PIL import Image, ImageDraw

from tools.cli.options import ROOT

PICTURE = ROOT / "docs" / "pictures" / "bench-ratios.png"
NAME_PX, WIDE_PX, ROW_PX, TOP_PX, EDGE_PX = 380, 460, 22, 24, 60
MARK_PX = 4
DECADES = (0.01, 100.0)
KEPT = 12  # the newest entries that are drawn
BLACK, GREY, ONE = (0, 0, 0), (215, 215, 215), (120, 120, 120)
OLDEST, NEWEST = (190, 205, 235), (20, 60, 150)


def place_px(ratio: float) -> float:
    """Where a ratio lies, from the left."""
    low, high = map(math.log10, DECADES)
    share = (math.log10(min(max(ratio, DECADES[0]), DECADES[1])) - low) / (high - low)
    return NAME_PX + share * WIDE_PX


def draw(entries: Sequence[dict[str, Any]], path: Path = PICTURE) -> None:
    """Of the newest entries, oldest first."""
    shown = list(entries[-KEPT:])
    names = list(shown[-1]["ratios"])
    size = NAME_PX + WIDE_PX + EDGE_PX, TOP_PX + ROW_PX * len(names)
    sheet = Image.new("RGB", size, (255, 255, 255))
    pen = ImageDraw.Draw(sheet)
    for ratio in (0.01, 0.1, 1.0, 10.0, 100.0):
        x = place_px(ratio)
        pen.line((x, TOP_PX, x, size[1]), fill=ONE if ratio == 1.0 else GREY)
        pen.text((x - 8, 6), f"{ratio:g}", fill=BLACK)
    for row, name in enumerate(names):
        y = TOP_PX + row * ROW_PX + ROW_PX // 2
        pen.text((4, y - 6), name, fill=BLACK)
        for number, entry in enumerate(shown, start=1):
            if name in entry["ratios"]:
                _mark(pen, y, entry["ratios"][name], number / len(shown))
        pen.text((NAME_PX + WIDE_PX + 6, y - 6), f"{shown[-1]['ratios'][name][0]:.3g}", fill=BLACK)
    sheet.save(path)


def _mark(pen: ImageDraw.ImageDraw, y: int, figure: Sequence[float], age: float) -> None:
    """A disc at the median, and a line from the least to the most of the passes."""
    colour = tuple(round(old + age * (new - old)) for old, new in zip(OLDEST, NEWEST, strict=True))
    middle, least, most = map(place_px, figure)
    pen.line((least, y, most, y), fill=colour)
    pen.ellipse((middle - MARK_PX, y - MARK_PX, middle + MARK_PX, y + MARK_PX), fill=colour)
