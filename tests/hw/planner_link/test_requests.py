"""Drive requests and external poses: the frames of the sheet, which count, and for how long."""

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from core.records import DriveRequest, ExternalPose
from fakes.wires.wire import MemoryPort
from hw.device import BadFrame
from hw.planner_link.frames import (
    DRIVE,
    EXTERNAL_POSE,
    HELLO,
    TICK_BYTES,
    Secret,
    encode_frame,
    encode_serial,
)
from hw.planner_link.messages import Drive, External, decode_answer
from hw.planner_link.receivers import one_link
from hw.planner_link.requests import (
    MOST_COMMANDERS,
    OLDEST_S,
    WAITING,
    ExternalPoses,
    ReplayGuard,
    Requests,
)
from hw.ports.sockets import DATAGRAMS
from tests.support.link.planner_sender import vector

SESSION, NONCE, KEY = 0x5A17C0DE, 0x11223344, bytes(range(32))
EXAMPLE = Drive(2, 52_340, SESSION, NONCE, 0.65, -0.12, 0.3)
SEEN = External(3, 52_360, SESSION, NONCE, 105.25, -48.9, 1.2345, 0.02, 0.03, -0.25, 0.0175, 0.04)
BODIES = {  # the example's fields, as the sheet lays them out
    DRIVE: (struct.Struct("<IIhhHH"), (SESSION, NONCE, 650, -120, 300, 0)),
    EXTERNAL_POSE: (
        struct.Struct("<IIiihHHhHH"),
        (SESSION, NONCE, 105_250, -48_900, 12_345, 20, 30, -2500, 175, 40),
    ),
}


def drive(t_ms: int, seq: int | None = None, valid_s: float = 0.3, nonce: int = NONCE) -> Drive:
    return Drive(t_ms if seq is None else seq, t_ms, SESSION, nonce, 1.0, 0.0, valid_s)


def external(t_ms: int, seq: int = 1, age_s: float = 0.0) -> External:
    return External(seq, t_ms, SESSION, NONCE, 1.0, 2.0, math.nan, 0.01, 0.02, 0.5, 0.0, age_s)


# The frames


@pytest.mark.parametrize(
    ("kind", "field", "value"),
    [
        *[(DRIVE, *wrong) for wrong in ((1, 0), (2, -(2**15)), (3, -(2**15)), (4, 1001), (5, 1))],
        *[(EXTERNAL_POSE, *wrong) for wrong in (
            (1, 0), (2, -(2**31)), (3, -(2**31)), (4, 31_416), (4, -31_417), (5, 0), (6, 0),
            (7, 10_001), (7, -10_001), (8, 0), (9, 1001),
        )],
    ],
)  # fmt: skip
def test_a_field_out_of_its_range_refuses_the_whole_frame(
    kind: int, field: int, value: int
) -> None:
    layout, fields = BODIES[kind]
    wrong = [*fields[:field], value, *fields[field + 1 :]]
    refused = decode_answer(encode_frame(kind, 0, 1, 1, layout.pack(*wrong)))
    assert isinstance(refused, BadFrame)
    assert refused.reason == ("DRIVE" if kind == DRIVE else "EXTERNAL_POSE") + " out of range"


@pytest.mark.parametrize(
    "wrong", [(-(2**31), 5, 0, 0, 9), (0, 0, 0, 0, 9), (0, 5, 31_416, 0, 9), (0, 5, -(2**15), 0, 9),
              (0, 5, 0, 0, 0)],
)  # fmt: skip
def test_a_height_or_tilt_out_of_its_range_refuses_the_whole_frame(wrong: tuple[int, ...]) -> None:
    layout, fields = BODIES[EXTERNAL_POSE]
    body = layout.pack(*fields) + struct.pack("<iHhhH", *wrong)
    assert isinstance(decode_answer(encode_frame(EXTERNAL_POSE, 0, 1, 1, body)), BadFrame)
    assert isinstance(decode_answer(encode_frame(EXTERNAL_POSE, 0, 1, 1, body[:39])), BadFrame)


def test_a_pose_without_a_yaw_needs_no_deviation_of_it() -> None:
    layout, fields = BODIES[EXTERNAL_POSE]
    body = layout.pack(*fields[:4], -(2**15), *fields[5:8], 0, 40)
    told = decode_answer(encode_frame(EXTERNAL_POSE, 0, 1, 1, body))
    assert isinstance(told, External)
    assert math.isnan(told.yaw_rad)


# Which count


@pytest.mark.parametrize(
    ("frame", "reason"),
    [
        (replace(EXAMPLE, session=1), "another run"),
        (EXAMPLE, "older than the newest, or a repetition"),
        (replace(EXAMPLE, seq=1), "older"),
        (replace(EXAMPLE, seq=3, t_ms=52_339), "older"),
        (replace(EXAMPLE, t_ms=52_350, nonce=7), "somebody else"),
    ],
)
def test_what_is_not_to_be_obeyed_changes_nothing_and_is_counted(frame: Drive, reason: str) -> None:
    requests = Requests(ReplayGuard(SESSION))
    requests.take(10.0, EXAMPLE)
    assert (requests.accepted, requests.last_refusal) == (1, "")
    before = requests.newest
    assert before == DriveRequest(0.65, -0.12, 10.3)
    requests.take(10.01, frame)
    assert requests.newest == before
    assert requests.refused.total() == 1
    assert reason in requests.last_refusal


def test_requests_and_poses_of_one_commander_are_one_sequence() -> None:
    guard = ReplayGuard(SESSION)
    requests, poses = Requests(guard), ExternalPoses(guard)
    poses.take(10.0, external(1000, seq=7))
    requests.take(10.0, drive(1000, 8))
    poses.take(10.0, external(1000, seq=8))
    assert (requests.accepted, poses.accepted) == (1, 1)
    assert "older" in poses.last_refusal


SEQUENCES = {  # each: when it arrives, the request, until when it is valid or why it is refused
    "numbers and clock may wrap": [
        (10.0, drive(2**32 - 5, 0xFFFF), 10.3),
        (10.01, drive(5, 0), 10.31),
        (10.01, drive(5, 1), 10.31),
        (700.0, drive(690_000, 0x8002), 700.3),  # after many other frames
    ],
    "what lay in a queue is valid for less or not at all": [
        (10.0, drive(1000), 10.3),
        (10.2, drive(1100), 10.4),  # 100 ms later than its forerunner
        (12.0, drive(1200), "it arrived too late"),
        (12.01, drive(3010), 12.31),
    ],
    "another may drive after the first and anybody may stop": [
        (10.0, drive(1000), 10.3),
        (10.1, drive(5, nonce=7, valid_s=0.0), -math.inf),
        (10.2, drive(105, nonce=7), 10.5),
        (10.3, drive(1300), "somebody else is driving"),
        (11.0, drive(2000), 11.3),
    ],
}


@pytest.mark.parametrize("sequence", SEQUENCES.values(), ids=SEQUENCES)
def test_requests_hold_until_their_time_from_when_they_were_sent(
    sequence: list[tuple[float, Drive, float | str]],
) -> None:
    requests = Requests(ReplayGuard(SESSION))
    for now_s, request, told in sequence:
        accepted, before = requests.accepted, requests.newest
        requests.take(now_s, request)
        if isinstance(told, str):
            assert (requests.last_refusal, requests.newest) == (told, before)
            continue
        assert requests.accepted == accepted + 1
        assert requests.newest is not None
        assert requests.newest.valid_until_s == pytest.approx(told, abs=0.02)


def test_a_pose_is_for_when_it_was_seen_and_one_too_old_is_refused() -> None:
    poses = ExternalPoses(ReplayGuard(SESSION))
    poses.take(10.0, SEEN)
    assert poses.take_all() == [
        ExternalPose(
            pytest.approx(9.96), 105.25, -48.9, 1.2345, pytest.approx(4e-4),  # type: ignore[arg-type]
            pytest.approx(-1.5e-4), pytest.approx(9e-4), pytest.approx(0.0175**2),  # type: ignore[arg-type]
        )
    ]  # fmt: skip
    poses.take(10.3, external(52_460, age_s=0.05))  # 200 ms later than its forerunner
    assert poses.take_all()[-1].t_s == pytest.approx(10.05, abs=1e-3)
    poses.take(11.5, external(52_560, age_s=0.1))
    assert poses.last_refusal == "it arrived too late"
    assert (poses.accepted, poses.refused.total()) == (2, 1)


@given(st.lists(st.floats(0.0, 0.5), min_size=1, max_size=40), st.floats(-9e-4, 9e-4))
def test_no_request_holds_longer_than_it_says_after_it_was_sent_and_no_pose_is_dated_wrong(
    delays_s: list[float], drift: float
) -> None:
    requests, poses = Requests(ReplayGuard(SESSION)), ExternalPoses(ReplayGuard(SESSION))
    requests.take(100.0, drive(0, 0))
    poses.take(100.0, external(0))
    poses.take_all()
    arrived_s = 100.0
    for k, delay_s in enumerate(delays_s, start=1):
        sent_s = 100.0 + 0.1 * k
        arrived_s = max(arrived_s, sent_s + delay_s)
        requests.take(arrived_s, drive(round(100 * k * (1 + drift)), k))
        assert requests.newest is not None
        assert requests.newest.valid_until_s <= sent_s + 0.3 + 0.003 * k
        poses.take(arrived_s, external(100 * k))
        for pose in poses.take_all():
            assert arrived_s - OLDEST_S <= pose.t_s <= arrived_s
            assert pose.t_s == pytest.approx(sent_s, abs=0.002 * k + 1e-6)


def test_poses_that_nobody_takes_do_not_pile_up() -> None:
    poses = ExternalPoses(ReplayGuard(SESSION))
    for k in range(3 * WAITING):
        poses.take(10.0 + 0.1 * k, external(100 * k))
    assert len(poses.take_all()) == WAITING


def test_a_clock_that_drifts_does_not_end_driving() -> None:
    requests = Requests(ReplayGuard(SESSION))
    for k in range(10_000):
        requests.take(0.1 * k * 1.0005, drive(100 * k, k % 2**16))
    assert requests.refused.total() == 0


def test_without_a_key_strangers_cannot_fill_the_memory_for_commanders() -> None:
    guard = ReplayGuard(SESSION)
    requests = Requests(guard)
    for k in range(1, 3 * MOST_COMMANDERS):  # one who drives, and a new stranger each time
        requests.take(10.0 + 0.1 * k, drive(1000 + 100 * k, nonce=NONCE))
        requests.take(10.05 + 0.1 * k, drive(1000, nonce=k))
    assert requests.refused == {"somebody else is driving": 3 * MOST_COMMANDERS - 1}
    requests.take(1000.0, drive(1000 + 300 * MOST_COMMANDERS, nonce=NONCE))
    assert "older" not in requests.last_refusal
    requests.take(1000.1, drive(1000, nonce=NONCE))
    assert "older" in requests.last_refusal  # who was heard lately is not forgotten
    assert len(guard._known) == MOST_COMMANDERS


def test_with_a_key_nobody_is_forgotten_and_a_full_memory_asks_for_a_new_session() -> None:
    guard = ReplayGuard(SESSION, has_key=True)
    requests = Requests(guard)
    for nonce in range(1, MOST_COMMANDERS + 1):
        assert not guard.is_full
        requests.take(10.0 * nonce, drive(1000, nonce=nonce))
    assert guard.is_full
    requests.take(1e5, drive(1000, nonce=MOST_COMMANDERS + 1))
    assert "too many commanders" in requests.last_refusal
    requests.take(1e5, drive(1000, nonce=1))
    assert "older" in requests.last_refusal  # nothing can be replayed meanwhile


@pytest.mark.parametrize("name", ["drive", "external_pose"])
@pytest.mark.parametrize(
    ("serial", "damaged", "key", "refusal", "reason"),
    [
        (False, False, None, "", ""), (True, False, None, "", ""),
        (False, True, None, "", "bad checksum"), (True, True, None, "", "bad checksum"),
        (False, False, KEY, "", "no valid tag"), (False, False, None, "no key", "no key"),
    ],
)  # fmt: skip
def test_a_link_takes_requests_and_poses_where_it_may_and_counts_why_not(
    name: str, serial: bool, damaged: bool, key: bytes | None, refusal: str, reason: str
) -> None:
    port = MemoryPort(datagrams=not serial)
    link = one_link(
        port, size=9, session=SESSION, key=key, drive_refusal=refusal, pose_refusal=refusal
    )
    frame = bytearray(vector(name))
    frame[20] ^= damaged
    port.give(encode_serial(bytes(frame)) if serial else bytes(frame))
    link.poll(3.0)
    refused = {"drive": link.requests.refused, "external_pose": link.external_poses.refused}
    assert refused.pop(name) == ({reason: 1} if reason else {})
    assert not any(refused.values())
    assert link.counters.answers_rejected == (damaged or key is not None)
    taken = not reason
    driven = DriveRequest(0.65, -0.12, 3.3) if taken and name == "drive" else None
    assert link.requests.newest == driven
    seen_s = [pytest.approx(2.96)] if taken and name == "external_pose" else []
    assert [pose.t_s for pose in link.external_poses.take_all()] == seen_s


@pytest.mark.parametrize("kind", [DRIVE, EXTERNAL_POSE])
def test_behind_a_flood_of_forged_frames_an_honest_one_is_heard_soon(kind: int) -> None:
    """As many as the port reads at once; no poll works out more tags than its share of bytes."""
    port = MemoryPort(datagrams=True)
    link = one_link(port, size=9, session=SESSION, key=KEY)
    hello = struct.pack("<IIHH", NONCE, 81, 368, 0)
    port.give(encode_frame(HELLO, 0, 1, 1, hello))
    link.poll(0.0)
    layout, fields = BODIES[kind]
    body, wrong = layout.pack(*fields), Secret(bytes(32), SESSION, NONCE)
    for number in range(DATAGRAMS):
        port.give(encode_frame(kind, 0, number, number, body, wrong))
    honest_layout, honest = BODIES[DRIVE]
    right = Secret(KEY, SESSION, NONCE)
    port.give(encode_frame(DRIVE, 0, 2, 2, honest_layout.pack(*honest), right))
    polls, rejected = 0, 0
    while not link.requests.accepted:
        link.poll(0.001 * polls)
        at_once = link.counters.answers_rejected - rejected
        polls, rejected = polls + 1, link.counters.answers_rejected
        assert at_once <= TICK_BYTES // len(body) + 1
    assert rejected == DATAGRAMS
    assert polls <= 3
