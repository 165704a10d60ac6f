"""The plausibility limit: against small steps of all it depends on, and on a robot that turns."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from core.geometry import R_from_rpy
from core.mapping.certainty.limit import Changes, Frame, frame_of, limit_m
from core.records import F64
from tests.support.cases import examples

STILL = Changes(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
SMALL = st.floats(-0.2, 0.2)
VALUES = st.fixed_dictionaries(
    {
        "r": st.floats(0.5, 5.0),
        "phi": st.floats(-1.2, 1.2),
        "x": st.floats(-3, 3),
        "y": st.floats(-3, 3),
        "d_z": SMALL,
        "yaw": st.floats(-3, 3),
        "pitch": SMALL,
        "roll": SMALL,
        "mount_x": st.floats(-0.3, 0.5),
        "mount_y": SMALL,
        "mount_z": st.floats(0.3, 1.2),
        "mount_roll": SMALL,
        "mount_tilt": st.floats(0.05, 1.0),
        "mount_yaw": SMALL,
    }
)
BY_LASER = st.builds(  # beside the lens, its plane dipping to the lens's axis
    lambda of, dip, baseline: {**of, "dip": dip, "baseline": baseline},
    VALUES,
    st.floats(0.0, 0.4),
    st.floats(0.0, 0.3),
)
Values = dict[str, float]


class Seen:
    """A reading as the map takes it, by plain products of matrices."""

    def __init__(self, of: Values) -> None:
        rpy = of["roll"], of["pitch"], of["yaw"]
        R_map_body = R_from_rpy(*rpy)
        R_body_sensor = R_from_rpy(of["mount_roll"], of["mount_tilt"], of["mount_yaw"])
        origin = np.array([of["x"], of["y"], of["d_z"]])
        mount = np.array([of["mount_x"], of["mount_y"], of["mount_z"]])
        self.R, self.lens = R_map_body @ R_body_sensor, origin + R_map_body @ mount
        dip, self.baseline_m = of.get("dip", 0.0), of.get("baseline", 0.0)
        self.ahead: F64 = self.R @ np.array([1.0, 0.0, -math.tan(dip)])  # in the plane of light
        x, y = of["r"] * math.cos(of["phi"]), of["r"] * math.sin(of["phi"])
        way = x * self.ahead + y * self.R[:, 1] + self.baseline_m * self.R[:, 2]
        self.range_m = float(np.linalg.norm(way))
        self.point, self.ray = self.lens + way, way / max(self.range_m, 1e-9)
        normal_body = R_body_sensor @ np.array([math.sin(dip), 0.0, math.cos(dip)])
        self.frame: Frame = frame_of(rpy, origin, normal_body)

    def limit_m(self, **changes: float) -> float:
        return limit_m(self.point, self.ray, self.range_m, self.frame, STILL._replace(**changes))

    def height_m(self, x: float, y: float) -> float:
        """Of its plane of light over a place: where two ways in it, summed, get there."""
        begins = self.lens + self.baseline_m * self.R[:, 2]
        ways = np.stack([self.ahead, self.R[:, 1]], axis=1)
        shares = np.linalg.solve(ways[:2], np.array([x, y]) - begins[:2])
        return float(begins[2] + ways[2] @ shares)


CHANGED = {"d_z": "lift_m", "yaw": "yaw_rad", "pitch": "pitch_rad", "roll": "roll_rad"}


@settings(max_examples=examples(40), deadline=None)
@given(of=BY_LASER)
def test_each_part_is_what_a_small_step_of_the_body_changes_over_a_place(of: Values) -> None:
    seen, step = Seen(of), 1e-5
    assume(abs(seen.frame.normal[2]) > 0.2)

    def slope(name: str) -> float:
        ends = [
            Seen({**of, name: of[name] + side * step}).height_m(*seen.point[:2]) for side in (-1, 1)
        ]
        return (ends[1] - ends[0]) / (2 * step)

    for name, change in CHANGED.items():
        part = seen.limit_m(**{change: 1.0})
        assert part == pytest.approx(abs(slope(name)), rel=1e-4, abs=1e-4)
    along = math.hypot(slope("x"), slope("y"))
    assert seen.limit_m(travel_m=1.0) == pytest.approx(along, rel=1e-4, abs=1e-4)


SHARE = st.floats(-1.0, 1.0)


@settings(max_examples=examples(60), deadline=None)
@given(of=BY_LASER, share=st.fixed_dictionaries(dict.fromkeys(CHANGED, SHARE)), way=SMALL)
def test_no_other_pose_within_the_changes_reads_a_height_beyond_the_limit(
    of: Values, share: dict[str, float], way: float
) -> None:
    most: dict[str, Any] = {"lift_m": 1e-4, "yaw_rad": 1e-3, "pitch_rad": 3e-4, "roll_rad": 3e-4}
    seen = Seen(of)
    assume(abs(seen.frame.normal[2]) > 0.3)
    moved = {name: of[name] + share[name] * most[change] for name, change in CHANGED.items()}
    moved["x"], moved["y"] = of["x"] + 1e-3 * math.cos(way), of["y"] + 1e-3 * math.sin(way)
    there = Seen({**of, **moved}).height_m(seen.point[0] + 5e-4, seen.point[1] - 5e-4)
    limit = seen.limit_m(travel_m=1e-3, cell_m=1e-3, **most)
    assert abs(there - seen.point[2]) <= 1.02 * limit  # of first order


def readings(yaw_rad: float) -> tuple[Seen, list[tuple[F64, F64, float]]]:
    """What is seen of a floor and a wall, x = 2.5 m, under a robot at the origin."""
    level = dict.fromkeys(
        ("r", "phi", "x", "y", "d_z", "pitch", "roll", "mount_y", "mount_roll", "mount_yaw"), 0.0
    )
    mount = {"mount_x": 0.25, "mount_z": 1.08, "mount_tilt": math.radians(16.0)}
    at = {**level, **mount, "yaw": yaw_rad}
    seen, found = Seen(at), []
    for phi in np.radians(np.arange(-60.0, 60.1, 0.36)):
        ray = seen.R @ np.array([math.cos(phi), math.sin(phi), 0.0])
        ends = [seen.lens[2] / -ray[2] if ray[2] < 0 else math.inf]
        ends.append((2.5 - seen.lens[0]) / ray[0] if ray[0] > 0 else math.inf)
        if min(ends) < 6.0:
            found.append((seen.lens + min(ends) * ray, ray, min(ends)))
    return seen, found


def test_the_limit_holds_on_a_robot_that_turns_before_a_wall_and_is_needed() -> None:
    cell_m, turn_rad = 0.05, 0.1
    changes = STILL._replace(yaw_rad=turn_rad, cell_m=cell_m)
    before: dict[tuple[int, int], list[float]] = {}
    compared, beyond = 0, 0
    for k in range(-8, 9):
        seen, found = readings(turn_rad * k)
        heights: dict[tuple[int, int], list[float]] = {}
        for point, ray, range_m in found:
            at = math.floor(point[0] / cell_m + 0.5), math.floor(point[1] / cell_m)
            heights.setdefault(at, []).append(point[2])
            limit = limit_m(point, ray, range_m, seen.frame, changes)
            without = limit_m(point, ray, range_m, seen.frame, changes._replace(yaw_rad=0.0))
            for height in before.get(at, []):
                compared += 1
                assert abs(point[2] - height) <= limit
                beyond += abs(point[2] - height) > without
        before = heights
    assert compared > 500
    assert (
        beyond > 100
    )  # with a limit that leaves the turn out, a wall is taken for a contradiction
