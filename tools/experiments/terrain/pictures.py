"""Pictures of the maps of seed 1: ahead is up; white is unknown, red too high, blue too low."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw

from core.records import F64
from tools.experiments.pictures import upright
from tools.experiments.terrain import scenes
from tools.experiments.terrain.measure import ARTEFACT_M, Truth, off_m, truth_of
from tools.experiments.terrain.methods import SHADED
from tools.experiments.terrain.ride import STEADY
from tools.experiments.terrain.trials import (
    BOXES,
    BY_STRIPE,
    FLAT,
    GAITS,
    ROCKY,
    STEEP,
    STRIPE,
    mapped_m,
)

SEED = 1
DRAWN = ("certainty, none", "certainty, all", "surface", SHADED, "reference_plane")
BROWN, LIGHT = np.array([90.0, 60.0, 30.0]), np.array([240.0, 232.0, 215.0])
RED, BLUE, WHITE = (225, 30, 40), (30, 80, 230), (255, 255, 255)
HIGHEST_M = 0.18  # drawn darkest
TITLE_PX, GAP_PX = 16, 6
BOXES_PNG, ROCKS_PNG = "terrain-boxes.png", "terrain-rocks.png"
Panel = tuple[str, F64]


def pixels_of(heights_m: F64, truth: Truth) -> npt.NDArray[np.uint8]:
    """(m, n, 3) of heights [j, i]."""
    share = np.clip(np.nan_to_num(heights_m) / HIGHEST_M, 0.0, 1.0)[:, :, None]
    pixels: npt.NDArray[np.uint8] = (LIGHT + share * (BROWN - LIGHT)).astype(np.uint8)
    off = off_m(heights_m, truth)
    pixels[off > ARTEFACT_M], pixels[off < -ARTEFACT_M] = RED, BLUE
    pixels[np.isnan(heights_m)] = WHITE
    return pixels


def sheet(panels: Sequence[Panel], truth: Truth, scale: int, columns: int) -> Image.Image:
    images = [Image.fromarray(upright(pixels_of(heights_m, truth))) for _, heights_m in panels]
    wide, high = (scale * side for side in images[0].size)
    rows = -(-len(panels) // columns)
    size = (columns * (wide + GAP_PX), rows * (high + TITLE_PX + GAP_PX))
    drawn = Image.new("RGB", size, WHITE)
    draw = ImageDraw.Draw(drawn)
    for k, ((title, _), image) in enumerate(zip(panels, images, strict=True)):
        x, y = k % columns * (wide + GAP_PX), k // columns * (high + TITLE_PX + GAP_PX)
        draw.text((x + 2, y + 2), title, fill=(0, 0, 0))
        drawn.paste(image.resize((wide, high), Image.Resampling.NEAREST), (x, y + TITLE_PX))
        draw.rectangle([x, y + TITLE_PX, x + wide - 1, y + TITLE_PX + high - 1], outline="gray")
    return drawn.quantize(64, dither=Image.Dither.NONE)


def draw_all(folder: Path) -> list[str]:
    """Both pictures into a folder; their names."""
    folder.mkdir(parents=True, exist_ok=True)
    scene = scenes.scene("two boxes", *scenes.two_boxes(SEED))
    truth = truth_of(scene, BOXES)
    told = mapped_m(scene, STEEP, BOXES, STEADY, SEED, DRAWN)
    by_stripe = mapped_m(scene, STRIPE, BOXES, STEADY, SEED, BY_STRIPE)
    panels = [("truth", truth.high_m), *told.items()]
    panels += [(f"{name}, stripe", heights_m) for name, heights_m in by_stripe.items()]
    sheet(panels, truth, 3, 4).save(folder / BOXES_PNG, optimize=True)
    scene = scenes.scene("rocks", *scenes.rocks(SEED))
    truth, panels = truth_of(scene, ROCKY), []
    for walk, gait in GAITS.items():
        mapped = mapped_m(scene, FLAT, ROCKY, gait, SEED, DRAWN[:4])
        panels += [("truth", truth.high_m)]
        panels += [(f"{name}, {walk}", heights_m) for name, heights_m in mapped.items()]
    sheet(panels, truth, 1, 5).save(folder / ROCKS_PNG, optimize=True)
    return [BOXES_PNG, ROCKS_PNG]
