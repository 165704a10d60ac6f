"""External poses on the planner link: the frame of the sheet, which count, for which instant."""

import math
import struct
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.records import ExternalPose
from hw.device import BadFrame
from hw.planner_link.frames import EXTERNAL_POSE, encode_frame
from hw.planner_link.messages import Drive, External, decode_answer
from hw.planner_link.poses import OLDEST_S, WAITING, ExternalPoses
from hw.planner_link.replay_guard import ReplayGuard
from hw.planner_link.requests import Requests

SESSION, NONCE, KEY = 0x5A17C0DE, 0x11223344, bytes(range(32))
BODY = struct.Struct("<IIiihHHhHH")
EXAMPLE_BODY = (SESSION, NONCE, 105_250, -48_900, 12_345, 20, 30, -2500, 175, 40)
EXAMPLE = External(
    3, 52_360, SESSION, NONCE, 105.25, -48.9, 1.2345, 0.02, 0.03, -0.25, 0.0175, 0.04
)


def external(t_ms: int, seq: int = 1, age_s: float = 0.0, nonce: int = NONCE) -> External:
    return External(seq, t_ms, SESSION, nonce, 1.0, 2.0, math.nan, 0.01, 0.02, 0.5, 0.0, age_s)


def poses() -> ExternalPoses:
    return ExternalPoses(ReplayGuard(SESSION))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        (1, 0), (2, -(2**31)), (3, -(2**31)), (4, 31_416), (4, -31_417), (5, 0), (6, 0),
        (7, 10_001), (7, -10_001), (8, 0), (9, 1001),
    ],
)  # fmt: skip
def test_a_field_out_of_its_range_refuses_the_whole_frame(field: int, value: int) -> None:
    fields = list(EXAMPLE_BODY)
    fields[field] = value
    refused = decode_answer(encode_frame(EXTERNAL_POSE, 0, 1, 1, BODY.pack(*fields)))
    assert isinstance(refused, BadFrame)
    assert refused.reason == "EXTERNAL_POSE out of range"


def test_a_pose_without_a_yaw_needs_no_deviation_of_it() -> None:
    fields = (*EXAMPLE_BODY[:4], -(2**15), *EXAMPLE_BODY[5:8], 0, 40)
    told = decode_answer(encode_frame(EXTERNAL_POSE, 0, 1, 1, BODY.pack(*fields)))
    assert isinstance(told, External)
    assert math.isnan(told.yaw_rad)


@given(body=st.binary(max_size=40) | st.binary(min_size=28, max_size=28))
def test_any_body_is_a_pose_within_its_ranges_or_refused(body: bytes) -> None:
    told = decode_answer(encode_frame(EXTERNAL_POSE, 0, 1, 1, body))
    if isinstance(told, External):
        assert len(body) == BODY.size
        assert min(told.sigma_x_m, told.sigma_y_m) > 0.0
        assert abs(told.correlation) <= 1.0
        assert 0.0 <= told.age_s <= 1.0
        assert math.isnan(told.yaw_rad) or abs(told.yaw_rad) <= 3.1416
    else:
        assert isinstance(told, BadFrame)


def test_a_pose_is_for_when_it_was_seen_not_for_when_it_came() -> None:
    external_poses = poses()
    external_poses.take(10.0, EXAMPLE)
    [pose] = external_poses.take_all()
    assert pose == ExternalPose(
        pytest.approx(9.96), 105.25, -48.9, 1.2345, pytest.approx(4e-4),  # type: ignore[arg-type]
        pytest.approx(-1.5e-4), pytest.approx(9e-4), pytest.approx(0.0175**2),  # type: ignore[arg-type]
    )  # fmt: skip
    assert external_poses.take_all() == []


def test_what_lay_in_a_queue_is_dated_back_and_what_is_too_old_is_refused() -> None:
    external_poses = poses()
    external_poses.take(10.0, external(1000))
    external_poses.take(10.3, external(1100, age_s=0.05))  # 200 ms later than its forerunner
    assert external_poses.take_all()[-1].t_s == pytest.approx(10.05, abs=1e-3)
    external_poses.take(11.5, external(1200, age_s=0.1))
    assert external_poses.last_refusal == "it arrived too late"
    assert (external_poses.accepted, external_poses.refused.total()) == (2, 1)


@given(st.lists(st.floats(0.0, 0.5), min_size=1, max_size=40))
def test_no_pose_is_dated_later_than_it_came_or_before_it_was_sent(delays_s: list[float]) -> None:
    external_poses, arrived_s = poses(), 0.0
    external_poses.take(100.0, external(0))
    external_poses.take_all()
    for k, delay_s in enumerate(delays_s, start=1):
        arrived_s = max(arrived_s, 100.0 + 0.1 * k + delay_s)
        external_poses.take(arrived_s, external(100 * k))
        for pose in external_poses.take_all():
            assert arrived_s - OLDEST_S <= pose.t_s <= arrived_s
            assert pose.t_s == pytest.approx(100.0 + 0.1 * k, abs=0.002 * k + 1e-6)


def test_old_repeated_and_foreign_poses_are_refused_and_counted() -> None:
    external_poses = poses()
    external_poses.take(10.0, EXAMPLE)
    for wrong in (EXAMPLE, external(52_359), replace(EXAMPLE, t_ms=52_400, session=1)):
        external_poses.take(10.1, wrong)
    assert external_poses.refused.total() == 3
    assert len(external_poses.take_all()) == 1


def test_requests_and_poses_of_one_commander_are_one_sequence() -> None:
    guard = ReplayGuard(SESSION)
    requests, external_poses = Requests(guard), ExternalPoses(guard)
    external_poses.take(10.0, external(1000, seq=7))
    requests.take(10.0, Drive(8, 1000, SESSION, NONCE, 1.0, 0.0, 0.3))
    external_poses.take(10.0, external(1000, seq=8))
    assert (requests.accepted, external_poses.accepted) == (1, 1)
    assert "older" in external_poses.last_refusal


def test_poses_that_nobody_takes_do_not_pile_up() -> None:
    external_poses = poses()
    for k in range(3 * WAITING):
        external_poses.take(10.0 + 0.1 * k, external(100 * k))
    assert len(external_poses.take_all()) == WAITING
