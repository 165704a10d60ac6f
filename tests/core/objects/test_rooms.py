"""Furnished rooms: the map against the truth. Tuned on other seeds than those it is judged by."""

import numpy as np
import pytest

from tools.experiments.object_rooms import JUDGED_ON, NOISES, TUNED_ON, drive, judge, picture
from tools.experiments.object_world import furnished_room


def test_no_room_is_judged_that_was_tuned_on() -> None:
    assert not set(TUNED_ON) & set(JUDGED_ON)


@pytest.mark.slow
@pytest.mark.parametrize("noise", ["usual", "rough"])
def test_rooms_are_mapped_whole_and_true(noise: str) -> None:
    rooms = []
    for seed in JUDGED_ON[: 2 if noise == "usual" else 1]:  # `make objects` judges all
        world = furnished_room(seed, NOISES[noise])
        objects, _ = drive(world, 1200)
        rooms.append(judge(world, objects))
    things = sum(room.things for room in rooms)
    assert sum(room.missed for room in rooms) <= 0.03 * things
    assert sum(room.false for room in rooms) <= 0.03 * things
    corners = [error for room in rooms for error in room.corners_m]
    areas = np.abs([error for room in rooms for error in room.areas])
    assert np.median(corners) < 0.015
    assert np.mean(np.array(corners) <= 0.03) > 0.85
    assert np.median(areas) < (0.05 if noise == "usual" else 0.1)


@pytest.mark.slow
def test_a_short_drive_finds_what_it_has_seen() -> None:
    world = furnished_room(JUDGED_ON[3], NOISES["usual"])
    objects, frame_ms = drive(world, 150)
    room = judge(world, objects, frame_ms)
    assert (room.missed, room.false) == (0, 0)
    assert room.things > 0
    assert picture(world, objects).size == (760, 580)
