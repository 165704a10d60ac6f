"""What the public receiver knows after loss, repair, restarts and silence, and what it advises.

Source: planner link, sections 5, 6 and 14, items 5, 6, 11 and 15.
"""

import struct

import pytest

from mapod_link.bodies import FREE, OBSTACLE
from mapod_link.frames import DIGEST, GEOM, MAP, POSE, STOP_ZONE
from mapod_link.receiver import Receiver
from tests.support.planner_sender import (
    NONCE,
    STOPS,
    Line,
    geom_body,
    map_body,
    op,
    pose_body,
    receiving,
    zone_body,
)


def test_a_gap_makes_the_map_suspect_until_a_map_frame_says_that_it_is_repaired() -> None:
    line = receiving()
    missing = line.send(MAP, map_body(op(OBSTACLE, 1)), lost=True)
    assert not line.planner.suspect
    line.send(POSE, pose_body())
    assert line.planner.suspect
    assert line.planner.advice(line.now_s) == ("slow", "a frame is missing")
    line.send(MAP, map_body(repaired=missing - 1))
    assert line.planner.suspect
    line.send(MAP, map_body(op(OBSTACLE, 1), repaired=missing))
    assert not line.planner.suspect
    assert line.planner.advice(line.now_s) == ("go", "")
    assert (line.planner.numbers.gaps, line.planner.numbers.missing) == (1, 1)


def test_a_window_larger_than_the_receiver_holds_is_refused_and_said() -> None:
    line = Line(Receiver(NONCE, max_cells=44))
    line.send(GEOM, geom_body())
    line.send(POSE, pose_body())
    line.send(MAP, map_body(op(FREE, 45)))
    planner = line.planner
    assert planner.geom is None
    assert (planner.needs.too_many_cells, planner.window().size) == (45, 0)
    assert planner.advice(line.now_s)[1].startswith("the window has 45 cells")
    assert planner.ack(line.now_s)[14] & 1
    line.send(GEOM, geom_body(width=8))
    line.send(POSE, pose_body())
    line.send(MAP, map_body(op(FREE, 40)))
    assert planner.needs.too_many_cells == 0
    assert planner.advice(line.now_s) == ("go", "")


def test_no_map_stays_under_a_geometry_that_cannot_be_held() -> None:
    line = Line(Receiver(NONCE, max_cells=45))
    line.send(GEOM, geom_body())
    line.send(MAP, map_body(op(FREE, 45)))
    line.send(GEOM, geom_body(width=90, session=3))  # another run, the same number
    line.send(MAP, map_body(op(FREE, 45)))
    assert line.planner.blank
    assert not line.planner.window().any()


def test_a_digest_that_differs_without_a_gap_asks_for_everything() -> None:
    line = receiving()
    right = line.planner.digest()
    line.send(DIGEST, struct.pack("<BxxxI", 7, right))
    assert line.planner.needs.digest_ok
    assert line.planner.advice(line.now_s) == ("go", "")
    line.send(DIGEST, struct.pack("<BxxxI", 7, right ^ 1))
    assert not line.planner.needs.digest_ok
    assert line.planner.ack(line.now_s)[14] & 0b10
    assert line.planner.advice(line.now_s) == ("stop", "the map is not the sender's")
    line.send(DIGEST, struct.pack("<BxxxI", 7, right))  # the refresh has mended it
    assert not line.planner.needs.full
    assert line.planner.advice(line.now_s) == ("go", "")
    line.send(DIGEST, struct.pack("<BxxxI", 7, right ^ 1))
    line.send(GEOM, geom_body(geom_id=8))
    assert not line.planner.needs.full


# What a planner has to do


def test_what_the_stop_zone_allows_is_for_both_ways_and_grows_old() -> None:
    line = receiving()
    assert line.planner.allowed_mps(line.now_s) == (0.0, 0.0)  # nothing is known
    for state, allowed in ((1, 0.65), (2, 0.65), (3, 0.65), (0, 0.0), (9, 0.0)):
        line.send(STOP_ZONE, zone_body(state, 0b1001))
        assert line.planner.allowed_mps(line.now_s) == (allowed, 0.0)
        assert line.planner.advice(line.now_s) == ("go", "")  # the link is well
    zone = line.planner.stop_zone
    assert zone is not None
    assert zone.describe() == "unknown: an obstacle, map or pose not to be trusted"
    line.send(STOP_ZONE, zone_body())
    assert line.planner.allowed_mps(line.now_s + 0.35) == (0.65, 0.0)
    assert line.planner.allowed_mps(line.now_s + 0.36) == (0.0, 0.0)
    line.send(GEOM, geom_body(session=4))
    assert line.planner.stop_zone is None


@pytest.mark.parametrize(("health", "mode", "why"), STOPS)
def test_the_planner_stops_for_what_the_pose_frame_says(health: int, mode: int, why: str) -> None:
    line = receiving()
    line.send(POSE, pose_body(health, mode))
    assert line.planner.advice(line.now_s) == ("stop", why)
