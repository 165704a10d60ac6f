"""Beyond the paper: uneven ground. Speed bumps, a nodding robot, ramps of 1 to 8 degrees."""

import math
from collections.abc import Sequence
from pathlib import Path

from fakes.scenes.scene import Scene
from fakes.scenes.solids import Shape, bump
from fakes.world.trajectory import Way, nodding, stand, straight
from tools.experiments import metrics
from tools.experiments.report import Outcome
from tools.experiments.scenes import COMPASS_RAD, box, corridor, ramp_corridor, scene
from tools.experiments.trial import BOTH, LEAD_S, Tally, Trial, methods

EVERY_S = 0.5
LANE_Y = (-2.07, 2.05)


def _drive(outcome: Outcome, test: Trial, until_s: float, words: str = "") -> None:
    """Run; false obstacle cells, and cells of 0.15 m and more told free, every half second."""
    false, free = Tally(), Tally()

    def look() -> None:
        if test.elapsed_s > LEAD_S:
            false.take(test.per_app(metrics.false_obstacles))
            free.take(test.per_app(metrics.free_on_danger))

    test.run(until_s, EVERY_S, look)
    outcome.tell(f"{words}false obstacle cells, mean", false.mean(), digits=1)
    outcome.tell(f"{words}false obstacle cells, most", false.most(), digits=0)
    outcome.tell(f"{words}obstacle cells missed, at the end", test.missed(), digits=0)
    outcome.tell(f"{words}cells told free on an obstacle, most", free.most(), digits=0)


def _with_boxes(solids: Sequence[Shape], places_m: Sequence[float], high_m: float = 0.3) -> Scene:
    boxes = [box(f"box {k}", (x, x + 0.55), (0.83, 1.43), high_m) for k, x in enumerate(places_m)]
    return Scene("place", (*solids, *boxes), x_axis_east_of_north_rad=COMPASS_RAD)


def speed_bumps(quick: bool, folder: Path) -> Outcome:
    bumps = [bump(f"bump {k}", (x, x + 0.4), LANE_Y) for k, x in enumerate((4.07, 6.57, 9.07))]
    way = Way(stand(LEAD_S), straight(7.0 if quick else 12.0, 1.0))
    place = _with_boxes([*corridor(28.37), *bumps], (14.07, 18.57))
    test = Trial(place, way, methods(quick), follows=True, x_m=(-8.0, 34.0))
    note = "Three round bumps, 5 cm high and 0.4 m long, boxes of 0.3 m beyond."
    outcome = Outcome("7 speed bumps, 1 m/s", note)
    _drive(outcome, test, way.duration_s + 0.5)
    caption = "7: after three speed bumps at 1 m/s"
    outcome.draw(folder / "7-bumps.png", caption, test.views(*BOTH), (-1, 22), (-3, 3))
    return outcome


def pitching(quick: bool, folder: Path) -> Outcome:
    base = Way(stand(LEAD_S), straight(3.0 if quick else 9.0, 0.6))
    motion = nodding(base, math.radians(3.0), 1.0, LEAD_S)
    place = _with_boxes(corridor(28.37), (11.07, 15.57))
    test = Trial(place, motion, methods(quick), x_m=(-8.0, 34.0))
    note = "Corridor with two boxes of 0.3 m, 9 m at 0.6 m/s."
    outcome = Outcome("7 pitching +-3 deg, 1 Hz", note)
    _drive(outcome, test, base.duration_s)
    caption = "7: after 9 m with the body pitching by 3 degrees at 1 Hz"
    outcome.draw(folder / "7-pitching.png", caption, test.views(*BOTH), (-1, 22), (-3, 3))
    return outcome


ANGLES_DEG = (1.0, 2.0, 4.0, 6.0, 8.0)
RAMP_AT_M, RAMP_LONG_M = 9.07, 6.0
AT_ONCE_M = 5.07  # a ramp that begins here is the first ground that the laser sees
RAMPS_NOTE = (
    "9 m level, 6 m of ramp, level again, at 0.6 m/s, with a box of 0.3 m on the ramp and "
    "one beyond it. Met at once: the ramp begins after 5 m, so that the first ground that "
    "the laser sees at all lies on it."
)


def ramps(angle_deg: float, quick: bool, folder: Path) -> Outcome:
    """7: over a ramp of an angle, up where it is positive; a box on it and one beyond."""
    word = f"{abs(angle_deg):g} deg {'up' if angle_deg > 0 else 'down'}"
    return _ramp(angle_deg, RAMP_AT_M, word, quick, folder)


def ramp_at_once(quick: bool, folder: Path) -> Outcome:
    return _ramp(4.0, AT_ONCE_M, "4 deg up, met at once", quick, folder)


def _ramp(angle_deg: float, at_m: float, word: str, quick: bool, folder: Path) -> Outcome:
    rise_rad = math.radians(angle_deg)
    long_m = 3.0 if quick else RAMP_LONG_M
    end_m = at_m + long_m
    solids: list[Shape] = list(ramp_corridor(at_m, long_m, rise_rad, end_m + 12.07))
    for k, x in enumerate((at_m + 1.5, end_m + 3.0)):
        ground_m = math.tan(rise_rad) * min(x - at_m, long_m)
        deep_m = min(0.0, ground_m) - 0.2
        solids.append(box(f"box {k}", (x, x + 0.55), (0.83, 1.43), ground_m + 0.35, deep_m))
    way = Way(stand(LEAD_S), straight(end_m + 1.0, 1.0 if quick else 0.6))
    test = Trial(scene("ramp", solids), way, methods(quick), follows=True, x_m=(-8.0, 38.0))
    outcome = Outcome("7 ramps", RAMPS_NOTE)
    _drive(outcome, test, way.duration_s, f"{word}: ")
    if abs(angle_deg) in (4.0, 8.0):
        file = folder / f"7-ramp-{word.replace(',', '').replace(' ', '-')}.png"
        caption = f"7: after a ramp of {word}"
        outcome.draw(file, caption, test.views(*BOTH), (at_m - 4, end_m + 11), (-3, 3))
    return outcome
