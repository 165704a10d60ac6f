"""The machine that cleans follows its path through its motor controller, within centimetres."""

from itertools import pairwise

import numpy as np
import pytest

from fakes.ax3500.device import FakeAx3500
from fakes.scenes.halls import hall_of
from fakes.world.path_follower import PERIOD_S, Limits, PathFollower
from fakes.world.rolling import RollingWorld

LIMITS = Limits(speed_mps=0.8, accel_mps2=0.6, turn_radps=1.2, turn_accel_radps2=2.5)


def driven(points: np.ndarray, yaw: float | None = None) -> tuple[np.ndarray, RollingWorld]:
    """Places (n, 3) on the way along a path, and the world behind it."""
    world, follower, places = RollingWorld(hall_of(2).scene, 1), PathFollower(LIMITS), []
    controller = FakeAx3500(world, 1, "rc")
    follower.follow(points, yaw)
    for k in range(4000):
        now_s = k * PERIOD_S
        world.step_to(now_s)
        controller.command(*follower.power(world.place, LIMITS.speed_mps))
        controller.exchange(now_s, b"")
        places.append(world.place)
        if follower.is_done and world.speeds == pytest.approx((0.0, 0.0), abs=1e-3):
            return np.array(places), world
    raise AssertionError("it never comes to the end of the path")


def off_m(places: np.ndarray, points: np.ndarray) -> float:
    """The greatest distance of places from a path."""
    far = np.full(len(places), np.inf)
    for a, b in pairwise(points):
        share = np.clip((places[:, :2] - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
        far = np.minimum(far, np.hypot(*(a + share[:, None] * (b - a) - places[:, :2]).T))
    return float(far.max())


def test_lanes_with_right_angles_are_followed_within_two_centimetres() -> None:
    lanes = np.array([[0.0, 0.0], [1.5, 0.0], [1.5, 0.55], [0.0, 0.55], [0.0, 1.1], [1.5, 1.1]])
    places, world = driven(lanes)
    assert off_m(places, lanes) < 0.02
    assert world.place[:2] == pytest.approx((1.5, 1.1), abs=0.03)


def test_a_round_way_is_driven_through_and_ends_with_the_turn_that_was_asked() -> None:
    angle = np.linspace(0.0, np.pi, 13)
    arc = np.column_stack([np.sin(angle), 1.0 - np.cos(angle)])
    places, world = driven(arc, yaw=1.0)
    assert off_m(places, arc) < 0.035
    assert world.place[2] % (2 * np.pi) == pytest.approx(1.0, abs=0.1)


def test_a_corner_of_a_thing_is_passed_round_at_the_distance_that_was_asked() -> None:
    angle = np.linspace(-np.pi / 2, np.pi / 2, 25)
    bend = np.array([2.0, 0.41]) + 0.41 * np.column_stack([np.cos(angle), np.sin(angle)])
    way = np.vstack([[0.0, 0.0], bend, [0.0, 0.82]])
    places, _ = driven(way)
    assert off_m(places, way) < 0.025


@pytest.mark.parametrize("lever_m", [0.1, 0.2])
def test_slight_corners_one_upon_the_other_are_kept_to_within_five_centimetres(
    lever_m: float,
) -> None:
    yaws = np.radians(24.0) * np.array([1, 2, 3, 4, 3, 2, 1, 0, -1, -2, -3, -4])
    steps = lever_m * np.column_stack([np.cos(yaws), np.sin(yaws)])
    corners = np.array([1.5, 0.0]) + np.cumsum(steps, axis=0)
    way = np.vstack([[0.0, 0.0], [1.5, 0.0], corners])
    places, _ = driven(way)
    assert off_m(places, way) < 0.045


def test_it_stands_at_a_sharp_corner_behind_a_short_edge() -> None:
    way = np.array([[0.0, 0.0], [1.4, 0.0], [1.45, 0.01], [1.5, 0.03], [1.4, 0.5]])
    places, _ = driven(way)
    assert off_m(places, way) < 0.02


def test_it_stands_at_once_when_it_must() -> None:
    follower = PathFollower(LIMITS)
    follower.follow(np.array([[0.0, 0.0], [5.0, 0.0]]))
    for k in range(20):
        assert follower.power((0.1 * k, 0.0, 0.0), 0.8) >= (0, 0)
    assert follower.power((2.0, 0.0, 0.0), 0.0) == (0, 0)


def test_where_it_must_stand_it_may_turn_on_the_spot() -> None:
    follower = PathFollower(LIMITS)
    follower.follow(np.array([[0.0, 0.0], [0.0, 5.0]]))
    left, right = follower.power((0.0, 0.0, 0.0), 0.0)
    assert left == -right < 0


def test_beside_its_edge_it_finds_back_and_does_not_turn_for_ever() -> None:
    world, follower = RollingWorld(hall_of(2).scene, 1), PathFollower(LIMITS)
    controller = FakeAx3500(world, 1, "rc")
    follower.follow(np.array([[-0.2, 0.12], [0.5, 0.12]]))
    for k in range(400):
        world.step_to(k * PERIOD_S)
        controller.command(*follower.power(world.place, LIMITS.speed_mps))
        controller.exchange(k * PERIOD_S, b"")
    assert follower.is_done
    assert world.place[:2] == pytest.approx((0.5, 0.12), abs=0.04)
