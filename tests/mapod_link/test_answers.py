"""What the public receiver says: HELLO, ACK, requests, and all of it with a key.

Source: planner link, sections 3, 6 and 9.
"""

from typing import Any

import pytest

from mapod_link import asking
from mapod_link.asking import Upright
from mapod_link.bodies import OBSTACLE
from mapod_link.frames import (
    ACK,
    ASK,
    AUTH,
    DRIVE,
    EXTERNAL_POSE,
    GEOM,
    HELLO,
    MAP,
    OUTBOX,
    POSE,
    Frame,
    bytes_from_frame,
    tag_is_right,
)
from mapod_link.receiver import Receiver
from tests.support.link.planner_sender import (
    NONCE,
    SESSION,
    VECTORS,
    geom_body,
    map_body,
    pose_body,
    receiving,
    signed_frame,
    vector,
    whole,
)

KEY = bytes(range(32))


def frames_of(receiver: Receiver, now_s: float) -> list[Frame]:
    return whole(receiver.poll(now_s))


def answers(receiver: Receiver, now_s: float) -> list[tuple[int, int]]:
    return [(frame.type, frame.seq) for frame in frames_of(receiver, now_s)]


def test_it_says_hello_until_the_geometry_arrives() -> None:
    planner = Receiver(NONCE)
    assert answers(planner, 0.0) == [(HELLO, 1)]
    assert answers(planner, 0.1) == []
    assert answers(planner, 0.3) == [(HELLO, 2)]
    planner.feed_datagram(0.4, vector("geom"))
    assert answers(planner, 0.6) == [(ACK, 3)]


def test_an_ack_is_due_each_16_frames_and_each_100_ms() -> None:
    line = receiving()
    assert answers(line.planner, 0.03) == [(ACK, 1)]
    for _ in range(33):
        line.send(POSE, pose_body())
        line.now_s -= 0.01
    assert answers(line.planner, 0.05) == [(ACK, 2), (ACK, 3)]
    assert answers(line.planner, 0.13) == []
    assert answers(line.planner, 0.15) == [(ACK, 4)]


def test_an_ack_may_be_asked_for_and_its_period_set() -> None:
    receiver = Receiver(NONCE, ack_period_s=1.0)
    receiver.acknowledge(0.0)
    receiver.feed_datagram(0.0, vector("geom"))
    assert answers(receiver, 0.0) == [(ACK, 1)]
    assert answers(receiver, 0.5) == []
    receiver.acknowledge(0.5)
    assert answers(receiver, 0.5) == [(ACK, 2)]
    assert answers(receiver, 1.4) == []
    assert answers(receiver, 1.5) == [(ACK, 3)]


def test_a_receiver_without_a_return_path_says_nothing_at_all() -> None:
    receiver = Receiver(0, ack_every=0)
    for name in ("geom", "pose", "map"):
        receiver.feed_datagram(0.0, vector(name))
    receiver.acknowledge(0.0)
    receiver.ask_tile("class", 0, 0, 2, 2)
    assert not receiver.ask(0.0, pose=True)
    assert not receiver.drive(0.0, 0.1, 0.0, 0.3)
    assert not receiver.external_pose(0.0, 1, 2, None, sigma_x_m=1, sigma_y_m=1)
    assert receiver.poll(10.0) == []


def test_who_never_polls_keeps_only_the_newest_answers() -> None:
    line = receiving()
    for _ in range(40 * OUTBOX):
        line.send(POSE, pose_body())
    assert line.planner.drive(line.now_s, 0.5, 0.0, 0.3)
    kinds = [kind for kind, _ in answers(line.planner, line.now_s)]
    assert len(kinds) <= OUTBOX
    assert DRIVE in kinds


def test_requests_are_those_of_the_vectors() -> None:
    receiver = Receiver(NONCE)
    assert not receiver.drive(0.0, 0.65, -0.12, 0.3)  # nobody's session is known
    receiver.feed_datagram(52.2, vector("geom"))
    assert receiver.drive(52.34, 0.65, -0.12, 0.3)
    sigmas: dict[str, Any] = {"sigma_x_m": 0.02, "sigma_y_m": 0.03, "sigma_yaw_rad": 0.0175}
    sigmas |= {"correlation": -0.25, "age_s": 0.04}
    assert receiver.external_pose(52.36, 105.25, -48.9, 1.2345, **sigmas)
    upright = Upright(1.25, 0.015, (-0.0052, 0.0017), 0.0035)
    assert receiver.external_pose(52.42, 105.25, -48.9, 1.2345, **sigmas, upright=upright)
    assert receiver.ask(52.39, geometry=True, pose=True, stop_zone=True)
    assert not receiver.ask(52.39)
    drive, external, higher, ask = frames_of(receiver, 52.2)[:4]
    assert (higher.type, higher.body) == (EXTERNAL_POSE, vector("external_pose_upright")[8:-4])
    assert (drive.type, drive.t_ms, drive.body) == (DRIVE, 52_340, vector("drive")[8:-4])
    assert (external.type, external.body) == (EXTERNAL_POSE, vector("external_pose")[8:-4])
    assert (ask.type, ask.body[2:]) == (ASK, vector("ask_now")[8:-4][2:])
    with pytest.raises(ValueError, match="no DRIVE frame"):
        receiver.drive(52.4, 40.0, 0.0, 0.3)


# With a key


def keyed(nonce: int = NONCE, key: bytes = KEY) -> Receiver:
    """A receiver that asks for tags and has adopted the example's geometry."""
    receiver = Receiver(nonce, key=key)
    body = geom_body(width=101, height=101)
    receiver.feed_datagram(0.0, signed_frame(key, nonce, GEOM, 1, 1000, body))
    return receiver


@pytest.mark.parametrize("right", [True, False])
def test_the_authenticated_frame_of_the_sheet_is_taken_with_its_key_alone(right: bool) -> None:
    receiver = keyed(int(VECTORS["auth_nonce"], 16), vector("auth_key") if right else bytes(32))
    receiver.feed_datagram(0.0, vector("map_auth"))
    assert (receiver.cell(40, 60) == OBSTACLE) is right
    assert receiver.needs.auth_failed is not right
    assert receiver.rejected["tag"] == (not right)
    receiver.feed_datagram(0.0, vector("pose"))
    assert receiver.needs.auth_failed
    assert receiver.pose is None


@pytest.mark.parametrize("days", [1, 48])
def test_a_frame_of_days_ago_is_old_whatever_its_number(days: int) -> None:
    receiver, now_ms = keyed(), days * 86_400_000
    receiver.feed_datagram(1.0, signed_frame(KEY, NONCE, POSE, 300, now_ms, pose_body(mode=2)))
    receiver.feed_datagram(2.0, signed_frame(KEY, NONCE, POSE, 301, 2000, pose_body(mode=4)))
    assert receiver.pose is not None
    assert (receiver.pose.mode, receiver.pose.t_ms) == (2, now_ms)


def test_its_own_answers_thrown_back_at_it_change_nothing() -> None:
    receiver = keyed()
    [own] = receiver.poll(0.1)
    taken = receiver.numbers.taken
    receiver.feed_datagram(0.2, own)
    assert receiver.numbers.taken == taken
    assert not receiver.rejected


def test_a_receiver_with_a_key_signs_all_but_its_hello() -> None:
    receiver = Receiver(NONCE, key=KEY)
    assert not receiver.ask(0.0, geometry=True)  # nothing to sign it for
    [hello] = frames_of(receiver, 0.0)
    assert (hello.type, hello.flags) == (HELLO, 0)
    receiver = keyed()
    receiver.drive(0.1, 0.1, 0.0, 0.3)
    receiver.ask(0.1, pose=True)
    receiver.ask_tile("height", 0, 0, 3, 3)
    frames = frames_of(receiver, 0.1)
    assert sorted(frame.type for frame in frames) == [ACK, DRIVE, ASK, ASK]
    for frame in frames:
        assert frame.flags == AUTH
        assert tag_is_right(frame, KEY, SESSION, NONCE)


def test_a_sender_that_starts_again_is_told_the_nonce_it_cannot_know() -> None:
    receiver = keyed()
    assert [kind for kind, _ in answers(receiver, 0.1)] == [ACK]
    anew = signed_frame(KEY, 0, GEOM, 1, 5, geom_body(session=8), session=8)
    receiver.feed_datagram(0.2, anew)
    assert receiver.needs.auth_failed
    assert [kind for kind, _ in answers(receiver, 0.2)] == [HELLO, ACK]
    assert receiver.ack(0.2)[14] & asking.AUTH_FAILED
    receiver.feed_datagram(0.3, anew)
    assert [kind for kind, _ in answers(receiver, 0.3)] == [ACK]  # not more than four a second
    told = signed_frame(KEY, NONCE, GEOM, 2, 25, geom_body(session=8), session=8)
    receiver.feed_datagram(0.5, told)
    assert receiver.geom is not None
    assert receiver.geom.session == 8
    assert HELLO not in [kind for kind, _ in answers(receiver, 1.0)]


# A receiver that only asks


def test_a_receiver_that_only_asks_says_so_and_acknowledges_nothing() -> None:
    receiver = Receiver(NONCE, poll_only=True)
    [hello] = frames_of(receiver, 0.0)
    assert hello.body[10:] == b"\x01\x00"
    receiver.feed_datagram(0.1, vector("geom"))
    assert frames_of(receiver, 1.0) == []
    assert receiver.advice(1.0) == ("stop", "a receiver that only asks keeps no map")
    receiver.feed_datagram(1.1, bytes_from_frame(MAP, 2, 2000, map_body()))
    assert [kind for kind, _ in answers(receiver, 1.1)] == [HELLO]  # it has forgotten us
    assert answers(receiver, 1.2) == []


def test_one_that_only_asks_says_hello_again_when_no_question_is_answered_for_a_second() -> None:
    receiver = Receiver(NONCE, poll_only=True)
    receiver.poll(0.0)
    receiver.feed_datagram(0.1, vector("geom"))
    assert receiver.ask(1.0, pose=True)
    assert [kind for kind, _ in answers(receiver, 1.0)] == [ASK]
    assert answers(receiver, 1.9) == []
    assert [kind for kind, _ in answers(receiver, 2.1)] == [HELLO]
    receiver.feed_datagram(2.2, bytes_from_frame(GEOM, 3, 1200, vector("geom")[8:24]))
    assert answers(receiver, 2.5) == []
    receiver.vectors.ask(objects=True)
    assert [kind for kind, _ in answers(receiver, 3.0)] == [ASK]
    assert [kind for kind, _ in answers(receiver, 4.1)] == [HELLO]
