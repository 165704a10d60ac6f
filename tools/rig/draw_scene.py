"""A scene from above, as a picture: `python -m tools.rig.draw_scene NAME --seed 3 --out FILE`.

Grey: heights, the darker the higher. Red: lower than the start. Blue: glass; black: black floor;
green: soft; yellow: slippery; orange rings: steel. Light blue disc: ground that the operator
vouches for. Crosses: goals, numbered; green lines: where people walk. Up is the map's y.
"""

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw

from fakes.scenes.scene import Scene, load_scene, problems

PX_PER_M = 20.0
MARGIN_M = 1.0
FRONT_M, REAR_M, HALF_WIDTH_M = 0.52, 0.20, 0.30
HANGING_M = 1.3  # what begins higher is drawn as an outline
Array = npt.NDArray[Any]
Colour = tuple[int, int, int]
LOWER, GLASS, SOFT, BLACK = (230, 120, 110), (80, 130, 230), (120, 190, 100), (20, 20, 20)


@dataclass(frozen=True, slots=True)
class Chart:
    """A picture of a scene, and where places lie in it."""

    image: Image.Image
    low_x_m: float
    high_y_m: float
    px_per_m: float

    def xy(self, x_m: float, y_m: float) -> tuple[float, float]:
        """Pixel of a place of the map."""
        return (x_m - self.low_x_m) * self.px_per_m, (self.high_y_m - y_m) * self.px_per_m

    def disc(self, x_m: float, y_m: float, radius_m: float) -> tuple[float, float, float, float]:
        """Pixels of the box around a circle, as Pillow wants it."""
        (left, top), (right, bottom) = (
            self.xy(x_m - radius_m, y_m + radius_m),
            self.xy(x_m + radius_m, y_m - radius_m),
        )
        return left, top, right, bottom


def chart_of(scene: Scene, px_per_m: float = PX_PER_M) -> Chart:
    """The scene from above, without what moves but with the ways it takes."""
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
        there = np.isfinite(tops) & (solid.bottom_m < HANGING_M)
        some = np.ix_(rows, columns)
        pixels[some] = np.where(there[..., None], _shades(tops, solid.material.kind), pixels[some])
    chart = Chart(Image.fromarray(pixels), low_x, high_y, px_per_m)
    _draw_marks(chart, scene)
    return chart


def _within(places: Array, span: tuple[float, float]) -> Array:
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
    """Start, goals, people, steel and slippery ground."""
    pen = ImageDraw.Draw(chart.image, "RGBA")
    pen.ellipse(chart.disc(0.0, 0.0, scene.start_clear_m), (90, 170, 255, 25), (90, 170, 255, 120))
    for patch in scene.patches:
        (left, top), (right, bottom) = (
            chart.xy(patch.x[0], patch.y[1]),
            chart.xy(patch.x[1], patch.y[0]),
        )
        pen.rectangle((left, top, right, bottom), (250, 220, 60, 90))
    for steel in scene.steels:
        pen.ellipse(chart.disc(*steel.at, steel.reach_m), None, (240, 140, 30, 200), 2)
    for walker in scene.walkers:
        pen.line([chart.xy(*point) for point in walker.waypoints], (40, 160, 60, 200), 2)
        pen.ellipse(chart.disc(*walker.waypoints[0], walker.radius_m), (40, 160, 60, 255))
    for mover in scene.movers:
        pen.line([chart.xy(*point) for point in mover.waypoints], (160, 60, 160, 200), 2)
    corners = [(FRONT_M, HALF_WIDTH_M), (FRONT_M, -HALF_WIDTH_M), (-REAR_M, -HALF_WIDTH_M),
               (-REAR_M, HALF_WIDTH_M)]  # fmt: skip
    pen.polygon([chart.xy(*corner) for corner in corners], (30, 90, 220, 255))
    for k, (x, y) in enumerate(scene.goals):
        pen.line([chart.xy(x - 0.3, y - 0.3), chart.xy(x + 0.3, y + 0.3)], (220, 0, 0, 255), 3)
        pen.line([chart.xy(x - 0.3, y + 0.3), chart.xy(x + 0.3, y - 0.3)], (220, 0, 0, 255), 3)
        pen.text(chart.xy(x + 0.4, y + 0.4), str(k + 1), (220, 0, 0, 255))


def main(words: list[str]) -> int:
    """Draw one scene; tell how many solids it has and what is wrong with it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", help="name of a shipped scene, or path of a scene's file")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, help="the picture; scene_<name>_<seed>.png if not told")
    given = parser.parse_args(words)
    scene = load_scene(given.scene, given.seed)
    out = given.out or Path(f"scene_{scene.name}_{given.seed}.png")
    chart_of(scene).image.save(out)
    print(f"{scene.name}, seed {given.seed}: {scene.description}")
    print(
        f"{len(scene.solids)} solids, {len(scene.walkers)} walkers, {len(scene.goals)} goals: {out}"
    )
    for problem in problems(scene) if scene.goals else []:
        print(f"  problem: {problem}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
