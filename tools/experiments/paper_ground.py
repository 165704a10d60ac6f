"""The paper's sections 5.3 and 5.5: down a ramp of 1 degree, and standing on objects."""

import math
from pathlib import Path

from fakes.world.trajectory import Way, stand, straight, tilted
from tools.experiments import metrics
from tools.experiments.report import Outcome
from tools.experiments.scenes import corridor, ramp_corridor, scene
from tools.experiments.trial import BOTH, LEAD_S, UNCOMPENSATED, Tally, Trial, methods

RAMP_AT_M, RAMP_LONG_M = 9.07, 7.0
CASTERS_M = 0.40  # ahead of the axle
EVERY_S = 1.0


def ramp(quick: bool, folder: Path) -> Outcome:
    speed_mps, long_m = (0.6, 3.0) if quick else (0.2, RAMP_LONG_M)
    end_m = RAMP_AT_M + long_m
    way = Way(stand(LEAD_S), straight(end_m + 2.0, speed_mps))
    place = ramp_corridor(RAMP_AT_M, long_m, math.radians(-1.0), end_m + 16.07)
    configs = methods(ground={"total_pitch_deg": 0.5, "step_pitch_deg": 0.1})
    test = Trial(scene("ramp", place), way, configs, follows=True, x_m=(-8.0, 42.0))
    phases = {phase: Tally() for phase in ("before", "on", "after")}

    def look() -> None:
        phase = _phase(test.rig.world.pose()[0], end_m)
        if phase and test.elapsed_s > LEAD_S:
            phases[phase].take(test.per_app(metrics.false_obstacles))

    on_ramp_s, x_m = LEAD_S + (RAMP_AT_M + long_m / 2) / speed_mps, RAMP_AT_M + long_m / 2
    test.run(on_ramp_s, EVERY_S, look)
    note = (
        f"Corridor, 9 m level, {long_m:.0f} m down at 1 deg, level again, at {speed_mps:g} m/s, "
        "epsilon 0.5 deg, eta 0.1 deg. Before: no wheel on the ramp yet; on: all wheels on it; "
        "after: all wheels below. Mean of one look a second."
    )
    outcome, views = Outcome("5.3 ramp of 1 deg down", note), test.views(*BOTH)
    caption = "5.3: in the middle of the ramp of 1 degree, down"
    outcome.draw(folder / "5.3-ramp.png", caption, views, (x_m - 9, x_m + 11), (-3, 3))
    test.run(way.duration_s - on_ramp_s, EVERY_S, look)
    for phase, tally in phases.items():
        outcome.tell(f"false obstacle cells {phase} the ramp, mean", tally.mean(), digits=1)
    outcome.tell("obstacle cells missed, at the end", test.missed(), digits=0)
    return outcome


def _phase(x_m: float, end_m: float) -> str:
    """Where the robot is by its axle's x: "" where only some of its wheels are on the ramp."""
    if x_m + CASTERS_M < RAMP_AT_M:
        return "before"
    if x_m > RAMP_AT_M and x_m + CASTERS_M < end_m:
        return "on"
    return "after" if x_m > end_m else ""


STANCES = (  # pitch, roll (right side down positive), height of the axle's foot
    ("pitch -4.5 deg", -4.5, 0.0, 0.0),
    ("pitch +2.5 deg", 2.5, 0.0, CASTERS_M * math.sin(math.radians(2.5))),
    ("roll -5.2 deg", 0.0, -5.2, 0.25 * math.sin(math.radians(5.2))),
)


def standing_on_objects(quick: bool, folder: Path) -> Outcome:
    outcome = Outcome(
        "5.5 standing on objects",
        "Corridor of 4.1 m; 2 m at 0.5 m/s, then the robot is tilted within 2 s, both maps are "
        "erased, and it stands so for 5 s: what counts is what is seen then. No ground change "
        "(epsilon 45 deg). Uncompensated: the paper's method without its step 6, on the same "
        "bytes; height errors: rms over floor cells.",
    )
    for name, pitch_deg, roll_deg, z_m in STANCES[: 1 if quick else 3]:
        base = Way(stand(LEAD_S), straight(2.0, 0.5))
        motion = tilted(
            base, math.radians(pitch_deg), math.radians(roll_deg), z_m, base.duration_s + 1.0, 2.0
        )
        configs = methods(ground={"total_pitch_deg": 45.0})
        configs[UNCOMPENSATED] = configs["reference_plane"]
        test = Trial(scene("corridor", corridor(24.37)), motion, configs)
        test.run(base.duration_s + 4.0)
        for app in test.apps.values():
            app.mapper.erase()
        test.run(5.0)
        _measure_stance(name, test, outcome)
        file = folder / f"5.5-{name.split()[0]}-{abs(pitch_deg + roll_deg):g}.png"
        views = test.views(UNCOMPENSATED, *BOTH)
        outcome.draw(file, f"5.5: standing at {name}", views, (1, 21), (-3, 3))
    return outcome


def _measure_stance(name: str, test: Trial, outcome: Outcome) -> None:
    false = test.per_app(metrics.false_obstacles)
    error = test.per_app(lambda view, cells: 100.0 * metrics.floor_error_m(view, cells))
    for words, figures, digits in (
        ("false obstacle cells", false, 0),
        ("floor height error, cm", error, 1),
    ):
        bare = {"reference_plane": figures[UNCOMPENSATED]}
        outcome.tell(f"{name}, not compensated: {words}", bare, digits=digits)
        outcome.tell(f"{name}, compensated: {words}", figures, digits=digits)
