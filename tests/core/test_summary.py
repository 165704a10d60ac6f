"""What `--check` tells of the robot, and what a planner is told before anything is known."""

import math
from typing import Any

import pytest

from config_file import load_config, with_changes
from core.driving import health
from core.driving.report import report
from core.mapping.mapper import Mapper
from core.summary import describe_robot
from tests import ROOT

SHIPPED = load_config((ROOT / "mapod.toml").read_text(encoding="utf-8"))


def told(**sections: dict[str, Any]) -> str:
    return describe_robot(with_changes(SHIPPED, **sections), [None])


def test_the_papers_robot_is_described() -> None:
    for words in (
        "motors    never move (robot.enable_motors is false)",
        "meets the ground 8.45 m ahead of the axle (range 8.27 m)",
        "481 beams from 30 to 150 deg, 25 scans/s",
        "101 x 101 cells of 0.2 m = 20.2 m square",
        "width of ground seen there: 28.7 m",
    ):
        assert words in told()
    assert "too little" not in told()
    assert "too little" in describe_robot(SHIPPED, [19_200])


@pytest.mark.parametrize(
    ("robot", "planner", "words"),
    [
        ({}, {}, "which nobody has to sign: up to 1 m/s"),
        ({}, {}, "it cannot set out (robot.start_clear_m is 0)"),
        ({}, {"key_file": "key"}, "signed with the key"),
        ({}, {"port": "udp://10.0.0.2:9750"}, "never move: from another machine"),
        ({"start_clear_m": 9.0}, {}, "9 m around the start, which must be clear"),
        ({"unknown_stops": False}, {}, "drives onto ground that it has not seen"),
        ({"stop_margin_m": 0.3}, {}, "stops 0.3 m before obstacles"),
    ],
)
def test_what_enabled_motors_will_do_is_told(
    robot: dict[str, Any], planner: dict[str, Any], words: str
) -> None:
    assert words in told(robot={"enable_motors": True, **robot}, planner=planner)


def test_a_robot_without_wheels_is_described() -> None:
    none = {"driver": "none", "port": ""}
    words = told(motion={"source": "external"}, drive=none)
    assert "drive     none: nothing commands motors\n" in words
    assert "motion    the place comes as EXTERNAL_POSE frames" in words
    assert "counts per metre" not in words
    far = {"port": "udp://10.0.0.2:9750"}
    words = told(motion={"source": "external"}, drive=none, planner=far)
    assert "motion    the place can't be told: from another machine" in words
    assert "motion    along a straight rail" in told(motion={"source": "rail"})


def test_a_planner_is_told_what_is_not_known() -> None:
    trusted, pose = report(
        Mapper(SHIPPED), 5.0, clocks_locked=False, overrun=True, replayed=False,
        impaired=True, stop_asked=True, drop_ahead=True, stalled=False,
        scan_stale_s=0.15,
    )  # fmt: skip
    assert not trusted
    assert pose.mode == health.BOOTING
    assert pose.health == health.SIGHT_IMPAIRED | health.STOP_ASKED | health.DROP_AHEAD
    assert pose.age_scan_s == pose.age_ahrs_s == pose.age_enc_s == math.inf
    assert (pose.x_m, pose.y_m, pose.yaw_rad, pose.v_mps) == (0.0, 0.0, 0.0, 0.0)
