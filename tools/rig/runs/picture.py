"""A scene from above as a picture, or a recorded run in it. Up is the map's y.

Grey: heights, the darker the higher. Red: lower than the start. Blue: glass; black: black floor;
green: soft; yellow: slippery; orange rings: steel. Light blue disc: ground that the operator
vouches for. Crosses: goals, numbered; green lines: where people walk.

Over that, of a run: green and red cells are what the map held at the end, the blue line is the true
way, orange dots are stops before something, violet ones stops before nothing, red ones contacts.
"""

import csv
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw

from fakes.scenes.scene import Scene, load_scene
from tools.rig.truth.contact import FRONT_M, HEIGHT_M, REAR_M, SIDE_M, Place

PX_PER_M = 20.0
MARGIN_M = 1.0
MOST_PX = 1600  # along an edge of a run's picture
AROUND_M = 6.0  # of the way, as much is shown
TITLE_PX = 18
Array = npt.NDArray[Any]
Colour = tuple[int, int, int]
Point = tuple[float, float]
LOWER, GLASS, SOFT, BLACK = (230, 120, 110), (80, 130, 230), (120, 190, 100), (20, 20, 20)
WAY, ROBOT, EDGE, GOAL = (20, 60, 200), (255, 174, 0), (0, 0, 0), (220, 0, 0, 255)
STOP, FALSE_STOP, CONTACT = (230, 140, 0), (200, 0, 200), (230, 0, 0)
SEEN_FREE, SEEN_OBSTACLE = (40, 200, 80, 70), (230, 30, 30, 120)


@dataclass(frozen=True, slots=True)
class Chart:
    """A picture of a scene, and where places lie in it."""

    image: Image.Image
    low_x_m: float
    high_y_m: float
    px_per_m: float

    def xy(self, x_m: float, y_m: float) -> Point:
        return (x_m - self.low_x_m) * self.px_per_m, (self.high_y_m - y_m) * self.px_per_m

    def box(self, x: Point, y: Point) -> tuple[float, float, float, float]:
        """Pixels of a rectangle, x and y from, to, as Pillow wants it."""
        return *self.xy(x[0], y[1]), *self.xy(x[1], y[0])

    def disc(self, x_m: float, y_m: float, radius_m: float) -> tuple[float, float, float, float]:
        return self.box((x_m - radius_m, x_m + radius_m), (y_m - radius_m, y_m + radius_m))

    def robot(self, place: Place) -> list[Point]:
        x, y, yaw = place
        c, s = math.cos(yaw), math.sin(yaw)
        corners = [(-REAR_M, -SIDE_M), (0.6 * FRONT_M, -SIDE_M), (FRONT_M, 0.0)]
        corners += [(0.6 * FRONT_M, SIDE_M), (-REAR_M, SIDE_M)]
        return [self.xy(x + c * u - s * v, y + s * u + c * v) for u, v in corners]


# Scenes


def chart_of(scene: Scene, px_per_m: float = PX_PER_M) -> Chart:
    low_x = min(solid.x[0] for solid in scene.solids) - MARGIN_M
    high_x = max(solid.x[1] for solid in scene.solids) + MARGIN_M
    low_y = min(solid.y[0] for solid in scene.solids) - MARGIN_M
    high_y = max(solid.y[1] for solid in scene.solids) + MARGIN_M
    xs = np.arange(low_x, high_x, 1.0 / px_per_m)
    ys = np.arange(high_y, low_y, -1.0 / px_per_m)
    pixels = np.full((len(ys), len(xs), 3), (60, 40, 40), dtype=np.uint8)
    for solid in sorted(scene.solids, key=lambda solid: max(solid.z) if hasattr(solid, "z") else 0):
        columns, rows = _within(xs, solid.x), _within(ys, solid.y)
        if not len(columns) or not len(rows):
            continue
        x, y = np.meshgrid(xs[columns], ys[rows])
        tops = solid.tops_m(x, y)
        there = np.isfinite(tops) & (solid.bottom_m < HEIGHT_M)  # not what hangs higher
        some = np.ix_(rows, columns)
        pixels[some] = np.where(there[..., None], _shades(tops, solid.material.kind), pixels[some])
    chart = Chart(Image.fromarray(pixels), low_x, high_y, px_per_m)
    _draw_marks(chart, scene)
    return chart


def _within(places: Array, span: Point) -> Array:
    return np.flatnonzero((places >= span[0]) & (places <= span[1]))


def _shades(tops_m: Array, kind: str) -> Array:
    """Colours (rows, columns, 3) of heights of one material."""
    flat: dict[str, Colour] = {"glass": GLASS, "soft": SOFT, "black": BLACK}
    if kind in flat:
        return np.broadcast_to(np.array(flat[kind]), (*tops_m.shape, 3))
    high = np.nan_to_num(tops_m, neginf=0.0)
    grey = np.where(high < 0.03, 245, np.clip(215 - 80 * high, 40, 215))
    shade = np.repeat(grey[..., None], 3, axis=-1)
    return np.where((high < -0.03)[..., None], np.array(LOWER), shade)


def _draw_marks(chart: Chart, scene: Scene) -> None:
    pen = ImageDraw.Draw(chart.image, "RGBA")
    pen.ellipse(chart.disc(0.0, 0.0, scene.start_clear_m), (90, 170, 255, 25), (90, 170, 255, 120))
    for patch in scene.patches:
        pen.rectangle(chart.box(patch.x, patch.y), (250, 220, 60, 90))
    for steel in scene.steels:
        pen.ellipse(chart.disc(*steel.at, steel.reach_m), None, (240, 140, 30, 200), 2)
    for walker in scene.walkers:
        pen.line([chart.xy(*point) for point in walker.waypoints], (40, 160, 60, 200), 2)
        pen.ellipse(chart.disc(*walker.waypoints[0], walker.radius_m), (40, 160, 60, 255))
    for mover in scene.movers:
        pen.line([chart.xy(*point) for point in mover.waypoints], (160, 60, 160, 200), 2)
    pen.polygon(chart.robot((0.0, 0.0, 0.0)), (30, 90, 220, 255))
    for k, (x, y) in enumerate(scene.goals):
        pen.line([chart.xy(x - 0.3, y - 0.3), chart.xy(x + 0.3, y + 0.3)], GOAL, 3)
        pen.line([chart.xy(x - 0.3, y + 0.3), chart.xy(x + 0.3, y - 0.3)], GOAL, 3)
        pen.text(chart.xy(x + 0.4, y + 0.4), str(k + 1), GOAL)


# Runs


def draw_run(folder: Path, scene: Scene | None = None) -> Path:
    """From its files; raises OSError, ValueError, KeyError, TypeError: they are no run's."""
    facts = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    with (folder / "path.csv").open(encoding="ascii", newline="") as file:
        rows = list(csv.DictReader(file))
    places = [(float(row["x_m"]), float(row["y_m"]), float(row["yaw_rad"])) for row in rows]
    way = [place[:2] for place in places]
    scene = scene or load_scene(facts["scene_file"], facts["seed"])
    chart = chart_of(scene)
    with np.load(folder / "map.npz") as held:
        _draw_seen(chart, held["cells"], held["corner"].tolist(), float(held["cell_m"]))
    pen = ImageDraw.Draw(chart.image)
    if len(way) > 1:
        pen.line([chart.xy(*point) for point in way], fill=WAY, width=2)
    dots = [(stop, STOP if stop["in_way"] else FALSE_STOP) for stop in facts["stops"]]
    for dot, colour in [*dots, *((contact, CONTACT) for contact in facts["collisions"])]:
        pen.ellipse(chart.disc(dot["x_m"], dot["y_m"], 0.12), fill=colour)
    if places:
        pen.polygon(chart.robot(places[-1]), fill=ROBOT, outline=EDGE)
    title = f"{facts['scene']}, seed {facts['seed']}: {facts['reached']} of {facts['goals']} goals"
    picture = _cropped(chart, [(0.0, 0.0), *way, *scene.goals])
    sheet = Image.new("RGB", (picture.width, picture.height + TITLE_PX), (255, 255, 255))
    sheet.paste(picture, (0, TITLE_PX))
    ImageDraw.Draw(sheet).text((6, 3), f"{title}; {facts['ended']}", fill=EDGE)
    sheet.save(folder / "picture.png", optimize=True)
    return folder / "picture.png"


def _draw_seen(chart: Chart, cells: Array, corner: tuple[int, int], cell_m: float) -> None:
    colours = np.zeros((*cells.shape, 4), dtype=np.uint8)
    colours[cells == -1] = SEEN_FREE
    colours[cells == 1] = SEEN_OBSTACLE
    left, foot = chart.xy(corner[0] * cell_m, corner[1] * cell_m)
    px = chart.px_per_m * cell_m
    size = (round(cells.shape[1] * px), round(cells.shape[0] * px))
    seen = Image.fromarray(np.ascontiguousarray(colours[::-1]))
    seen = seen.resize(size, Image.Resampling.NEAREST)
    chart.image.paste(seen, (round(left), round(foot) - size[1]), seen)


def _cropped(chart: Chart, points: Sequence[Point]) -> Image.Image:
    image, places = chart.image, np.array([chart.xy(*point) for point in points])
    around = AROUND_M * chart.px_per_m
    low, high = places.min(axis=0) - around, places.max(axis=0) + around
    low = np.clip(low, 0, (image.width - 1, image.height - 1))
    high = np.clip(high, low + 1, (image.width, image.height))
    part = image.crop((int(low[0]), int(low[1]), int(high[0]), int(high[1])))
    part.thumbnail((MOST_PX, MOST_PX))
    return part
