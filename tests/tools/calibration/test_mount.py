"""The mount calibration on made-up floors, where the truth is known."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.geometry import R_from_rpy, q_from_R
from core.motion.attitude import AttitudeRing
from core.records import F64, Attitude, Scan
from tests.support.cases import examples
from tools.calibration.fit import FloorView, Mount
from tools.calibration.mount import Calibration, FloorWatch, NoFloorError, calibrate

RAD = math.radians
BEARINGS = np.radians(np.arange(-60.0, 60.01, 0.5))
SWEEP_S, SCAN_S = 0.0133, 0.04
TRUE = Mount(0.25, 0.0, 1.08, RAD(0.4), RAD(8.2), 0.0)
GUESS = Mount(0.25, 0.0, 1.08, 0.0, RAD(7.5), 0.0)
LEVEL = RAD(0.1)
BY_TAPE = 0.005
Pose = Callable[[float], tuple[float, float, float]]


def still(t_s: float) -> tuple[float, float, float]:
    """Roll, pitch, yaw of a robot that stands."""
    return 0.0, 0.0, 3.0


def turning(t_s: float) -> tuple[float, float, float]:
    """On the spot, through the step of yaw at half a turn."""
    return 0.0, 0.0, math.remainder(3.0 + 1.2 * t_s, math.tau)


def nodding(t_s: float) -> tuple[float, float, float]:
    """Its casters on a plank for the second half."""
    return 0.0, RAD(4.0) * (t_s > 1.6), 3.0


def rates(pose: Pose, t_s: float) -> tuple[float, float, float]:
    """Rate of turn about the body's axes; a step of the pose is none."""
    d = 1e-6
    W = R_from_rpy(*pose(t_s)).T @ R_from_rpy(*pose(t_s + d)) / d
    return float(W[2, 1]), float(W[0, 2]), float(W[1, 0])


@dataclass(frozen=True)
class Place:
    """A floor through the robot's feet, with upright walls at (bearing of the normal, distance)."""

    slope: tuple[float, float] = (0.0, 0.0)  # rise along the earth's x and y
    walls: tuple[tuple[float, float], ...] = ()
    kerb: tuple[float, float] = (99.0, 0.0)  # from so far away the floor lies so much higher
    clutter: float = 0.0  # share of returns from anything nearer
    bias_m: float = 0.0  # of all ranges
    attitude_noise_rad: float = RAD(0.05)
    attitude_offset_rad: float = 0.0  # in pitch, which the sensor tells too small

    def view(self, mount: Mount, pose: Pose, scans: int = 80, seed: int = 1) -> FloorView:
        return self.watch(mount, pose, scans, seed).view()

    def watch(self, mount: Mount, pose: Pose, scans: int, seed: int) -> FloorWatch:
        """The same, as scans that were taken one by one."""
        random = np.random.default_rng(seed)
        watch, ring, told_s = FloorWatch(), AttitudeRing(0.0, 0.0, 0.0), 0.0
        wave_m = random.normal(0.0, 0.003, len(BEARINGS))
        for k in range(scans):
            while told_s < k * SCAN_S + 0.05:
                rate_radps = rates(pose, told_s)
                R = R_from_rpy(*pose(told_s)) @ R_from_rpy(0.0, -self.attitude_offset_rad, 0.0)
                R = R @ R_from_rpy(*random.normal(0.0, self.attitude_noise_rad, 3))
                w, x, y, z = q_from_R(R)
                ring.add(Attitude(told_s, (w, x, y, z), rate_radps))
                told_s += 0.01
            t_s = k * SCAN_S
            ranges_m = self._ranges_m(mount, pose(t_s + SWEEP_S / 2), wave_m, random)
            step = float(BEARINGS[1] - BEARINGS[0])
            dt_s = SWEEP_S / (len(BEARINGS) - 1)
            scan = Scan(t_s, dt_s, float(BEARINGS[0]), step, ranges_m[None], k, t_s + 0.02)
            watch.add(scan, ring)
        return watch

    def _ranges_m(
        self,
        mount: Mount,
        rpy: tuple[float, float, float],
        wave_m: F64,
        random: np.random.Generator,
    ) -> F64:
        R = R_from_rpy(*rpy)
        unit = np.column_stack([np.cos(BEARINGS), np.sin(BEARINGS), np.zeros_like(BEARINGS)])
        rays, lens = unit @ (R @ mount.R_body_sensor).T, R @ mount.t_body_sensor
        ground = np.hypot(rays[:, 0], rays[:, 1])
        normal = np.array([-self.slope[0], -self.slope[1], 1.0])
        with np.errstate(divide="ignore"):
            ranges_m = (wave_m - normal @ lens) / (rays @ normal)
            higher_m = (self.kerb[1] - normal @ lens) / (rays @ normal)
            ranges_m = np.where(ground * ranges_m > self.kerb[0], higher_m, ranges_m)
            ranges_m[ranges_m < 0] = np.inf
            for bearing, distance_m in self.walls:
                across = np.array([math.cos(bearing), math.sin(bearing), 0.0])
                wall_m = (distance_m - across @ lens) / (rays @ across)
                ranges_m = np.where(wall_m > 0, np.minimum(ranges_m, wall_m), ranges_m)
        hidden = random.random(len(ranges_m)) < self.clutter
        ranges_m[hidden] = np.minimum(ranges_m, random.uniform(1.0, 8.0, len(ranges_m)))[hidden]
        ranges_m += self.bias_m + random.normal(0.0, 0.012, len(ranges_m))
        return np.asarray(np.where(ranges_m > 25.0, np.nan, ranges_m))


def off(found: Calibration, true: Mount = TRUE) -> tuple[float, float, float]:
    """Errors of height, tilt and roll, each as a multiple of the error that is told."""
    return (
        (found.mount.z_m - true.z_m) / found.z_error_m,
        (found.mount.tilt_rad - true.tilt_rad) / found.tilt_error_rad,
        (found.mount.roll_rad - true.roll_rad) / found.roll_error_rad,
    )


def test_a_standing_robot_of_known_height_finds_tilt_and_roll() -> None:
    found = calibrate(Place().view(TRUE, still), GUESS, BY_TAPE, LEVEL)
    assert found.z_is_separate
    assert found.mount.tilt_rad == pytest.approx(TRUE.tilt_rad, abs=RAD(0.02))
    assert found.mount.roll_rad == pytest.approx(TRUE.roll_rad, abs=RAD(0.02))
    assert found.z_error_m == pytest.approx(BY_TAPE)
    # what the floor's slope and the tape leave open, however many the returns are
    least_rad = math.hypot(LEVEL, BY_TAPE / 1.08 * math.tan(TRUE.tilt_rad))
    assert least_rad < found.tilt_error_rad < 1.2 * least_rad
    assert found.ahead_m == pytest.approx(1.08 / math.tan(TRUE.tilt_rad), rel=0.003)
    assert found.rms_m < 0.012
    assert found.rms_m < found.within_m < 0.025


def test_height_and_tilt_are_not_told_apart_by_one_attitude() -> None:
    lower = replace(TRUE, z_m=1.00)
    found = calibrate(Place().view(lower, still), GUESS, None, LEVEL)
    assert not found.z_is_separate
    assert found.z_error_m > 0.3
    assert found.tilt_error_rad > RAD(2.0)
    ratio = found.mount.z_m / math.sin(found.mount.tilt_rad)  # this alone is seen
    assert ratio == pytest.approx(lower.z_m / math.sin(lower.tilt_rad), rel=0.003)


def test_noise_of_the_attitude_does_not_pass_for_motion_and_a_small_nod_tells_no_height() -> None:
    def bumps(t_s: float) -> tuple[float, float, float]:
        return 0.0, RAD(0.5) * math.sin(6.0 * t_s), 0.0

    found = calibrate(Place(attitude_noise_rad=RAD(0.15)).view(TRUE, still), GUESS, None, LEVEL)
    assert not found.z_is_separate
    assert found.motion_rad < RAD(0.1)
    assert not found.is_proven
    assert not calibrate(Place().view(TRUE, bumps), GUESS, None, LEVEL).z_is_separate


def test_a_nod_of_some_degrees_tells_height_and_tilt_and_refuses_another_height() -> None:
    higher = replace(TRUE, z_m=1.17)
    found = calibrate(Place(bias_m=0.02).view(higher, nodding), GUESS, None, LEVEL)
    assert found.z_is_separate
    assert found.is_proven
    assert found.mount.z_m == pytest.approx(1.17, abs=0.015)
    assert max(map(abs, off(found, higher))) < 2.0
    assert 0.01 < found.z_error_m < 0.05
    view = Place().view(TRUE, nodding)
    assert calibrate(view, GUESS, BY_TAPE, LEVEL).z_error_m == pytest.approx(BY_TAPE)
    with pytest.raises(NoFloorError, match=r"measured as 1\.25 m, but .* says 1\.0\d"):
        calibrate(view, replace(GUESS, z_m=1.25), BY_TAPE, LEVEL)


def test_turning_tells_the_slope_of_the_floor_and_makes_the_tilt_surer() -> None:
    rise = RAD(0.5)

    def on_the_slope(t_s: float) -> tuple[float, float, float]:
        roll, pitch, yaw = turning(t_s)
        return roll - rise * math.sin(yaw), pitch - rise * math.cos(yaw), yaw

    place = Place(slope=(rise, 0.0))
    found = calibrate(place.view(TRUE, on_the_slope, 130), GUESS, BY_TAPE, LEVEL)
    assert found.slope_rad == pytest.approx(rise, rel=0.1)
    assert found.mount.tilt_rad == pytest.approx(TRUE.tilt_rad, abs=RAD(0.02))
    assert found.tilt_error_rad < RAD(0.06)
    assert found.turned_rad > RAD(200)
    assert found.is_proven
    assert not calibrate(place.view(TRUE, on_the_slope, 130), GUESS, None, LEVEL).z_is_separate
    place = Place(attitude_offset_rad=RAD(0.6))  # of that sensor's mount: the tilt makes it good
    found = calibrate(place.view(TRUE, turning), GUESS, BY_TAPE, LEVEL)
    assert found.mount.tilt_rad == pytest.approx(TRUE.tilt_rad + RAD(0.6), abs=RAD(0.03))


def test_the_errors_that_are_told_are_those_that_are_made() -> None:
    made = []
    for seed in range(8):
        random = np.random.default_rng(seed)
        slope = random.normal(0.0, LEVEL, 2)
        lean = -slope[0], slope[1]

        def on_it(
            t_s: float, pitch: float = float(lean[0]), roll: float = float(lean[1])
        ) -> tuple[float, float, float]:
            return roll, pitch, 0.0

        place = Place((float(slope[0]), float(slope[1])), bias_m=float(random.normal(0, 0.017)))
        true = replace(TRUE, z_m=1.08 + float(random.normal(0.0, 0.01)))
        made.append(off(calibrate(place.view(true, on_it, 40, seed), GUESS, 0.01, LEVEL), true))
    rms = np.sqrt(np.mean(np.square(made), axis=0))
    assert (rms > 0.4).all()
    assert (rms < 1.5).all()


def test_walls_and_clutter_do_not_disturb() -> None:
    corridor = Place(walls=((math.pi / 2 + 3.0, 2.0), (3.0 - math.pi / 2, 2.0)), clutter=0.1)
    found = calibrate(corridor.view(TRUE, still), GUESS, BY_TAPE, LEVEL)
    assert 0.12 < found.floor_returns / found.returns < 0.3
    assert found.mount.tilt_rad == pytest.approx(TRUE.tilt_rad, abs=RAD(0.05))
    assert found.mount.roll_rad == pytest.approx(TRUE.roll_rad, abs=RAD(0.1))


def test_a_wall_that_hides_the_floor_is_no_proof_whether_the_robot_stands_or_nods() -> None:
    wall = Place(walls=((3.0, 6.0),))
    found = calibrate(wall.view(TRUE, still), GUESS, BY_TAPE, LEVEL)
    assert found.mount.tilt_rad > RAD(10.0)  # no scan can tell it from a floor
    assert not found.is_proven
    view = wall.view(TRUE, nodding, 130)
    try:
        found = calibrate(view, GUESS, None, LEVEL)
    except NoFloorError:
        return  # as good
    assert not found.is_proven
    assert not found.z_is_separate


def test_too_few_scans_and_no_returns_are_refused() -> None:
    with pytest.raises(NoFloorError, match="in 10 scans"):
        calibrate(Place().view(TRUE, still, 10), GUESS, None, LEVEL)
    with pytest.raises(NoFloorError, match="only 0 returns"):
        calibrate(FloorWatch().view(), GUESS, None, LEVEL)


ALL_AROUND = tuple((3.0 + k * math.pi / 2, 5.0) for k in range(4))


@pytest.mark.parametrize(
    ("place", "tilt_deg", "pose", "why"),
    [
        (Place(), -10.0, still, "does the scanner look at the floor"),
        (Place(), 25.0, still, "lie on one level floor"),  # far from the settings
        (Place(walls=ALL_AROUND), 8.2, turning, "."),
        (Place(kerb=(7.0, 0.06)), 8.2, nodding, "scans do not show|not flat|robot nodded says"),
        (Place(attitude_noise_rad=RAD(0.6)), 8.2, still, "not steady"),
    ],
    ids=["up", "far", "walls", "kerb", "jumps"],
)
def test_what_is_no_flat_floor_is_refused(
    place: Place, tilt_deg: float, pose: Pose, why: str
) -> None:
    view = place.view(replace(TRUE, tilt_rad=RAD(tilt_deg)), pose)
    with pytest.raises(NoFloorError, match=why):
        calibrate(view, GUESS, BY_TAPE, LEVEL)


def test_more_returns_than_are_worked_with_are_left_out_evenly() -> None:
    watch = Place().watch(TRUE, still, 400, 1)
    view = watch.view()
    assert watch.scans == 400
    assert 20_000 < len(view.t_s) <= 60_000
    assert np.bincount(view.scan).min() > 0
    assert len(np.unique(view.rays_m[:, 1] > 0)) == 2


def test_a_mount_that_is_turned_and_upside_down_is_found_as_well() -> None:
    mount = Mount(-0.1, -0.2, 0.8, RAD(179.0), RAD(6.0), RAD(-30.0))
    guess = replace(mount, roll_rad=mount.roll_rad - RAD(1.0), tilt_rad=mount.tilt_rad + RAD(1.5))
    found = calibrate(Place().view(mount, turning), guess, BY_TAPE, LEVEL)
    turned = found.mount.R_body_sensor.T @ mount.R_body_sensor
    assert np.abs(turned - np.eye(3)).max() < RAD(0.05)


@settings(max_examples=examples(6), deadline=None, derandomize=True)
@given(
    st.floats(0.3, 2.0),
    st.floats(6.0, 40.0),
    st.floats(-5.0, 5.0),
    st.floats(-4.0, 4.0),
    st.integers(0, 99),
)
def test_any_reasonable_mount_is_found(
    z_m: float, tilt_deg: float, roll_deg: float, off_deg: float, seed: int
) -> None:
    tilt_deg = max(tilt_deg, math.degrees(math.asin(z_m / 14.0)))  # within the scanner's reach
    true = Mount(0.2, 0.0, z_m, RAD(roll_deg), RAD(tilt_deg), 0.0)
    guess = replace(true, tilt_rad=RAD(tilt_deg + off_deg), roll_rad=RAD(roll_deg - off_deg))
    found = calibrate(Place().view(true, still, 40, seed), guess, BY_TAPE, LEVEL)
    assert max(map(abs, off(found, true))) < 3.0
    assert found.tilt_error_rad < RAD(1.0)
