"""A planner that drives a path and is stuck goes back a little, and ahead if that is no help."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fakes.planner_mcu.path_driving import AGAIN_S, BACK_MPS, STUCK_S, PathDriving
from fakes.world.path_follower import PERIOD_S

POINTS = np.array([[0.0, 0.0], [0.0, 5.0]])  # beside it: it has to turn first


class Blocked:
    """The link's end of a robot that nothing moves; it keeps what it is asked for."""

    def __init__(self) -> None:
        self.pose = SimpleNamespace(x_m=0.0, y_m=0.0, yaw_rad=0.0, v_mps=0.0, w_radps=0.0)
        path = SimpleNamespace(number=1, points_m=POINTS, ahead=1)
        self.vectors = SimpleNamespace(path=path, path_state=lambda now_s: ("known", ""))
        self.asked: list[tuple[float, float, float]] = []

    def advice(self, now_s: float) -> tuple[str, str]:
        return "go", ""

    def drive(self, now_s: float, v_mps: float, w_radps: float, valid_s: float) -> None:
        self.asked.append((now_s, v_mps, w_radps))


def ways(planner: Any, driving: PathDriving, from_s: float, to_s: float) -> list[float]:
    """Speeds that it asks for while it does not turn, each once in a row."""
    planner.asked.clear()
    for k in range(round((to_s - from_s) / PERIOD_S)):
        driving.step(from_s + k * PERIOD_S)
    speeds = [v for _, v, w in planner.asked if v and not w]
    return [v for k, v in enumerate(speeds) if k == 0 or v != speeds[k - 1]]


def test_it_goes_back_and_ahead_in_turn_while_it_is_stuck() -> None:
    planner: Any = Blocked()
    found = ways(planner, PathDriving(planner), 100.0, 100.0 + 4.5 * STUCK_S + 1.0)
    assert found[:4] == [-BACK_MPS, BACK_MPS, -BACK_MPS, BACK_MPS]


def test_it_goes_back_first_when_it_is_stuck_another_time() -> None:
    planner: Any = Blocked()
    driving = PathDriving(planner)
    once_s = 100.0 + 0.9 * STUCK_S
    assert ways(planner, driving, 100.0, once_s) == [-BACK_MPS]
    planner.pose.w_radps = 0.5  # it turns
    later_s = once_s + AGAIN_S
    ways(planner, driving, once_s, later_s)
    planner.pose.w_radps = 0.0
    assert ways(planner, driving, later_s, later_s + 1.9 * STUCK_S) == [pytest.approx(-BACK_MPS)]
