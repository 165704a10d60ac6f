"""Beyond the paper: what the floor lacks. Ditches, and kerbs up and down, across the way."""

from pathlib import Path

from fakes.scenes.scene import Solid
from fakes.world.trajectory import Way, stand, straight
from tools.experiments import metrics
from tools.experiments.report import Outcome
from tools.experiments.scenes import gap_in_floor, scene, step_in_floor
from tools.experiments.trial import BOTH, LEAD_S, BarWatch, Tally, Trial, methods

EVERY_S = 0.2
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


def _approach(
    solids: list[Solid], span_m: tuple[float, float], quick: bool
) -> tuple[Trial, BarWatch, Tally]:
    """Towards something across the way, up to 3 m before it."""
    way = Way(stand(LEAD_S), straight(*((6.0, 1.0) if quick else (8.5, 0.5))))
    floors = ((0.0, 0.0), (span_m[1] + 1.0, 0.0)) if span_m[1] - span_m[0] > 0.1 else ((0.0, 0.0),)
    test = Trial(scene("edge", solids), way, methods(quick), floors_m=floors, x_m=(-8.0, 30.0))
    watch, false = BarWatch(test, span_m), Tally()

    def look() -> None:
        watch.look()
        false.take(test.per_app(metrics.false_obstacles))

    test.run(way.duration_s, EVERY_S, look)
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
