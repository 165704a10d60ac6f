"""Beyond the paper: uneven ground. Bumps, a nodding robot, ramps of 1 to 8 deg, ditches, kerbs."""

import math
from collections.abc import Sequence
from pathlib import Path

from fakes.scenes.scene import Scene, Solid
from fakes.scenes.solids import Shape, bump
from fakes.world.trajectory import Way, nodding, stand, straight
from tools.experiments import metrics
from tools.experiments.report import Outcome
from tools.experiments.scenes import (
    COMPASS_RAD,
    box,
    corridor,
    gap_in_floor,
    ramp_corridor,
    scene,
    step_in_floor,
)
from tools.experiments.trial import BOTH, LEAD_S, BarWatch, Tally, Trial, methods

EVERY_S = 0.5
LANE_Y = (-2.07, 2.05)
ANGLES_DEG = (1.0, 2.0, 4.0, 6.0, 8.0)
RAMP_AT_M, RAMP_LONG_M = 9.07, 6.0
AT_ONCE_M = 5.07  # a ramp that begins here is the first ground that the laser sees
RAMPS_NOTE = (
    "9 m level, 6 m of ramp, level again, at 0.6 m/s, with a box of 0.3 m on the ramp and "
    "one beyond it. Met at once: the ramp begins after 5 m, so that the first ground that "
    "the laser sees at all lies on it."
)
APPROACH_EVERY_S = 0.2
AT_M = 12.07
WIDE_M, LENGTH_M = 4.12, 26.37
DITCHES_M = (0.3, 0.6, 1.5)
DEEP_M = 0.5
KERBS_M = (0.08, 0.12, 0.20, -0.08, -0.12, -0.20)
BOUND_M = 0.10
DITCHES_NOTE = (
    "Corridor with a ditch across it, 0.5 m deep, at 0.5 m/s from 12 m to 3.5 m before it. "
    "It bars the way when each line of cells of the robot's width has an obstacle cell in "
    "it or within two cells of it; told is the way from the robot's front to the ditch "
    "from which on it did so for good."
)
KERBS_NOTE = (
    "As the ditches; steps of 8 cm are below the bound of 10 cm and no obstacle. Missed "
    "are cells of steps of 15 cm and more."
)


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
    test = Trial(place, way, methods(), follows=True, x_m=(-8.0, 34.0))
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
    test = Trial(place, motion, methods(), x_m=(-8.0, 34.0))
    note = "Corridor with two boxes of 0.3 m, 9 m at 0.6 m/s."
    outcome = Outcome("7 pitching +-3 deg, 1 Hz", note)
    _drive(outcome, test, base.duration_s)
    caption = "7: after 9 m with the body pitching by 3 degrees at 1 Hz"
    outcome.draw(folder / "7-pitching.png", caption, test.views(*BOTH), (-1, 22), (-3, 3))
    return outcome


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
    test = Trial(scene("ramp", solids), way, methods(), follows=True, x_m=(-8.0, 38.0))
    outcome = Outcome("7 ramps", RAMPS_NOTE)
    _drive(outcome, test, way.duration_s, f"{word}: ")
    if abs(angle_deg) in (4.0, 8.0):
        file = folder / f"7-ramp-{word.replace(',', '').replace(' ', '-')}.png"
        caption = f"7: after a ramp of {word}"
        outcome.draw(file, caption, test.views(*BOTH), (at_m - 4, end_m + 11), (-3, 3))
    return outcome


def _approach(
    solids: list[Solid], span_m: tuple[float, float], quick: bool
) -> tuple[Trial, BarWatch, Tally]:
    way = Way(stand(LEAD_S), straight(*((6.0, 1.0) if quick else (8.5, 0.5))))
    floors = ((0.0, 0.0), (span_m[1] + 1.0, 0.0)) if span_m[1] - span_m[0] > 0.1 else ((0.0, 0.0),)
    test = Trial(scene("edge", solids), way, methods(), floors_m=floors, x_m=(-8.0, 30.0))
    watch, false = BarWatch(test, span_m), Tally()

    def look() -> None:
        watch.look()
        false.take(test.per_app(metrics.false_obstacles))

    test.run(way.duration_s, APPROACH_EVERY_S, look)
    return test, watch, false


def ditch(wide_m: float, quick: bool, folder: Path) -> Outcome:
    span_m = (AT_M, AT_M + wide_m)
    test, watch, false = _approach(gap_in_floor(span_m, WIDE_M, LENGTH_M, DEEP_M), span_m, quick)
    outcome, word = Outcome("7 ditches", DITCHES_NOTE), f"{wide_m:g} m"
    outcome.tell(f"{word}: bars the way so far ahead, m (0: not)", watch.ahead_m(), "more")
    outcome.tell(f"{word}: free cells in it, in the way, most", watch.most_free, digits=0)
    outcome.tell(f"{word}: false obstacle cells, most", false.most(), digits=0)
    file, caption = f"7-ditch-{wide_m:g}.png", f"7: a ditch {wide_m:g} m wide and 0.5 m deep"
    outcome.draw(folder / file, caption, test.views(*BOTH), (2, 18), (-3, 3))
    return outcome


def kerb(height_m: float, quick: bool, folder: Path) -> Outcome:
    span_m = (AT_M, AT_M + 0.05)
    test, watch, false = _approach(step_in_floor(AT_M, height_m, WIDE_M, LENGTH_M), span_m, quick)
    word = f"{100 * abs(height_m):.0f} cm {'up' if height_m > 0 else 'down'}"
    outcome = Outcome("7 kerbs", KERBS_NOTE)
    if abs(height_m) > BOUND_M:
        outcome.tell(f"{word}: bars the way so far ahead, m (0: not)", watch.ahead_m(), "more")
        outcome.tell(f"{word}: obstacle cells missed", test.missed(), digits=0)
        file, views = folder / f"7-kerb-{word.replace(' ', '-')}.png", test.views(*BOTH)
        outcome.draw(file, f"7: a kerb of {word}", views, (2, 18), (-3, 3))
    outcome.tell(f"{word}: false obstacle cells, most", false.most(), digits=0)
    return outcome
