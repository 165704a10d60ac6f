"""Losses, held lines and restarts: what the planner may take for true, and when it is again."""

import pytest

from hw.planner_link.frames import ACK, GEOM
from mapod_link.frames import bytes_from_frame
from tests.support.planner_line import Line, Sky

KEY = bytes(range(32))


def test_acknowledgements_of_the_old_map_on_their_way_do_not_start_the_new_one_again() -> None:
    line = Line(Sky(41, 3))
    line.sky.change(200)
    line.settle(0.5)
    late = line.planner.ack(line.now_s)
    geometries = line.planner.accepted[GEOM]
    line.sky.cells[:] = 0
    line.sky.epoch += 1
    line.tick()
    assert not line.planner.window().any()
    line.port.give(bytes_from_frame(ACK, 99, 0, late))
    line.sky.change(3)
    line.settle(0.2)
    assert line.planner.accepted[GEOM] == geometries + 1
    assert line.holds_what_is_meant()


def test_maps_of_a_restarted_sender_wait_for_its_geometry() -> None:
    line = Line(Sky(21, 3), ack_every=0)
    line.sky.change(300)
    line.settle(0.5)
    next_seq = line.planner.numbers.last + 1  # its numbers happen to go on from the old ones
    restarted = Line(Sky(21, 4), ack_every=0, session=78, first_seq=next_seq)
    restarted.planner, restarted.now_s = line.planner, line.now_s
    restarted.loss = 1.0
    restarted.tick()  # its geometry is lost
    restarted.loss = 0.0
    ignored, held = line.planner.ignored.maps, line.planner.window()
    restarted.settle(0.5)
    assert line.planner.ignored.maps > ignored + 20
    assert (line.planner.window() == held).all()
    restarted.settle(1.0)
    assert restarted.holds_what_is_meant()


@pytest.mark.parametrize("key", [None, KEY])
def test_a_sender_that_starts_again_is_found_again(key: bytes | None) -> None:
    line = Line(Sky(21, 1), key=key)
    line.settle(1.0)
    again = Line(line.sky, key=key, session=78, planner=line.planner)
    again.now_s = line.now_s + 0.5
    again.settle(2.0)
    assert line.planner.geom is not None
    assert line.planner.geom.session == 78
    assert again.holds_what_is_meant()
    assert not line.planner.stale(again.now_s)
    assert not line.planner.suspect
    assert not line.planner.needs.auth_failed
