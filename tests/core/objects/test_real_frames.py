"""Real frames of a Kinect against the figures of tests/vectors/kinect/README.md."""

import math

import numpy as np
import pytest
import shapely

from core.objects.frame.steps import FrameResult, FrameSteps
from core.records import F64
from tools.objects.frames import FRAMES, image_of, pose_of

NORMALS = {  # x right, y down, z ahead; then the height of the camera
    "boxes_1": ((0.0724, -0.6922, -0.7180), 0.7146),
    "boxes_2": ((0.0719, -0.6956, -0.7148), 0.7118),
    "five_people": ((0.0049, -0.9964, -0.0849), 1.2937),
}
BOXES = {  # sides of the smallest rectangle around the small and the big box, their heights
    "boxes_1": ((0.171, 0.262, 0.089), (0.137, 0.389, 0.233)),
    "boxes_2": ((0.168, 0.256, 0.089), (0.128, 0.379, 0.233)),
}


def found(name: str) -> FrameResult:
    frame = next(frame for frame in FRAMES if frame.file == name)
    return FrameSteps(frame.settings).find(image_of(frame), pose_of(frame), np.zeros((0, 4)))


def sides(polygon: F64) -> list[float]:
    corners = shapely.get_coordinates(shapely.oriented_envelope(shapely.Polygon(polygon)))
    return sorted(np.hypot(*np.diff(corners[:3], axis=0).T).tolist())


@pytest.mark.parametrize("name", list(NORMALS))
def test_the_floor_is_where_it_is(name: str) -> None:
    floor = found(name).floor
    assert floor is not None
    right, down, ahead = NORMALS[name][0]
    cosine = float(floor.normal_sensor @ np.array([ahead, -right, -down]))
    assert math.degrees(math.acos(min(1.0, cosine))) < 1.0
    assert floor.height_m == pytest.approx(NORMALS[name][1], abs=0.01)


@pytest.mark.parametrize("name", list(BOXES))
def test_both_boxes_have_their_sizes(name: str) -> None:
    told = found(name).objects.detections
    for short_m, long_m, top_m in BOXES[name]:
        fitting = [
            one
            for one in told
            if sides(one.polygon) == pytest.approx([short_m, long_m], rel=0.06)
            and one.top_m == pytest.approx(top_m, abs=0.01)
        ]
        assert len(fitting) == 1


def test_five_people_are_five_and_what_is_between_them_is_not_seen_through() -> None:
    told = found("five_people").objects
    people = [one for one in told.detections if one.top_m > 1.5 and one.top_m - one.bottom_m > 1.4]
    assert len(people) == 5
    for one in people:
        short_m, long_m = sides(one.polygon)
        assert 0.2 < short_m <= long_m < 0.9
        inside = shapely.intersection(shapely.Polygon(told.view), shapely.Polygon(one.polygon))
        assert inside.area < 0.04
    assert len(told.view) > 2
