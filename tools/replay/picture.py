"""The map of one moment as a picture: classes of cells, robot and its path, legend and scale.

Map x, where the robot's nose pointed when the run began, is up; map y is left. Needs Pillow.
"""

import math
from collections.abc import Sequence

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from core.records import U8
from core.run_settings import Robot
from mapod_link.bodies import FREE, OBSTACLE, UNKNOWN
from tools.replay.moment import Moment

Point = tuple[float, float]
Colour = tuple[int, int, int]
COLOURS: dict[int, Colour] = {  # told apart also by who sees no red or no green
    UNKNOWN: (196, 198, 204),
    FREE: (250, 250, 250),
    OBSTACLE: (30, 30, 36),
}
NAMES = {FREE: "free", OBSTACLE: "obstacle", UNKNOWN: "unknown"}
PAPER, INK, WAY, ROBOT = (255, 255, 255), (20, 20, 24), (0, 114, 178), (230, 159, 0)
MAP_PX, MARGIN_PX, TITLE_PX, FOOT_PX, FONT_PX = 760, 14, 34, 44, 15
BARS_M = (10.0, 5.0, 2.0, 1.0, 0.5, 0.2, 0.1)


def picture_of(moment: Moment, robot: Robot, path: Sequence[Point], title: str) -> Image.Image:
    """The map as it is told at one moment.

    Args:
        path: where the robot was, (x, y) metres in the map frame, in order.
    """
    drawn, px = map_image(moment.states)
    pen, size = ImageDraw.Draw(drawn), len(moment.states)

    def pixel(point: Point) -> Point:
        column, row = moment.cell(*point)
        return (size - row) * px, (size - column) * px

    if len(path) > 1:
        pen.line([pixel(point) for point in path], fill=WAY, width=2, joint="curve")
    if (pose := moment.pose) is not None:
        corners = footprint(robot, pose.x_m, pose.y_m, pose.yaw_rad)
        pen.polygon([pixel(point) for point in corners], fill=ROBOT, outline=INK)
    return framed(drawn, title, px / moment.cell_m)


def map_image(states: U8) -> tuple[Image.Image, int]:
    """The classes in their colours, and how many pixels a cell is wide."""
    px = max(1, round(MAP_PX / len(states)))
    colours = np.zeros((3, 3), np.uint8)
    for state, colour in COLOURS.items():
        colours[state] = colour
    upright = np.ascontiguousarray(colours[states].swapaxes(0, 1)[::-1, ::-1])
    side = len(states) * px
    return Image.fromarray(upright).resize((side, side), Image.Resampling.NEAREST), px


def footprint(robot: Robot, x_m: float, y_m: float, yaw_rad: float) -> list[Point]:
    """The robot's outline, its nose pointed, (x, y) metres in the map frame."""
    side_m, c, s = robot.width_m / 2, math.cos(yaw_rad), math.sin(yaw_rad)
    outline = [(-robot.rear_m, -side_m), (0.6 * robot.front_m, -side_m), (robot.front_m, 0.0)]
    outline += [(0.6 * robot.front_m, side_m), (-robot.rear_m, side_m)]
    return [(x_m + c * u - s * v, y_m + s * u + c * v) for u, v in outline]


def framed(drawn: Image.Image, title: str, px_per_m: float) -> Image.Image:
    """With title above, legend and scale below; both sides are even, as films want it."""
    wide, high = drawn.width + 2 * MARGIN_PX, drawn.height + TITLE_PX + FOOT_PX
    sheet = Image.new("RGB", (wide + wide % 2, high + high % 2), PAPER)
    sheet.paste(drawn, (MARGIN_PX, TITLE_PX))
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(FONT_PX)
    right, foot = MARGIN_PX + drawn.width, TITLE_PX + drawn.height
    pen.rectangle([MARGIN_PX - 1, TITLE_PX - 1, right, foot], outline=INK)
    pen.text((MARGIN_PX, (TITLE_PX - FONT_PX) / 2), title, fill=INK, font=font)
    at, top = MARGIN_PX, foot + (FOOT_PX - FONT_PX) // 2
    swatches = [(NAMES[state], COLOURS[state]) for state in NAMES]
    for name, colour in [*swatches, ("robot", ROBOT), ("path", WAY)]:
        pen.rectangle([at, top, at + FONT_PX, top + FONT_PX], fill=colour, outline=INK)
        pen.text((at + FONT_PX + 5, top - 1), name, fill=INK, font=font)
        at += FONT_PX + 20 + round(pen.textlength(name, font=font))
    bar_m = next((bar_m for bar_m in BARS_M if bar_m * px_per_m <= drawn.width / 5), BARS_M[-1])
    begin = right - round(bar_m * px_per_m)
    pen.line([(begin, foot + 34), (right, foot + 34)], fill=INK, width=3)
    pen.text((begin, foot + 10), f"{bar_m:g} m", fill=INK, font=font)
    return sheet
