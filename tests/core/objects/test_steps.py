"""Flying pixels, voxels, clusters, summits and hulls, each against a slow and obvious model."""

import numpy as np
import shapely
from hypothesis import given
from hypothesis import strategies as st

from core.objects.frame import hulls, outlines, pixels, summits, voxels
from core.objects.frame.room import Room
from core.records import F64
from tests.core.objects.scenes import camera
from tests.core.objects.test_frame import SETTINGS

EDGE_M, CLUSTER_M = 0.02, 0.05
ROOM = Room(camera(), SETTINGS)
NO_WARP = np.ones(20)
MIDDLES = st.integers(-500, 499).map(lambda k: 0.001 * k + 0.0005)  # on no edge of a voxel
WHERE = st.tuples(MIDDLES, MIDDLES, MIDDLES)
POINTS = st.lists(WHERE, min_size=1, max_size=60)
LUMPS = st.builds(  # things with gaps between them, for all random points alone are far apart
    lambda middles, seed, wide: np.concatenate(
        [m + np.random.default_rng(seed).uniform(-wide, wide, (15, 3)) for m in np.array(middles)]
    ),
    st.lists(WHERE, min_size=1, max_size=5), st.integers(0, 99), st.floats(0.005, 0.15),
)  # fmt: skip


def thinned(points: F64) -> int:
    n = len(points)
    for k, into in enumerate((ROOM.points.x, ROOM.points.y, ROOM.points.z)):
        into[:n] = points[:, k]
    ROOM.points.pixels[:n] = 1
    ROOM.used[:n] = 0
    return voxels.thin(ROOM.points, 0, 1, n, EDGE_M, ROOM.voxels)


def clustered(points: F64) -> tuple[int, int]:
    """How many voxels and clusters there are."""
    count = thinned(points)
    found = voxels.cluster(
        ROOM.voxels, count, ROOM.used, CLUSTER_M, 0.0, NO_WARP, ROOM.labels, ROOM.clusters
    )
    return count, found


def polygons(points: F64) -> list[F64]:
    count, found = clustered(points)
    outlines.measure(
        ROOM.voxels,
        count,
        ROOM.labels,
        0.0,
        ROOM.fan,
        ROOM.rim,
        ROOM.down_rad,
        ROOM.measures,
        found,
    )
    outlines.outline(
        ROOM.points, 0, 1, len(points), EDGE_M, ROOM.voxels, count, ROOM.labels, ROOM.columns,
        ROOM.measures, found,
    )  # fmt: skip
    gap_m = np.full(found, CLUSTER_M)
    x, y, begin = ROOM.columns.x, ROOM.columns.y, ROOM.measures.begin
    hulls.rings(x, y, begin, EDGE_M, ROOM.measures.columns, gap_m, found, ROOM.rings)
    return hulls.polygons_of(ROOM.rings, found, EDGE_M, 0.02)


def is_flying(ranges: F64, i: int, j: int, limits: pixels.Limits) -> bool:
    """By sections 2 and 6 of the sheet, pixel by pixel."""
    r, around = ranges[i, j], []
    for a in range(max(0, i - 1), min(len(ranges), i + 2)):
        around += [ranges[a, b] for b in range(max(0, j - 1), min(ranges.shape[1], j + 2))]
    around.remove(r)
    noise_m = pixels.APART * float(limits.noise_m + limits.noise_per_m2 * r * r)
    is_alone = min(abs(np.array(around) - r)) > max(limits.cluster_m, noise_m, limits.slant_rad * r)
    pairs = []
    if 0 < j < ranges.shape[1] - 1:
        pairs.append((*ranges[i, [j - 1, j + 1]], limits.steep_across))
    if 0 < i < len(ranges) - 1:
        pairs.append((*ranges[[i - 1, i + 1], j], limits.steep_down))
    return is_alone or any(
        min(a, b) > 0.0
        and (a < r < b or a > r > b)
        and min(abs(a - r), abs(b - r)) > steep * min(a, b)
        for a, b, steep in pairs
    )


@given(st.integers(0, 9999), st.integers(2, 5), st.integers(2, 9))
def test_flying_is_what_lies_between_its_neighbours_or_alone(
    seed: int, rows: int, columns: int
) -> None:
    random = np.random.default_rng(seed)
    steps_m = random.choice([0.0, 0.01, 0.07, 0.4], (rows, columns)) * random.normal(size=columns)
    ranges = np.maximum(0.0, 2.0 + steps_m) * (random.random((rows, columns)) < 0.9)
    at_all = pixels.Limits(*np.zeros(13, np.float32))
    near = {"noise_m": 0.001, "noise_per_m2": 0.0015, "cluster_m": 0.05, "slant_rad": 0.017}
    steep = {"steep_across": 0.032, "steep_down": 0.031}
    limits = at_all._replace(**{name: np.float32(one) for name, one in (near | steep).items()})
    padded = np.full((rows + 2 * pixels.RIM, columns + 2 * pixels.RIM), pixels.BEYOND_M, np.float32)
    middle = padded[pixels.RIM : -pixels.RIM, pixels.RIM : -pixels.RIM]
    middle[...] = ranges
    loose = np.zeros((rows, columns), np.uint8)
    for i in range(rows):
        pixels._find_loose(padded, i, limits, loose[i])
        wanted = [is_flying(middle.astype(np.float64), i, j, limits) for j in range(columns)]
        assert (loose[i] != 0).tolist() == wanted


@given(POINTS)
def test_a_voxel_is_the_mean_of_its_points(given_points: list[tuple[float, float, float]]) -> None:
    points = np.array(given_points, np.float32).astype(np.float64)
    of: dict[tuple[int, ...], list[F64]] = {}
    for point in points:
        of.setdefault(tuple(np.floor(point * (1.0 / EDGE_M)).astype(int)), []).append(point)
    count = thinned(points)
    assert count == len(of)
    means = np.column_stack([ROOM.voxels.x, ROOM.voxels.y, ROOM.voxels.z])[:count]
    np.testing.assert_allclose(means, [np.mean(one, axis=0) for one in of.values()], atol=1e-5)
    assert ROOM.voxels.pixels[:count].tolist() == [len(one) for one in of.values()]


@given(LUMPS)
def test_what_is_near_is_joined_and_what_no_chain_joins_is_not(points: F64) -> None:
    count, found = clustered(points)
    at = np.column_stack([ROOM.voxels.x, ROOM.voxels.y, ROOM.voxels.z])[:count].astype(np.float64)
    apart = np.linalg.norm(at[:, None] - at[None], axis=2)
    labels = ROOM.labels[:count]
    same = labels[:, None] == labels[None]
    assert same[apart < CLUSTER_M - 1e-6].all()
    reach = apart < np.sqrt(3.0) * CLUSTER_M + 1e-6  # the farthest within a cell
    for _ in range(count.bit_length()):
        reach = reach @ reach
    assert not same[~reach].any()
    assert set(labels.tolist()) == set(range(found))


@given(LUMPS)
def test_polygons_are_valid_and_hold_all_points(points: F64) -> None:
    told = polygons(points)
    shapes = [shapely.Polygon(one) for one in told]
    assert all(shape.is_valid and shape.exterior.is_ccw for shape in shapes)
    whole = shapely.union_all([shapely.buffer(shape, 0.02 + EDGE_M) for shape in shapes])
    assert shapely.contains_xy(whole, points[:, 0], points[:, 1]).all()


def test_what_is_thin_is_a_voxel_wide_along_all_of_its_length() -> None:
    x = np.arange(0.0, 0.4, 0.004)
    y = 0.25 * x + np.random.default_rng(1).uniform(-0.002, 0.002, len(x))
    [told] = polygons(np.column_stack([x, y, np.full(len(x), 0.1)]))
    shape = shapely.Polygon(told)
    assert shape.contains(shapely.MultiPoint(np.column_stack([x, y])))
    assert shape.area >= EDGE_M * np.hypot(0.4, 0.1)


def test_two_faces_of_a_box_stay_an_angle() -> None:
    along, up = (
        a.ravel() for a in np.meshgrid(np.arange(0.0, 0.6, 0.004), np.arange(0, 0.2, 0.02))
    )
    one = np.column_stack([along, np.zeros_like(along), up])
    faces = np.concatenate([one, one[:, [1, 0, 2]]])
    faces[:, :2] += np.random.default_rng(1).normal(0.0, 0.002, (len(faces), 2))
    [told] = polygons(faces)
    assert shapely.Polygon(told).area < 0.01  # its convex hull has 0.18
    assert len(told) < 9


def standing(y_m: float, top_m: float) -> F64:
    """A person's front: shoulders 0.5 m wide up to 0.3 m below the top, a head."""
    y, z = np.meshgrid(np.arange(-0.25, 0.25, 0.01), np.arange(0.05, top_m, 0.01))
    is_body = (z < top_m - 0.3) | (np.abs(y) < 0.08)
    return np.column_stack([np.full(is_body.sum(), 2.0), y[is_body] + y_m, z[is_body]])


def test_two_people_shoulder_to_shoulder_are_two_and_a_table_is_one() -> None:
    table = np.column_stack(
        [a.ravel() for a in np.meshgrid(np.arange(2.0, 2.4, 0.02), np.arange(0, 1.2, 0.02), [1.1])]
    )
    for points, many in (
        (np.concatenate([standing(0.0, 1.8), standing(0.5, 1.7)]), 2),
        (np.concatenate([standing(0.0, 0.9), standing(0.5, 0.9)]), 1),  # too low to be people
        (table, 1),
    ):
        count, found = clustered(points)
        assert found == 1
        parts = summits.part(
            ROOM.voxels, count, ROOM.labels, 0.2, ROOM.clusters, ROOM.columns, ROOM.bins
        )
        assert parts == many
        assert set(ROOM.labels[:count].tolist()) == set(range(many))
