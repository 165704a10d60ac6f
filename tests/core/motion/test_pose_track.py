"""A body without wheels: its place by external poses alone, at any rate, and when they fail."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.geometry import wrapped
from core.motion.attitude import AttitudeRing
from core.motion.pose_track import EXTRAPOLATED_S, LOST_S, PoseTrack
from core.records import F64, Attitude, ExternalPose

RAD = math.radians
SIGMA_M, SIGMA_Z_M, SIGMA_RAD = 0.02, 0.01, RAD(0.5)
FAR_M, TURN_RAD = np.array([1000.0, -2000.0, 300.0]), 0.7  # where the system's frame lies
YAW_START_RAD = 0.3  # of the sensor
HZ = 100


@dataclass(slots=True)
class Walker:
    """Walks ahead, sideways and uphill, and turns; a positioning system sees it `rate_hz` times.

    The first pose is exact, so that the map's frame is that of the truth.
    """

    rate_hz: int
    seed: int = 1
    late_s: float = 0.0  # how long poses take
    told: Callable[[float], bool] = lambda t_s: True
    jump_m: Callable[[float], float] = lambda t_s: 0.0
    slope: float = 0.05  # of the ground along map x
    has_yaw: bool = True
    has_z: bool = True
    sigma_m: float = SIGMA_M  # as it tells
    sigma_rad: float = SIGMA_RAD
    first_off_rad: float = 0.0  # error of the yaw of the first pose
    lean_rad: float | None = None  # by which the roll and pitch that are told are off
    k: int = 0
    worst_m: float = 0.0  # of what was told of a place: x, y,
    worst_z_m: float = 0.0  # and z
    ring: AttitudeRing = field(default_factory=lambda: AttitudeRing(0, 0, 0))
    track: PoseTrack = field(init=False)
    random: np.random.Generator = field(init=False)
    _late: list[tuple[float, ExternalPose]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.track, self.random = PoseTrack(self.ring), np.random.default_rng(self.seed)

    @property
    def t_s(self) -> float:
        return self.k / HZ

    def truth(self) -> tuple[F64, float]:
        """Place (3,) and yaw in the map."""
        begun_s = max(0.0, self.t_s - 1.0)
        x_m = 0.5 * (begun_s - 1.0 + math.exp(-begun_s)) + 0.1 * (1.0 - math.cos(0.8 * begun_s))
        y_m = 0.2 * (1.0 - math.cos(0.5 * begun_s))
        return np.array([x_m, y_m, self.slope * x_m]), 0.4 * math.sin(0.3 * begun_s)

    def walk(self, seconds: float) -> "Walker":
        for _ in range(round(seconds * HZ)):
            self._tell_attitude()
            if self.k % (HZ // self.rate_hz) == 0 and self.told(self.t_s):
                self._late.append((self.t_s + self.late_s, self.pose()))
            while self._late and self._late[0][0] <= self.t_s + 1e-9:
                self.track.add_external(self._late.pop(0)[1])
            self.track.settle()
            self._compare()
            self.k += 1
        return self

    def _pitch_rad(self) -> float:
        """It stands on the slope, whose steepest way is map x; small angles."""
        return -math.atan(self.slope * math.cos(self.truth()[1]))

    def _roll_rad(self) -> float:
        return math.atan(-self.slope * math.sin(self.truth()[1]))

    def _tell_attitude(self) -> None:
        _, yaw = self.truth()
        rate = 0.12 * math.cos(0.3 * max(0.0, self.t_s - 1.0)) * (self.t_s > 1.0)
        half = 0.5 * np.array([self._roll_rad(), self._pitch_rad(), YAW_START_RAD + yaw])
        (cr, cp, cy), (sr, sp, sy) = np.cos(half), np.sin(half)
        q = (
            *(cr * cp * cy + sr * sp * sy, sr * cp * cy - cr * sp * sy),
            *(cr * sp * cy + sr * cp * sy, cr * cp * sy - sr * sp * cy),
        )
        w, x, y, z = (float(part) for part in q)
        self.ring.add(Attitude(self.t_s, (w, x, y, z), (0.0, 0.0, rate)))

    def pose(self) -> ExternalPose:
        (x_m, y_m, z_m), yaw = self.truth()
        noise = self.random.standard_normal(4) * self.track.started
        x_m += SIGMA_M * noise[0] + self.jump_m(self.t_s)
        y_m += SIGMA_M * noise[1]
        c, s = math.cos(TURN_RAD), math.sin(TURN_RAD)
        yaw += 0.0 if self.track.started else self.first_off_rad
        tilt = (math.nan, math.nan)
        if self.lean_rad is not None:
            tilt = (self._pitch_rad() + self.lean_rad, self._roll_rad())
        return ExternalPose(
            self.t_s,
            float(FAR_M[0] + c * x_m - s * y_m),
            float(FAR_M[1] + s * x_m + c * y_m),
            wrapped(yaw + TURN_RAD + SIGMA_RAD * noise[2]) if self.has_yaw else math.nan,
            self.sigma_m**2, 0.0, self.sigma_m**2, self.sigma_rad**2,
            float(FAR_M[2] + z_m + SIGMA_Z_M * noise[3]) if self.has_z else math.nan,
            SIGMA_Z_M**2, *tilt, RAD(0.2),
        )  # fmt: skip

    def _compare(self) -> None:
        if self.t_s < 2.0 or not self.track.covers(self.t_s, self.t_s):
            return
        place_m = np.array(self.track.place_at(self.t_s)[:3])
        off_m = place_m - self.truth()[0]
        self.worst_m = max(self.worst_m, float(np.hypot(*off_m[:2])))
        self.worst_z_m = max(self.worst_z_m, abs(float(off_m[2])))

    @property
    def is_known(self) -> bool:
        return self.track.maybe_pose(self.t_s) is not None


@pytest.mark.parametrize(
    ("rate_hz", "late_s", "most_m"),
    [(5, 0.0, 0.12), (5, 0.15, 0.16), (20, 0.05, 0.08), (50, 0.0, 0.06)],
)
def test_place_height_and_heading_are_right_between_noisy_poses(
    rate_hz: int, late_s: float, most_m: float
) -> None:
    walker = Walker(rate_hz, late_s=late_s).walk(30)
    assert walker.is_known
    assert walker.track.breaks == 0
    assert walker.track.outliers <= 0.005 * 30 * rate_hz, "the gates leave out 3 in 1000 by chance"
    assert walker.worst_m < most_m
    assert walker.worst_z_m < 0.05
    pose = walker.track.maybe_pose(walker.t_s)
    assert pose is not None
    assert abs(wrapped(pose.yaw_rad - walker.truth()[1])) < RAD(1.2)
    assert walker.track.v_mps == pytest.approx(0.5, abs=0.15)
    spread = walker.track.covariance
    assert 0.0 < spread[0, 0] < SIGMA_M**2 + 1e-6


def test_without_heights_the_height_follows_the_way_and_the_tilt() -> None:
    walker = Walker(10, has_z=False).walk(30)
    assert walker.truth()[0][2] > 0.7
    assert walker.worst_z_m < 0.03


def test_one_pose_that_is_off_is_left_out() -> None:
    walker = Walker(10, jump_m=lambda t_s: 0.4 if 5.05 < t_s < 5.15 else 0.0).walk(10)
    assert (walker.track.outliers, walker.track.breaks) == (1, 0)
    assert walker.worst_m < 0.13


@pytest.mark.parametrize("rate_hz", [5, 50])
def test_poses_that_jump_and_stay_there_end_what_is_known_and_then_begin_a_new_map(
    rate_hz: int,
) -> None:
    walker = Walker(rate_hz, jump_m=lambda t_s: 1.0 if t_s >= 5.0 else 0.0).walk(5.0)
    walker.walk(EXTRAPOLATED_S + 0.02)
    assert not walker.is_known
    assert walker.worst_m < 0.13
    walker.walk(1.0)
    assert walker.is_known
    assert (walker.track.breaks, walker.track.broken_by[:22]) == (1, "the positioning system")


def test_poses_from_where_no_frame_can_tell_a_place_are_not_believed() -> None:
    walker = Walker(50, jump_m=lambda t_s: 4e6 if t_s >= 5.0 else 0.0).walk(8.0)
    assert (walker.is_known, walker.track.breaks) == (False, 0)


@pytest.mark.parametrize(("away_s", "breaks"), [(LOST_S - 0.5, 0), (LOST_S + 0.5, 1)])
def test_poses_that_stay_away_are_not_replaced_by_a_guess(away_s: float, breaks: int) -> None:
    walker = Walker(10, told=lambda t_s: not 5.0 <= t_s < 5.0 + away_s).walk(5.0)
    newest_s = walker.track.newest_s
    walker.walk(EXTRAPOLATED_S + 0.02)
    assert not walker.is_known
    walker.walk(away_s)
    assert walker.is_known
    assert walker.track.breaks == breaks
    assert not walker.track.covers(newest_s + 0.1, newest_s + 0.2), "nobody knows its way meanwhile"
    assert walker.worst_m < 0.13


def test_after_a_pause_the_place_goes_on_as_fast_as_the_body_does() -> None:
    """Poses that come seldom show worst how fast it is taken to go on between them."""
    walker = Walker(5, told=lambda t_s: t_s < 5.0 or (round(5 * t_s) % 3 == 0)).walk(5.0)
    walker.worst_m = 0.0
    walker.walk(10.0)
    assert walker.track.breaks == 0
    assert walker.worst_m < 0.16


def test_how_fast_it_goes_is_not_known_by_one_pose_and_so_is_no_place_behind_it() -> None:
    walker = Walker(5, k=390).walk(0.29)
    assert walker.track.started
    assert not walker.is_known
    walker.walk(0.21)
    assert walker.is_known


def test_the_heading_follows_the_frame_of_the_places_though_the_first_yaw_was_off() -> None:
    """Else body and beams point elsewhere than the places go, for as long as a compass agrees."""
    off_rad = RAD(3.5)
    walker = Walker(5, sigma_rad=RAD(1.5), first_off_rad=off_rad).walk(3)
    pose = walker.track.maybe_pose(walker.t_s)
    assert pose is not None
    assert wrapped(pose.yaw_rad - walker.truth()[1]) == pytest.approx(-off_rad, abs=RAD(1.0))


@pytest.mark.parametrize(("sigma_m", "sigma_rad"), [(0.6, SIGMA_RAD), (SIGMA_M, RAD(30))])
def test_a_system_that_is_too_vague_tells_no_place(sigma_m: float, sigma_rad: float) -> None:
    walker = Walker(5, sigma_m=sigma_m, sigma_rad=sigma_rad).walk(4)
    assert walker.track.started
    assert not walker.is_known


def test_poses_that_come_too_late_leave_the_place_unknown() -> None:
    walker = Walker(10, late_s=0.6).walk(8)
    assert walker.track.started
    assert not walker.is_known


def test_nothing_is_known_before_a_pose_with_a_yaw_and_heights_are_all_or_none() -> None:
    walker = Walker(10, has_yaw=False).walk(1)
    assert not walker.track.started
    walker.has_yaw = True
    walker.walk(1)
    outliers = walker.track.outliers
    walker.has_yaw = False
    walker.walk(3)
    assert (walker.is_known, walker.track.outliers) == (True, outliers)
    walker.has_z = False
    walker.walk(EXTRAPOLATED_S + 0.1)
    assert not walker.is_known


@pytest.mark.parametrize(("lean_deg", "fits"), [(2.0, True), (10.0, False)])
def test_a_system_that_sees_another_tilt_than_the_sensor_is_not_believed(
    lean_deg: float, fits: bool
) -> None:
    assert Walker(10, lean_rad=RAD(lean_deg)).walk(4).is_known is fits


def test_an_older_pose_and_one_that_cant_be_are_refused() -> None:
    walker = Walker(10).walk(1)
    newest = walker.pose()
    assert walker.track.add_external(newest)
    assert not walker.track.add_external(newest)
    assert walker.track.outliers == 1
    walker.k += 10
    half_a_turn = {"yaw_rad": 0.0, "var_yaw_rad2": 3.2**2}  # no error is larger
    wrongs = ({"z_m": math.inf}, {"var_z_m2": -1.0}, {"roll_rad": 4.0, "pitch_rad": 0.0})
    for wrong in (*wrongs, half_a_turn):
        told = {name: getattr(walker.pose(), name) for name in ExternalPose.__struct_fields__}
        assert not walker.track.add_external(ExternalPose(**{**told, **wrong}))
    assert walker.track.outliers == 5


def test_a_map_that_goes_on_begins_where_the_body_stands_in_it() -> None:
    walker = Walker(10)
    walker.track.start_at(np.array([3.0, 4.0, 0.5]), 1.0, 7.0)
    walker.walk(0.9)
    assert walker.track.place_at(0.8) == pytest.approx((3.0, 4.0, 0.5, 7.0), abs=0.1)
    pose = walker.track.maybe_pose(0.85)
    assert pose is not None
    assert pose.yaw_rad == pytest.approx(1.0, abs=RAD(1.5))


NUMBER = st.floats() | st.floats(-3, 3)
TIME = st.floats(0, 3)


@given(poses=st.lists(st.builds(ExternalPose, *[TIME] + 12 * [NUMBER]), max_size=30))
def test_no_pose_makes_it_raise_or_tell_what_is_no_number(poses: list[ExternalPose]) -> None:
    walker = Walker(1, told=lambda t_s: False)
    for pose in sorted(poses, key=lambda one: one.t_s):
        while walker.t_s <= pose.t_s + 0.02:
            walker.walk(1 / HZ)
        walker.track.add_external(pose)
        walker.track.settle()
        told = walker.track.maybe_pose(walker.t_s)
        assert told is None or all(map(math.isfinite, (told.x_m, told.y_m, told.yaw_rad)))
