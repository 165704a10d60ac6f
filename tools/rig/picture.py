"""Pictures of runs, as PNG: the scene from above, the map as it was believed, the way, the stops.

Over the picture of the scene (`tools.rig.draw_scene`): green and red cells are what the map held at
the end, the blue line is the true way, orange dots are stops before something, violet ones stops
before nothing, red ones contacts. Map x is to the right, map y is up.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw

from fakes.scenes.scene import Scene
from tools.rig.contact import FRONT_M, REAR_M, SIDE_M, Place
from tools.rig.draw_scene import Chart, chart_of

Colour = tuple[int, int, int]
Point = tuple[float, float]
MOST_PX = 1600  # along an edge
AROUND_M = 6.0  # of the way, as much is shown
TITLE_PX = 18
WAY, ROBOT, EDGE = (20, 60, 200), (255, 174, 0), (0, 0, 0)
STOP, FALSE_STOP, CONTACT, GOAL = (230, 140, 0), (200, 0, 200), (230, 0, 0), (0, 130, 40)
SEEN_FREE, SEEN_OBSTACLE = (40, 200, 80, 70), (230, 30, 30, 120)
GOAL_M = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class MapShot:
    """The obstacle map as it was believed: (size, size) [j, i], 1 obstacle, -1 free."""

    cells: npt.NDArray[np.int8]
    corner_i: int
    corner_j: int
    cell_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Marks:
    """What is drawn over the scene; places in the map frame, metres."""

    way: Sequence[Point] = ()
    goals: Sequence[Point] = ()
    stops: Sequence[Point] = ()
    false_stops: Sequence[Point] = ()
    contacts: Sequence[Point] = ()
    robot: Place | None = None
    seen: MapShot | None = None
    title: str = ""


def draw_run(path: Path, scene: Scene, marks: Marks) -> None:
    """The picture of a run: as much of the scene as lies around its way."""
    chart = chart_of(scene)
    if marks.seen is not None:
        _draw_seen(chart, marks.seen)
    _draw_marks(chart, marks)
    _save(path, _cropped(chart, [(0.0, 0.0), *marks.way, *marks.goals]), marks.title)


def _draw_seen(chart: Chart, shot: MapShot) -> None:
    """The map over the scene, so that both can be made out."""
    colours = np.zeros((*shot.cells.shape, 4), dtype=np.uint8)
    colours[shot.cells == -1] = SEEN_FREE
    colours[shot.cells == 1] = SEEN_OBSTACLE
    rows, columns = shot.cells.shape
    left, foot = chart.xy(shot.corner_i * shot.cell_m, shot.corner_j * shot.cell_m)
    px = chart.px_per_m * shot.cell_m
    size = (round(columns * px), round(rows * px))
    cells = Image.fromarray(np.ascontiguousarray(colours[::-1]))
    cells = cells.resize(size, Image.Resampling.NEAREST)
    chart.image.paste(cells, (round(left), round(foot) - size[1]), cells)


def _draw_marks(chart: Chart, marks: Marks) -> None:
    pen = ImageDraw.Draw(chart.image)
    if len(marks.way) > 1:
        pen.line([chart.xy(*point) for point in marks.way], fill=WAY, width=2)
    for point in marks.goals:
        pen.ellipse(chart.disc(*point, GOAL_M), outline=GOAL, width=2)
    for points, colour in (
        (marks.stops, STOP),
        (marks.false_stops, FALSE_STOP),
        (marks.contacts, CONTACT),
    ):
        for x, y in points:
            pen.ellipse(chart.disc(x, y, 0.12), fill=colour)
    if marks.robot is not None:
        pen.polygon(_outline(chart, marks.robot), fill=ROBOT, outline=EDGE)


def _outline(chart: Chart, place: Place) -> list[Point]:
    """The footprint; the nose is pointed."""
    x, y, yaw = place
    c, s = math.cos(yaw), math.sin(yaw)
    side_m, ahead_m = SIDE_M, 0.6 * FRONT_M
    corners = [(-REAR_M, -side_m), (ahead_m, -side_m), (FRONT_M, 0.0), (ahead_m, side_m)]
    corners.append((-REAR_M, side_m))
    return [chart.xy(x + c * u - s * v, y + s * u + c * v) for u, v in corners]


def _cropped(chart: Chart, points: Sequence[Point]) -> Image.Image:
    """What lies around the points, no larger than a screen can show."""
    image, places = chart.image, np.array([chart.xy(*point) for point in points])
    around = AROUND_M * chart.px_per_m
    low, high = places.min(axis=0) - around, places.max(axis=0) + around
    low = np.clip(low, 0, (image.width - 1, image.height - 1))
    high = np.clip(high, low + 1, (image.width, image.height))
    part = image.crop((int(low[0]), int(low[1]), int(high[0]), int(high[1])))
    part.thumbnail((MOST_PX, MOST_PX))
    return part


def _save(path: Path, picture: Image.Image, title: str) -> None:
    """With a line of words above, as PNG."""
    sheet = Image.new("RGB", (picture.width, picture.height + TITLE_PX), (255, 255, 255))
    sheet.paste(picture, (0, TITLE_PX))
    ImageDraw.Draw(sheet).text((6, 3), title, fill=EDGE)
    path.parent.mkdir(parents=True, exist_ok=True)
    sheet.save(path, optimize=True)
