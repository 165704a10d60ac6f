"""What a view covers: behind its near edge and before its far edge, at each bearing, no more."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from core.objects.records import Detection, Floats, FrameObjects
from core.objects.vector_map.object_map import ObjectMap
from core.objects.vector_map.seen import sectors_of, sees
from tools.experiments.object_world import SETTINGS

NO_WALLS = np.zeros((0, 4))
BEARINGS = np.linspace(-0.6, 0.6, 13)


def ring(near_m: Floats, far_m: Floats, bearings: Floats = BEARINGS) -> Floats:
    """A view from the origin, between two ranges at each bearing."""
    u = np.column_stack([np.cos(bearings), np.sin(bearings)])
    return np.vstack([far_m[:, None] * u, (near_m[:, None] * u)[::-1]])


@given(
    st.lists(st.tuples(st.floats(0.3, 3.0), st.floats(0.001, 3.0)), min_size=13, max_size=13),
    st.floats(-math.pi, math.pi),
    st.integers(0, 999),
)
def test_it_sees_what_lies_in_the_view_and_nothing_else(
    edges: list[tuple[float, float]], yaw_rad: float, seed: int
) -> None:
    near, deep = np.array(edges).T
    lens = np.array([3.0, -2.0])
    view = ring(near, near + deep, BEARINGS + yaw_rad) + lens
    sectors = sectors_of(view, (3.0, -2.0))
    shape = shapely.Polygon(view)
    points = lens + np.random.default_rng(seed).uniform(-4.0, 4.0, (200, 2))
    away = shapely.distance(shape.exterior, shapely.points(points))
    told = np.array([sees(sectors, *(point - lens).tolist()) for point in points])
    truth = shapely.contains_xy(shape, points[:, 0], points[:, 1])
    assert (told == truth)[away > 1e-9].all()


@pytest.mark.parametrize("yaw_rad", [0.0, math.pi, -2.0])
def test_a_view_that_begins_at_the_lens_is_seen_from_there_on(yaw_rad: float) -> None:
    sides = ring(BEARINGS * 0.0, BEARINGS * 0.0 + 3.0, BEARINGS + yaw_rad)[:13]
    sectors = sectors_of(np.vstack([[[0.0, 0.0]], sides]), (0.0, 0.0))
    for x in (0.01, 1.0, 2.9):
        assert sees(sectors, x * math.cos(yaw_rad), x * math.sin(yaw_rad))
    assert not sees(sectors, 3.1 * math.cos(yaw_rad), 3.1 * math.sin(yaw_rad))


def test_nothing_is_deleted_between_the_lens_and_the_floor_that_it_sees() -> None:
    objects = ObjectMap(SETTINGS)
    box = shapely.get_coordinates(shapely.box(0.4, -0.2, 0.8, 0.2).normalize())[:-1][::-1]
    whole = np.vstack([[[0.0, 0.0]], ring(BEARINGS * 0.0, BEARINGS * 0.0 + 0.37)[:13]])
    seen = FrameObjects(0.0, (0.0, 0.0), whole, (Detection(box, 0.0, 0.4, 500),), NO_WALLS)
    for k in range(40):
        objects.update(seen._replace(at_s=0.1 * k))
    assert len(objects.objects()) == 1
    beyond = ring(BEARINGS * 0.0 + 1.0, BEARINGS * 0.0 + 4.0)
    for k in range(200):
        objects.update(FrameObjects(10.0 + 0.1 * k, (0.0, 0.0), beyond, (), NO_WALLS))
    [still] = objects.objects()
    assert shapely.Polygon(still.polygon).area == pytest.approx(0.16, rel=0.1)
