"""Where a robot can have rolled to while nobody counted, against motions by chance."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.motion.attitude import AttitudeRing
from core.motion.shift import GRIP_MPS2, LAG, LIFTED_RAD, Gap, Shift, maybe_shift
from tests.core.motion.test_attitude import attitude
from tests.support.cases import examples
from tests.support.robot.shipped import shipped

ROBOT = shipped().robot
STEP_S, GRAVITY_MPS2 = 0.01, 9.81
UNPOWERED_S = 0.5  # before the first counts


def turning(w_radps: float, seconds: float, pitch_rad: float = 0.0) -> AttitudeRing:
    ring = AttitudeRing(0, 0, 0)
    for k in range(math.ceil(seconds * 100) + 2):
        ring.add(attitude(0.01 * k, pitch=pitch_rad, yaw=1.0 + 0.01 * k * w_radps))
    return ring


def rolled(
    v_mps: float,
    seconds: float,
    slope_mps2: float,
    w_radps: float,
    pushes: list[float],
    off_s: float,
) -> tuple[float, float]:
    """x, y of a robot whose motors push as they like, but for the last off_s, without power.

    pushes: each for as long as the others, -1..1 of what the motors can do.
    """
    x_m = y_m = 0.0
    steps = round(seconds / STEP_S)
    for k in range(steps):
        push = pushes[k * len(pushes) // steps]
        if k * STEP_S < seconds - off_s:
            slows = push * v_mps < 0.0
            v_mps += push * (GRIP_MPS2 if slows else LAG * ROBOT.max_accel_mps2) * STEP_S
            v_mps = max(-ROBOT.max_speed_mps, min(ROBOT.max_speed_mps, v_mps))
        else:  # it brakes at least as the settings say
            least_mps2 = ROBOT.brake_mps2
            brakes = (least_mps2 + abs(push) * (GRIP_MPS2 - least_mps2)) * STEP_S
            v_mps -= math.copysign(min(abs(v_mps), brakes), v_mps)
        v_mps += slope_mps2 * STEP_S
        yaw_rad = 1.0 + w_radps * (k + 0.5) * STEP_S
        x_m, y_m = (
            x_m + v_mps * STEP_S * math.cos(yaw_rad),
            y_m + v_mps * STEP_S * math.sin(yaw_rad),
        )
    return x_m, y_m


@settings(max_examples=examples(40))
@given(
    v_mps=st.floats(-1.0, 1.0),
    slips=st.booleans(),
    seconds=st.floats(0.01, 1.1),
    w_radps=st.floats(-1.0, 1.0),
    pitch_rad=st.floats(-0.1, 0.1),
    pushes=st.lists(st.sampled_from([-1.0, -0.3, 0.0, 0.3, 1.0]), min_size=1, max_size=5),
)
def test_no_motion_that_motors_and_slope_can_make_leads_out_of_the_strip(
    v_mps: float,
    slips: bool,
    seconds: float,
    w_radps: float,
    pitch_rad: float,
    pushes: list[float],
) -> None:
    seconds += UNPOWERED_S
    ring = turning(w_radps, seconds, pitch_rad)
    told_mps = math.copysign(0.2, v_mps) if slips else v_mps
    shift = maybe_shift(
        Gap(0.0, seconds - UNPOWERED_S, seconds, told_mps, slips, 0.0), ring, 0.0, ROBOT
    )
    if shift is None:  # too long
        return
    for share in (0.0, 1.0):  # of the slope; nose down, it goes faster ahead
        slope_mps2 = share * GRAVITY_MPS2 * math.sin(pitch_rad)
        x_m, y_m = rolled(v_mps, seconds, slope_mps2, w_radps, pushes, UNPOWERED_S)
        x_m, y_m = x_m - shift.moved_m[0], y_m - shift.moved_m[1]
        c, s = shift.heading
        assert abs(c * x_m + s * y_m) <= shift.half_m
        assert abs(c * y_m - s * x_m) <= shift.aside_m
        assert math.hypot(x_m, y_m) <= shift.reach_m


@given(
    yaw_rad=st.floats(-4.0, 4.0),
    half_m=st.floats(0.0, 1.0),
    aside_m=st.floats(0.0, 0.4),
    at=st.lists(st.floats(0.001, 0.999), min_size=4, max_size=4),
)
def test_every_place_in_the_strip_is_in_a_cell_to_which_a_step_leads(
    yaw_rad: float, half_m: float, aside_m: float, at: list[float]
) -> None:
    heading = math.cos(yaw_rad), math.sin(yaw_rad)
    shift = Shift((0.0, 0.0), heading, half_m, aside_m)
    steps = {(int(i), int(j)) for i, j in shift.cells(0.2)}
    along_m, aside_m = half_m * (2 * at[0] - 1), aside_m * (2 * at[1] - 1)
    x_m = 0.2 * at[2] + heading[0] * along_m - heading[1] * aside_m
    y_m = 0.2 * at[3] + heading[1] * along_m + heading[0] * aside_m
    assert (math.floor(x_m / 0.2), math.floor(y_m / 0.2)) in steps
    most = math.ceil(shift.reach_m / 0.2) + 1
    assert all(max(abs(i), abs(j)) <= most for i, j in steps)


def test_nothing_is_known_of_a_robot_without_attitude_lifted_or_away_for_long() -> None:
    gap, level = Gap(0.1, 0.4, 0.9, 0.5, False, 0.0), turning(0.0, 1.0)
    known = maybe_shift(gap, level, 0.0, ROBOT)
    assert known is not None
    owed = maybe_shift(gap._replace(owed_m=0.1), level, 0.0, ROBOT)
    assert owed is not None
    assert owed.moved_m == pytest.approx(known.moved_m)
    assert owed.half_m == pytest.approx(known.half_m + 0.1)
    assert owed.aside_m > known.aside_m + 0.1
    ahead = known.moved_m[0] * known.heading[0] + known.moved_m[1] * known.heading[1]
    assert 0.1 < ahead < 0.4, "the middle of all ways of a robot that drove on"
    assert maybe_shift(gap._replace(to_s=2.0), level, 0.0, ROBOT) is None  # no attitude there
    for unpowered_s in (0.05, 0.95, math.inf):  # it has counted since, or nobody knows
        assert maybe_shift(gap._replace(unpowered_s=unpowered_s), level, 0.0, ROBOT) is None
    still = maybe_shift(Gap(0.1, 0.4, 7.9, 0.5, False, 0.0), turning(0.0, 8.0), 0.0, ROBOT)
    assert still is not None, "it has stood for seven seconds"
    assert still.half_m < known.half_m + 0.3
    powered = Gap(0.1, 2.4, 2.9, 0.5, False, 0.0)
    assert maybe_shift(powered, turning(0.0, 3.0), 0.0, ROBOT) is None
    assert maybe_shift(gap, turning(5.0, 1.0), 0.0, ROBOT) is None  # it has turned about
    lifted = AttitudeRing(0, 0, 0)
    for k in range(110):
        lifted.add(attitude(0.01 * k, pitch=1.2 * LIFTED_RAD * (k > 50)))
    assert maybe_shift(gap, lifted, 0.0, ROBOT) is None
