"""A picture of what each mount sees of one stepfield: ahead is up; black is occluded."""

from collections.abc import Sequence

import numpy as np
from PIL import Image, ImageDraw

from core.records import F64
from tools.placement.measure import seen_of
from tools.placement.sensor import Sensor
from tools.placement.sight import OCCLUDED, SEEN

SCALE, TITLE_PX, GAP_PX, ROW = 3, 18, 8, 3


def drawn(sensors: Sequence[Sensor], heights: F64) -> Image.Image:
    panels = []
    for sensor in sensors:
        states, sigmas = seen_of(sensor, heights)
        pixels = np.full((*states.shape, 3), 235, dtype=np.uint8)
        pixels[states == OCCLUDED] = 0
        shade = np.clip(np.nan_to_num(sigmas) / 0.008, 0.0, 1.0)  # green to red at 8 mm
        colours = np.stack([60 + 180 * shade, 190 - 130 * shade, 60 + 0 * shade], axis=2)
        pixels[states == SEEN] = colours[states == SEEN].astype(np.uint8)
        panels.append(Image.fromarray(np.ascontiguousarray(pixels[::-1, ::-1])))
    wide, high = (SCALE * side for side in panels[0].size)
    rows = -(-len(panels) // ROW)
    size = (min(ROW, len(panels)) * (wide + GAP_PX), rows * (high + TITLE_PX + GAP_PX))
    sheet = Image.new("RGB", size, (255, 255, 255))
    for number, (sensor, panel) in enumerate(zip(sensors, panels, strict=True)):
        x, y = number % ROW * (wide + GAP_PX), number // ROW * (high + TITLE_PX + GAP_PX)
        ImageDraw.Draw(sheet).text((x + 2, y + 3), sensor.name, fill=(0, 0, 0))
        sheet.paste(panel.resize((wide, high), Image.Resampling.NEAREST), (x, y + TITLE_PX))
    return sheet
