"""The crowd: people who walk, give way, wait, and never walk into a robot that stands."""

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest

from fakes.world.crowd import Crowd, Walker
from fakes.world.crowd_kernels import FRONT_M, HALF_WIDTH_M, PERSONAL_M, REAR_M

F64 = npt.NDArray[np.float64]
Place = tuple[float, float, float]
STEP_S = 0.02
FAR: Place = (-50.0, 0.0, 0.0)


def gap_m(place: Place, x: float, y: float, radius_m: float) -> float:
    """From a round body to the robot's footprint."""
    c, s = math.cos(place[2]), math.sin(place[2])
    ahead = c * (x - place[0]) + s * (y - place[1])
    aside = c * (y - place[1]) - s * (x - place[0])
    over = max(ahead - FRONT_M, -REAR_M - ahead, 0.0)
    return math.hypot(over, max(abs(aside) - HALF_WIDTH_M, 0.0)) - radius_m


def walked(crowd: Crowd, seconds: float, robot: Callable[[float], Place]) -> tuple[F64, float]:
    """Places (steps, walkers, 2), and the least gap to the robot, over a while."""
    places, least = [], math.inf
    for k in range(round(seconds / STEP_S)):
        place = robot(k * STEP_S)
        crowd.step(k * STEP_S, place)
        people = crowd.people()
        places.append(people[:, :2])
        least = min(least, *(gap_m(place, *person) for person in people))
    return np.array(places), least


def some_walkers(seed: int, count: int = 8) -> list[Walker]:
    """People all over a hall, none on the robot's place at 8, 0."""
    random = np.random.default_rng(seed)
    walkers: list[Walker] = []
    while len(walkers) < count:
        (x0, y0), (x1, y1) = random.uniform([2.0, -5.0], [16.0, 5.0], (2, 2))
        if math.hypot(x1 - x0, y1 - y0) > 3.0 and math.hypot(x0 - 8.0, y0) > 2.0:
            speed = float(random.uniform(0.8, 1.5))
            walkers.append(Walker(f"{len(walkers)}", ((x0, y0), (x1, y1)), speed))
    return walkers


def test_somebody_alone_walks_to_and_fro_at_his_own_speed() -> None:
    crowd = Crowd([Walker("alone", ((0.0, 0.0), (6.0, 0.0)), 1.2, pause_s=0.0)], 1)
    places, _ = walked(crowd, 11.0, lambda _: FAR)
    x = places[:, 0, 0]
    assert np.abs(places[:, 0, 1]).max() < 0.01
    assert x.max() == pytest.approx(6.0, abs=0.4)
    assert x[-1] < 1.5  # back again
    speeds = np.diff(x[50:200]) / STEP_S
    np.testing.assert_allclose(speeds, 1.2, atol=1e-6)


@pytest.mark.parametrize("seed", range(2))
def test_nobody_walks_into_a_robot_that_stands_or_near_to_it(seed: int) -> None:
    crowd = Crowd(some_walkers(seed), seed)
    places, least = walked(crowd, 50.0, lambda _: (8.0, 0.0, 0.3))
    assert least > PERSONAL_M - 1e-6
    ways = np.hypot(*np.diff(places, axis=0).transpose(2, 0, 1)).sum(axis=0)
    assert (ways > 12.0).all()  # and nobody is stuck


def test_nobody_crosses_right_before_a_robot_that_drives() -> None:
    """He would meet it in the middle; it drives at 0.8 m/s and never brakes."""
    for start_s in np.arange(0.0, 4.0, 1.0):
        walker = Walker("crosses", ((6.0, -4.0), (6.0, 4.0)), 1.3, float(start_s), 0.0)
        crowd, least_ahead = Crowd([walker], 1), math.inf
        for k in range(500):
            x = 0.8 * k * STEP_S
            crowd.step(k * STEP_S, (x, 0.0, 0.0))
            at_x, at_y, radius = crowd.people()[0]
            if abs(at_y) < HALF_WIDTH_M + radius and at_x > x:
                least_ahead = min(least_ahead, at_x - radius - x - FRONT_M)
            assert gap_m((x, 0.0, 0.0), at_x, at_y, radius) > 0.3
        assert least_ahead > 0.9


def test_people_do_not_run_into_each_other() -> None:
    one = Walker("one", ((0.0, 0.0), (10.0, 0.0)), 1.2, pause_s=0.0)
    other = Walker("other", ((10.0, 0.0), (0.0, 0.0)), 1.0, pause_s=0.0)
    crowd = Crowd([one, other], 1)
    places, _ = walked(crowd, 10.0, lambda _: FAR)
    apart = np.hypot(*(places[:, 0] - places[:, 1]).T)
    assert apart.min() > 0.44
    assert places[-1, 0, 0] > 6.0
    assert places[-1, 1, 0] < 4.0  # they got past each other


def test_who_finds_a_robot_in_his_way_goes_round_it_or_turns_round_if_he_may_not() -> None:
    goes = Walker("goes", ((0.0, 0.0), (16.0, 0.0)), 1.2, pause_s=0.0)
    places, least = walked(Crowd([goes], 1), 16.0, lambda _: (8.0, 0.0, 1.5))
    assert places[:, 0, 0].max() > 15.0
    assert np.abs(places[:, 0, 1]).max() > 0.5
    assert least > PERSONAL_M - 1e-6
    stuck = Walker("stuck", ((0.0, 0.0), (6.0, 0.0)), 1.2, pause_s=0.0, aside_m=0.05)
    places, least = walked(Crowd([stuck], 1), 20.0, lambda _: (6.0, 0.0, 0.0))
    assert least > PERSONAL_M - 1e-6
    assert places[300:, 0, 0].min() < 1.0


def test_places_between_two_steps_are_interpolated_and_older_ones_are_clipped() -> None:
    crowd = Crowd([Walker("alone", ((0.0, 0.0), (9.0, 0.0)), 1.0, pause_s=0.0)], 1)
    places, _ = walked(crowd, 4.0, lambda _: FAR)
    last_s = 199 * STEP_S
    asked = (last_s - 0.5, last_s - 0.01, last_s, last_s + 1.0)
    middles = np.array([crowd.people(at_s)[:, :2] for at_s in asked])
    assert middles.shape == (4, 1, 2)
    x = middles[:, 0, 0]
    np.testing.assert_allclose(x[0], places[-26, 0, 0], atol=1e-9)
    np.testing.assert_allclose(x[1], (places[-1, 0, 0] + places[-2, 0, 0]) / 2, atol=1e-9)
    assert x[2] == x[3] == places[-1, 0, 0]
    assert crowd.people(0.0)[0, 0] > 2.0  # the oldest that is kept


def test_legs_swing_about_the_body_and_stand_still_with_it() -> None:
    crowd = Crowd([Walker("alone", ((0.0, 0.0), (5.0, 0.0)), 1.2, pause_s=5.0)], 3)
    assert [part.z for part in crowd.parts] == [(0.85, 1.75), (0.0, 0.85), (0.0, 0.85)]
    swings = []
    for k in range(260):
        crowd.step(k * STEP_S, FAR)
        torso, left, right = crowd.parts_m(np.array([k * STEP_S]))[0]
        np.testing.assert_allclose(left[1] - torso[1], 0.10, atol=1e-9)
        np.testing.assert_allclose((left + right) / 2, torso, atol=1e-9)
        swings.append(left[0] - torso[0])
    assert max(swings[:150]) > 0.2
    assert min(swings[:150]) < -0.2
    assert abs(swings[-1]) < 0.01  # he rests at the far end


@pytest.mark.parametrize(
    ("points", "speed"),
    [(((0, 0),), 1.0), (((0, 0), (0.5, 0)), 1.0), (((0, 0), (5, 0)), 0.0)],
)
def test_walkers_who_cannot_walk_are_refused(points: tuple[Place, ...], speed: float) -> None:
    with pytest.raises(ValueError, match="a: "):
        Walker("a", points, speed)  # type: ignore[arg-type]
