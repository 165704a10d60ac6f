"""The fake planner is the public receiver with faults: each by one attribute."""

import pytest

from fakes.planner_mcu.receiver import FakePlanner
from mapod_link.frames import ACK, POSE, frame_from_bytes
from tests.support.link.planner_sender import begun, pose_body, vector


def test_a_deaf_planner_hears_nothing_and_a_mute_one_says_nothing() -> None:
    planner = FakePlanner()
    planner.deaf = planner.mute = True
    assert not planner.feed_datagram(0.0, vector("geom"))
    planner.feed_stream(0.0, vector("geom_serial"))
    assert planner.geom is None
    assert not planner.rejected
    planner.deaf = False
    planner.feed_datagram(0.0, vector("geom"))
    assert planner.geom is not None
    assert planner.poll(0.0) == []
    planner.mute = False
    [frame] = [frame_from_bytes(data) for data in planner.poll(0.2)]
    assert not isinstance(frame, str)
    assert frame.type == ACK


def test_a_one_way_link_keeps_it_silent() -> None:
    planner = FakePlanner(ack_every=0)
    planner.feed_datagram(0.0, vector("geom"))
    assert planner.poll(0.0) == []
    assert planner.nonce == 0


@pytest.mark.parametrize("loss_rate", [0.1, 0.5])
def test_it_loses_the_share_of_frames_that_it_is_told_to(loss_rate: float) -> None:
    line = begun()
    line.planner.loss_rate = loss_rate
    before = line.planner.accepted.total()
    for _ in range(2000):
        line.send(POSE, pose_body())
    heard = line.planner.accepted.total() - before
    assert heard == pytest.approx(2000 * (1 - loss_rate), abs=90)
    assert line.planner.numbers.missing == pytest.approx(2000 - heard, abs=5)


def test_the_same_seed_loses_the_same_frames_and_draws_the_same_nonce() -> None:
    planners = [FakePlanner(seed) for seed in (4, 4, 5)]
    for planner in planners:
        planner.loss_rate = 0.5
        for now_s in range(20):
            planner.feed_datagram(float(now_s), vector("geom"))
    assert planners[0].nonce == planners[1].nonce != planners[2].nonce
    assert planners[0].ignored.repeated == planners[1].ignored.repeated
