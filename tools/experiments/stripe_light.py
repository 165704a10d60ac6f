"""What the driver of a camera with a laser line makes of its images in each kind of light.

A fake camera looks at a floor with boxes, other ones for each seed. A column is right where its
range is within 1 % or 3 mm of a place of the line that the camera sees there; wrong where it has
any other range, or one where there is no line; and none where there is a line and no range. Then
the small robot of the rig drives towards a box in each light. Both with each way to find the line.
Writes the tables of docs/terrain.md; with --quick, few seeds and no drives, which are printed.

    python -m tools.experiments.stripe_light
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, get_args

import numpy as np

from config_file import load_config, with_changes
from fakes.scenes.scene import Scene, Solid
from fakes.stripe.device import FakeStripe
from fakes.stripe.jpeg import jpeg_from_image
from fakes.world.kinematic import KinematicWorld
from fakes.world.trajectory import Way, stand
from hw.device import BadFrame
from hw.stripe.detect import Method
from hw.stripe.images import Decoder
from hw.stripe.options import StripeOptions
from hw.stripe.session import LEAST_SHARE
from hw.stripe.sweep import SweepMaker
from tools.cli.options import ROBOTS
from tools.experiments.terrain.report import DOCUMENT, with_tables
from tools.rig.faults.drive import Drive, course_of, harm

BEGIN, END = "<!-- light: begin -->", "<!-- light: end -->"
FINDS: tuple[Method, ...] = get_args(Method)  # ways to find the line; the paper's is "threshold"
FULL, QUICK = 40, 2  # floors
ROBOT = "ragno"
AMBIENT = ("lamp", "dark", "window", "sun")
COMES_S, WAIT_S = 3.0, 4.0  # how long another light is there in a drive; at most, after that
EVERY_M = 0.137  # between the places of two seeds
NEAR_SHARE, NEAR_M, BESIDE_PX = 0.01, 0.003, 1.0
LIGHTS: dict[str, dict[str, Any]] = {
    "dark": {"ambient": "dark"},
    "lamp": {"ambient": "lamp"},
    "lamp, automatic exposure": {"ambient": "lamp", "auto_exposure": True},
    "lamp, a third of the laser": {"ambient": "lamp", "laser": 0.33},
    "lamp, laser off": {"ambient": "lamp", "laser": 0.0},
    "window": {"ambient": "window"},
    "window, half exposure": {"ambient": "window", "exposure": 0.5},
    "window, laser off": {"ambient": "window", "laser": 0.0},
    "sun": {"ambient": "sun"},
    "sun, 1/40 exposure": {"ambient": "sun", "exposure": 0.025},
    "sun, automatic exposure": {"ambient": "sun", "auto_exposure": True},
}


@dataclass(frozen=True, slots=True)
class Columns:
    """Of one image, or the sum of several: counts of columns."""

    right: int = 0
    wrong: int = 0
    none: int = 0
    all: int = 0
    images: int = 0
    doubted: int = 0  # images in which too few columns have a range to be believed

    def __add__(self, other: "Columns") -> "Columns":
        pairs = ((getattr(self, name), getattr(other, name)) for name in self.__slots__)
        return Columns(*(one + two for one, two in pairs))


def boxes(seed: int, ahead_m: float) -> tuple[Solid, ...]:
    """Four of them where the line of a robot that stands so far ahead meets the floor, or near."""
    random = np.random.default_rng([seed, 3])
    made = []
    for k in range(4):
        x, y = ahead_m + 0.5 + 0.3 * random.random(), -0.4 + 0.2 * k + 0.1 * random.random()
        size = 0.05 + 0.1 * random.random()
        high_m = 0.02 + 0.13 * random.random()
        made.append(Solid(f"box {k}", (x, x + size), (y, y + size), (0.0, high_m)))
    return tuple(made)


class Looker:
    """The camera of robots/ragno.toml, as a fake and as the driver."""

    def __init__(self, find: Method = "peak") -> None:
        config = load_config(ROBOTS[ROBOT].read_text(encoding="utf-8"))
        options = with_changes(config, scanner={"find": find}).scanner.options
        assert isinstance(options, StripeOptions)
        self._decoder = Decoder((options.image_px[0], options.image_px[1]))
        self._maker = SweepMaker(options)

    def look(self, seed: int, **light: Any) -> Columns:
        floor = Solid("floor", (-9.0, 99.0), (-9.0, 9.0), (-1.0, 0.0))
        ahead_m = EVERY_M * seed  # the sun's pools by a window lie elsewhere
        way = Way(stand(1.0), start=(ahead_m, 0.0, 0.0))
        scene = Scene("here", (floor, *boxes(seed, ahead_m)))
        world = KinematicWorld(scene, way, seed=seed)
        world.step_to(0.0)
        fake = FakeStripe(world.met, seed)
        for name, value in light.items():
            setattr(fake, name, value)
        image = self._decoder.image(jpeg_from_image(fake.camera.image(0.0), fake))
        line = fake.camera.line
        assert line is not None
        assert not isinstance(image, BadFrame), image.reason
        ranges_m = self._maker.sweep(image, 0.0, 0.0).ranges_m[0]
        return judged(ranges_m, line.columns, line.ranges_m, bool(fake.laser))


def judged(ranges_m: Any, columns: Any, true_m: Any, is_lit: bool) -> Columns:
    right = wrong = none = 0
    for u, range_m in enumerate(ranges_m):
        there_m = true_m[np.abs(columns - u) <= BESIDE_PX] if is_lit else true_m[:0]
        if np.isfinite(range_m):
            off_m = np.abs(there_m - range_m).min(initial=np.inf)
            is_right = off_m <= max(NEAR_M, NEAR_SHARE * range_m)
            right, wrong = right + is_right, wrong + (not is_right)
        elif len(there_m):
            none += 1
    measured = float(np.isfinite(ranges_m).mean())
    return Columns(right, wrong, none, len(ranges_m), 1, int(measured < LEAST_SHARE))


def columns_table(seeds: int) -> Iterator[str]:
    yield "| light | line found by | right % | wrong % | none % | images in doubt |"
    yield "|---|---|---|---|---|---|"
    lookers = {find: Looker(find) for find in FINDS}
    for name, light in LIGHTS.items():
        for find, looker in lookers.items():
            total = sum((looker.look(seed, **light) for seed in range(seeds)), Columns())
            shares = (100 * count / total.all for count in (total.right, total.wrong, total.none))
            told = " | ".join(f"{share:.2f}" for share in shares)
            yield f"| {name} | {find} | {told} | {total.doubted} of {total.images} |"


def drive_row(ambient: str, find: Method) -> str:
    """A drive under the lamp until another light comes for a while."""
    begin_s = course_of(ROBOT).fault_from_s
    end_s = begin_s + COMES_S
    orders = [f"scanner.ambient={ambient}@{begin_s:g}s+{COMES_S:g}s"]
    changes = {"scanner": {"find": find}}
    one = Drive(orders, (begin_s, end_s), WAIT_S, robot=ROBOT, changes=changes).run()
    again = "waits" if one.again_s is None else f"{one.again_s:.2f}"
    cells = (
        *(ambient, find, "goes on" if one.stood_s is None else f"{one.stood_s:.2f}"),
        f"{one.blind_m:.2f}",
        "-" if one.told_s is None else f"{one.told_s:.2f}",
        "-" if one.stood_s is None else again,
        "; ".join(harm(one)) or "none",
    )
    return f"| {' | '.join(cells)} |"


def drives_table() -> Iterator[str]:
    yield "| light | line found by | stands after s | driven m | told after s | sets out s | harm |"
    yield "|---|---|---|---|---|---|---|"
    for ambient in AMBIENT:
        for find in FINDS:
            yield drive_row(ambient, find)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--quick", action="store_true", help="few floors; writes no document")
    is_quick = parser.parse_args().quick
    told = "\n".join(columns_table(QUICK if is_quick else FULL))
    if is_quick:
        print(told)
        return
    told = "\n".join([told, "", *drives_table()])
    before = DOCUMENT.read_text(encoding="utf-8")
    DOCUMENT.write_text(with_tables(before, told, (BEGIN, END)), encoding="utf-8")
    print(f"{told}\nmapod: written to {DOCUMENT.name}")


if __name__ == "__main__":
    main()
