"""Pictures of many recorded runs on one sheet, each with what became of it in words."""

import json
import textwrap
from collections.abc import Sequence
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

ACROSS = 4  # pictures in a row
WIDE_PX, HIGH_PX = 400, 260  # of a picture, at most
TEXT_PX, LINE_PX, LINES, COLUMNS = 62, 12, 5, 64  # the words below it
GAP_PX = 8
COLOURS = 128  # of the sheet: few are drawn, and a document is to stay small


def draw_sheet(folders: Sequence[Path], path: Path) -> None:
    """Of folders that hold `picture.png` and `run.json`; raises OSError, ValueError, KeyError."""
    cell = WIDE_PX + GAP_PX, HIGH_PX + TEXT_PX + GAP_PX
    rows = -(-len(folders) // ACROSS)
    sheet = Image.new("RGB", (min(ACROSS, len(folders)) * cell[0], rows * cell[1]), "white")
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(size=LINE_PX - 1)
    for k, folder in enumerate(folders):
        x, y = (k % ACROSS) * cell[0], (k // ACROSS) * cell[1]
        with Image.open(folder / "picture.png") as picture:
            picture.thumbnail((WIDE_PX, HIGH_PX))
            sheet.paste(picture, (x, y + HIGH_PX - picture.height))
        lines = textwrap.wrap(words_of(folder), COLUMNS)[:LINES]
        pen.multiline_text((x + 2, y + HIGH_PX + 2), "\n".join(lines), "black", font, spacing=1)
    sheet.quantize(COLOURS).save(path, optimize=True)


def words_of(folder: Path) -> str:
    """Which run it was, what was made to fail, and what became of the goals that it missed."""
    facts = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    told = [f"goal {missed['number']}: {missed['cause']}" for missed in facts["missed"]]
    about = [f"{folder.name}, {facts['scene']}", *facts["faults"]]
    return "; ".join([", ".join(about), *told])
