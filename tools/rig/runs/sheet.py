"""Pictures of many recorded runs on one sheet, each with what became of it in words."""

import json
import textwrap
from collections.abc import Sequence
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

ACROSS = 4  # pictures in a row
WIDE_PX, HIGH_PX = 400, 260  # of a picture, at most
TEXT_PX, LINE_PX, LINES, COLUMNS = 76, 12, 5, 64  # the words below it
GAP_PX = 8
COLOURS = 128  # of the sheet: few are drawn, and a document is to stay small


def draw_sheet(folders: Sequence[Path], path: Path) -> None:
    """Of folders that hold `picture.png` and `run.json`; raises OSError, ValueError, KeyError."""
    pictures = [thumbnail_of(folder) for folder in folders]
    rows = [range(k, min(k + ACROSS, len(folders))) for k in range(0, len(folders), ACROSS)]
    highs_px = [max(pictures[k].height for k in row) for row in rows]
    size = min(ACROSS, len(folders)) * (WIDE_PX + GAP_PX), sum(highs_px) + len(rows) * TEXT_PX
    sheet, font = Image.new("RGB", size, "white"), ImageFont.load_default(size=LINE_PX - 1)
    pen, y = ImageDraw.Draw(sheet), 0
    for row, high_px in zip(rows, highs_px, strict=True):
        for k in row:
            x = (k - row.start) * (WIDE_PX + GAP_PX)
            sheet.paste(pictures[k], (x, y + high_px - pictures[k].height))
            lines = textwrap.wrap(words_of(folders[k]), COLUMNS)[:LINES]
            pen.multiline_text((x + 2, y + high_px + 2), "\n".join(lines), "black", font, spacing=1)
        y += high_px + TEXT_PX
    sheet.quantize(COLOURS).save(path, optimize=True)


def thumbnail_of(folder: Path) -> Image.Image:
    with Image.open(folder / "picture.png") as picture:
        picture.thumbnail((WIDE_PX, HIGH_PX))
        return picture.copy()


def words_of(folder: Path) -> str:
    """Which run it was, what was made to fail, and what became of the goals that it missed."""
    facts = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    told = [f"goal {missed['number']}: {missed['cause']}" for missed in facts["missed"]]
    about = [f"{folder.name}, {facts['scene']}", *facts["faults"]]
    return "; ".join([", ".join(about), *told])
