"""A frame's steps on scenes with truth: what they find and doubt, and nothing told unseen."""

import math

import msgspec
import numpy as np
import pytest
import shapely
from hypothesis import example, given
from hypothesis import strategies as st
from numba.core.dispatcher import Dispatcher

from core.objects.frame import (
    floor,
    hulls,
    outlines,
    pixels,
    summits,
    view,
    voxels,
    wall_ends,
    wall_lines,
)
from core.objects.frame.settings import FrameSettings
from core.objects.frame.steps import CameraPose, FrameResult, FrameSteps
from core.records import DepthCamera, DepthImage
from jit import COMPILED
from tests.core.objects.scenes import (
    F64,
    FOCAL_PX,
    SIZE,
    Box,
    Scene,
    camera,
    column,
    image,
    met,
    placed,
    pose,
)

SETTINGS = FrameSettings(
    min_range_m=0.2, max_range_m=5.0, noise_m=0.003, noise_per_m2=0.0, top_m=1.2, floor_m=0.03,
    low_m=0.01, pit_m=0.05, flying_deg=3.0, voxel_m=0.02, cluster_m=0.05, least_m=0.05,
    hull_m=0.02, wall_m=0.05, wall_length_m=0.8, wall_height_m=0.5, summit_m=0.2,
)  # fmt: skip
NO_WALLS = np.zeros((0, 4))
CAMERA, T = camera(), placed(0.6, 25.0)


def found(
    scene: Scene, at: F64 = T, known: CameraPose | None = None, walls: F64 = NO_WALLS,
    settings: FrameSettings = SETTINGS, **of: float,
) -> FrameResult:  # fmt: skip
    frame = image(scene, at, CAMERA, **of)  # type: ignore[arg-type]
    return FrameSteps(settings).find(frame, pose(at) if known is None else known, walls)


def tells_nothing(result: FrameResult) -> bool:
    told = result.objects
    return len(told.view) == 0 and told.detections == () and len(told.walls) == 0


@pytest.mark.parametrize("roll_deg", [-1.5, 0.0, 1.5])
def test_the_floor_tells_how_far_the_pose_is_off(roll_deg: float) -> None:
    true = placed(0.62, 26.0, roll_deg, yaw_deg=70.0)
    known = pose(placed(0.6, 25.0, 0.0, yaw_deg=70.0))
    floor = found(Scene(), true, known).floor
    assert floor is not None
    assert floor.height_m == pytest.approx(0.62, abs=0.002)
    errors = [floor.height_m - 0.62, floor.pitch_rad - math.radians(1.0)]
    about_level = math.radians(roll_deg) * math.cos(math.radians(26.0))
    errors.append(floor.roll_rad - about_level)
    sigmas = np.sqrt(np.diag(floor.covariance))
    assert (np.abs(errors) < [0.002, 0.0005, 0.0005]).all()
    assert (sigmas < [0.005, 0.005, 0.005]).all()


def test_the_lens_is_where_the_camera_says_that_it_is() -> None:
    of = camera((0.05, 0.02, -0.03))
    box = Box(1.5, 0.2, 0.3, 0.3, 0.0, 0.3)
    result = FrameSteps(SETTINGS).find(image(Scene((box,)), T, of, 0.001), pose(T), NO_WALLS)
    lens = T[:3, :3] @ np.array(of.offset_m) + T[:3, 3]
    assert result.floor is not None
    assert result.floor.height_m == pytest.approx(lens[2], abs=0.002)
    assert result.objects.origin == pytest.approx(lens[:2])
    [told] = result.objects.detections
    assert told.polygon.mean(axis=0) == pytest.approx([1.5, 0.2], abs=0.03)


def test_the_floor_is_found_where_seven_tenths_of_it_are_hidden() -> None:
    boxes = tuple(Box(0.8, y, 0.2, 0.42, 0.0, 0.45) for y in (-0.48, 0.0, 0.48))
    result = found(Scene(boxes), known=pose(placed(0.61, 25.5)))
    bare = met(Scene(), T[:3, 3], CAMERA.rays.reshape(-1, 3) @ T[:3, :3].T)
    shown = met(Scene(boxes), T[:3, 3], CAMERA.rays.reshape(-1, 3) @ T[:3, :3].T)
    near = bare * np.linalg.norm(CAMERA.rays.reshape(-1, 3), axis=1) < 5.0
    assert np.mean(shown[near] < bare[near]) > 0.7
    assert result.floor is not None
    assert result.floor.height_m == pytest.approx(0.6, abs=0.004)
    assert result.floor.pitch_rad == pytest.approx(math.radians(-0.5), abs=0.004)


@pytest.mark.parametrize("far_m", [1.0, 2.0, 3.0])
@pytest.mark.parametrize("yaw_deg", [0.0, 30.0])
def test_a_box_becomes_four_corners(far_m: float, yaw_deg: float) -> None:
    box = Box(far_m, 0.1, 0.3, 0.4, 0.0, 0.25, math.radians(yaw_deg))
    told = found(Scene((box,)), noise_m=0.001).objects.detections
    assert len(told) == 1
    away = np.hypot(*(told[0].polygon[:, None] - box.corners[None]).transpose(2, 0, 1))
    between_rows_m = (far_m + 0.2) ** 2 / FOCAL_PX / (0.6 - 0.25)  # on its top: no ray met more
    assert 4 <= len(told[0].polygon) <= (4 if between_rows_m < 0.025 else 5)
    assert away.min(axis=0).max() < 0.02 + 0.75 * between_rows_m
    assert told[0].top_m == pytest.approx(0.25, abs=0.015)
    assert told[0].bottom_m < 0.06


@given(
    st.floats(0.8, 3.0), st.floats(-0.35, 0.35), st.floats(0.1, 1.1), st.floats(10.0, 40.0),
    st.floats(-3.0, 3.0),
)  # fmt: skip
def test_what_goes_on_above_the_image_is_cut_and_nothing_else(
    far_m: float, aside: float, high_m: float, pitch_deg: float, roll_deg: float
) -> None:
    at = placed(0.6, pitch_deg, roll_deg)
    box = Box(far_m, aside * far_m, 0.1, 0.3, 0.0, high_m)
    told = found(Scene((box,)), at, noise_m=0.001).objects.detections
    front = np.array([[far_m - 0.05, y] for y in box.y_m + np.linspace(-0.15, 0.15, 7)])
    x, y, z = (CAMERA.rays[0, ::-1].astype(float) @ at[:3, :3].T).T  # the image's first row
    rise = np.interp(front[:, 1] / front[:, 0], y / x, z / x)
    most_m = 0.6 + rise * front[:, 0]
    row_m = far_m / FOCAL_PX * (1.0 + rise.min() ** 2)
    if len(told) == 1 and high_m > most_m.max():
        assert told[0].is_cut
    if high_m < most_m.min() - 4.0 * row_m - 0.03:
        assert not any(one.is_cut for one in told)


def test_noise_of_ranges_makes_no_thing_larger() -> None:
    noise_m, box = 0.012, Box(2.2, 0.0, 0.3, 0.4, 0.0, 0.3)
    settings = msgspec.structs.replace(SETTINGS, noise_m=noise_m)
    stand_out_m = list[float]()
    for seed in range(6):
        [told] = found(
            Scene((box,)), settings=settings, noise_m=noise_m, seed=seed
        ).objects.detections
        stand_out_m.append(box.corners[:, 0].min() - told.polygon[:, 0].min())
    assert abs(np.mean(stand_out_m)) < 1.5 * noise_m  # without care: three of them


def test_far_small_things_count_and_noise_does_not() -> None:
    boxes = tuple(Box(x, y, 0.1, 0.1, 0.0, 0.1) for x, y in ((1.0, 0.2), (2.0, -0.3), (3.5, 0.4)))
    told = found(Scene(boxes), noise_m=0.003, lost=0.05).objects.detections
    middles = sorted(tuple(one.polygon.mean(axis=0).round(1)) for one in told)
    assert len(told) == 3, middles
    assert found(Scene(), noise_m=0.004, lost=0.2, seed=3).objects.detections == ()


def test_a_mixed_range_at_an_edge_before_what_is_out_of_reach_bars_no_way() -> None:
    """Such a pixel has any range; it stood as an obstacle right before the robot."""
    at = placed(0.6, 12.0)
    frame = image(Scene((Box(2.5, 0.0, 0.3, 0.4, 0.0, 1.1),)), at, CAMERA)
    numbers = frame.numbers.copy()
    edge = np.argwhere((numbers[:, :-1] > 0) & (numbers[:, 1:] == 0))[::3]
    assert len(edge) > 5
    numbers[edge[:, 0], edge[:, 1] + 1] = np.linspace(1200, 7000, len(edge))
    steps, mixed = FrameSteps(SETTINGS), DepthImage(1.5, numbers, CAMERA, 7, 1.6)
    told = steps.find(mixed, pose(at), NO_WALLS)
    assert len(told.objects.detections) == 1
    assert steps.room.ranges[steps.room.kinds == pixels.THING].min() > 2.2


@pytest.mark.parametrize("far_m", [1.0, 1.8])
def test_a_sill_and_a_carpet_are_told_as_low_things(far_m: float) -> None:
    sill, carpet = Box(far_m, 0.0, 0.08, 0.9, 0.0, 0.015), Box(2.8, 0.0, 0.8, 0.8, 0.0, 0.012)
    told = sorted(
        found(Scene((sill, carpet))).objects.detections, key=lambda one: one.polygon[0, 0]
    )
    assert len(told) == 2
    for one, box in zip(told, (sill, carpet), strict=True):
        true = shapely.Polygon(box.corners)
        both = shapely.intersection(true, shapely.Polygon(one.polygon))
        assert both.area > 0.7 * true.area
        assert one.top_m == pytest.approx(box.high_m, abs=0.004)


def test_a_mat_over_most_of_the_view_does_not_become_the_floor() -> None:
    mat = Box(2.6, 0.0, 3.4, 4.0, 0.0, 0.04)  # bare floor in front of it alone
    result = found(Scene((mat,)))
    assert result.floor is not None
    assert result.floor.share < 0.45
    assert result.floor.height_m == pytest.approx(0.6, abs=0.004)
    assert max(shapely.Polygon(one.polygon).area for one in result.objects.detections) > 3.0


COARSE = camera(size=(106, 128), focal_px=91.0)  # 70 degrees, as `robots/cleaner.toml` halves it


@pytest.mark.parametrize("pitch_deg", [45.0, 55.0])
def test_a_coarse_image_from_steeply_above_shows_the_floor_at_all_bearings(
    pitch_deg: float,
) -> None:
    """Right below the lens bearings are narrower than pixels: half of them were lost for good."""
    at, settings = placed(1.1, pitch_deg), msgspec.structs.replace(SETTINGS, max_range_m=3.6)
    frame = image(Scene(), at, COARSE, noise_m=0.0005)
    told = FrameSteps(settings).find(frame, pose(at), NO_WALLS).objects
    rays = COARSE.rays.reshape(-1, 3).astype(np.float64) @ at[:3, :3].T
    far = met(Scene(), at[:3, 3], rays)
    ends = (at[:3, 3] + far[:, None] * rays)[far * np.linalg.norm(rays, axis=1) < 3.6]
    true = shapely.MultiPoint(ends[:, :2]).convex_hull
    assert shapely.Polygon(told.view).intersection(true).area > 0.85 * true.area


@pytest.mark.parametrize("off_m", [-0.02, 0.0, 0.02])
def test_a_platform_behind_a_strip_of_floor_is_not_the_floor(off_m: float) -> None:
    at, known = placed(1.1, 55.0), pose(placed(1.1 + off_m, 55.0), 0.04)
    platform = Box(3.6, 0.0, 6.0, 12.0, 0.0, 0.08)
    result = FrameSteps(SETTINGS).find(image(Scene((platform,)), at, COARSE), known, NO_WALLS)
    top = shapely.Polygon(platform.corners).buffer(-0.03)
    assert result.floor is not None
    assert result.floor.height_m == pytest.approx(1.1, abs=0.005)
    assert shapely.Polygon(result.objects.view).intersection(top).area < 0.01


def test_where_floor_is_missing_the_frame_says_so_and_sees_nothing_beyond_the_edge() -> None:
    hole = Box(2.5, 0.0, 1.6, 3.0, -0.4, 0.0)
    told = found(Scene(holes=(hole,))).objects
    pits = [one for one in told.detections if one.bottom_m < 0.0]
    assert len(pits) == 1
    assert pits[0].polygon[:, 0].min() == pytest.approx(1.7, abs=0.08)
    inside = shapely.intersection(shapely.Polygon(told.view), shapely.box(1.75, -0.8, 3.0, 0.8))
    assert inside.area < 0.01


@pytest.mark.parametrize(
    ("numbers", "doubt"), [(0, "no floor"), (65535, "no floor"), (1, "no floor")]
)
def test_an_image_of_one_number_tells_nothing(numbers: int, doubt: str) -> None:
    frame = DepthImage(0.0, np.full(SIZE, numbers, np.uint16), CAMERA, 0, 0.0)
    result = FrameSteps(SETTINGS).find(frame, pose(T), NO_WALLS)
    assert result.doubt == doubt
    assert tells_nothing(result)


def test_without_a_floor_in_sight_nothing_is_told() -> None:
    for scene in (Scene((Box(0.8, 0.0, 0.1, 4.0, 0.0, 3.0),)), Scene(floor_m=-1.0)):
        result = found(scene, known=pose(placed(0.6, 5.0)), at=placed(0.6, 5.0))
        assert result.doubt == "no floor"
        assert tells_nothing(result)


@pytest.mark.parametrize("off_deg", [4.0, -4.0, 9.0, -9.0, 16.0])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_wrong_matrix_tells_nothing(off_deg: float, axis: int) -> None:
    off = np.eye(3)[axis] * off_deg
    true = placed(0.6 + 0.025 * off[0], 25.0 + off[1], off[2])
    things = Box(1.2, 0.3, 0.2, 0.2, 0.0, 0.15), Box(2.0, -0.4, 0.3, 0.3, 0.0, 0.3)
    result = found(Scene(things), true, pose(T))
    assert result.doubt == "no floor"
    assert tells_nothing(result)


def test_a_pose_or_an_image_that_is_none_is_told() -> None:
    frame, steps = image(Scene(), T, CAMERA), FrameSteps(SETTINGS)
    bad = [np.full((4, 4), np.nan), np.eye(3), 2.0 * np.eye(4), placed(-0.1, 20.0)]
    for matrix in bad:
        assert steps.find(frame, pose(matrix), NO_WALLS).doubt == "pose"
    assert steps.find(frame, pose(T)._replace(sigma_yaw_rad=0.0), NO_WALLS).doubt == "pose"
    narrow = msgspec.structs.replace(frame, numbers=frame.numbers[:, :100])
    assert steps.find(narrow, pose(T), NO_WALLS).doubt == "image"


def test_known_walls_are_taken_away_and_tell_where_the_camera_is() -> None:
    true = placed(0.6, 15.0, x_m=0.05, y_m=-0.04, yaw_deg=0.6)
    boxes = (Box(3.05, 0.0, 0.1, 5.0, 0.0, 1.0), Box(1.5, 1.25, 3.1, 0.1, 0.0, 1.0))
    walls = np.array([[3.0, -2.5, 3.0, 2.5], [0.0, 1.2, 3.0, 1.2]])
    known = pose(placed(0.6, 15.0))._replace(sigma_xy_m=0.05)
    result = found(Scene((*boxes, Box(1.8, -0.3, 0.3, 0.3, 0.0, 0.4))), true, known, walls)
    assert result.correction is not None
    told = result.correction
    errors = np.array([told.x_m - 0.05, told.y_m + 0.04, told.yaw_rad - math.radians(0.6)])
    sigmas = np.sqrt(np.diag(told.covariance))
    assert (np.abs(errors) < np.maximum(3.0 * sigmas, [0.01, 0.01, 0.003])).all()
    assert (sigmas < [0.03, 0.03, 0.01]).all()
    assert len(result.objects.detections) == 1
    ends = result.objects.walls.reshape(-1, 2)  # as the frame saw them: off as its pose is
    ends = ends @ placed(0.0, 0.0, yaw_deg=math.degrees(told.yaw_rad))[:2, :2].T
    assert ends + np.array([told.x_m, told.y_m]) == pytest.approx(
        np.array([[3.0, -1.75], [3.0, 1.25], [2.02, 1.2], [3.0, 1.2]]), abs=0.1
    )


@pytest.mark.parametrize(("off_m", "is_believed"), [(0.03, True), (0.10, False)])
def test_walls_that_are_farther_off_than_the_pose_can_be_tell_nothing_of_it(
    off_m: float, is_believed: bool
) -> None:
    """A row of boxes, a rack's posts, a wall drawn a little askew: another one than is known."""
    boxes = (Box(3.05, 0.0, 0.1, 5.0, 0.0, 1.0), Box(1.5, 1.25, 3.1, 0.1, 0.0, 1.0))
    walls = np.array([[3.0 + off_m, -2.5, 3.0 + off_m, 2.5], [0.0, 1.2, 3.0, 1.2]])
    at = placed(0.6, 15.0)
    known = pose(at)._replace(sigma_xy_m=0.02, sigma_yaw_rad=0.01)
    told = found(Scene(boxes), at, known, walls)
    assert told.correction is not None
    if is_believed:
        assert told.correction.x_m == pytest.approx(off_m, abs=0.01)
        return
    assert (told.correction.x_m, told.correction.y_m, told.correction.yaw_rad) == (0.0, 0.0, 0.0)
    assert math.sqrt(told.correction.covariance[0, 0]) == pytest.approx(0.02)
    assert len(told.objects.walls) == 2  # the wall that was met, beside the one that is known


def test_a_wall_is_followed_beyond_what_the_map_knows_of_it_to_its_corner() -> None:
    boxes = (Box(3.05, 0.0, 0.1, 5.0, 0.0, 1.0), Box(1.5, 1.25, 3.1, 0.1, 0.0, 1.0))
    walls = np.array([[3.0, -2.5, 3.0, 0.6], [0.0, 1.2, 2.3, 1.2]])
    told = found(Scene(boxes), placed(0.6, 15.0), walls=walls).objects
    assert told.detections == ()
    assert np.hypot(*(told.walls.reshape(-1, 2) - [3.0, 1.2]).T).min() < 0.1


def test_what_stands_at_the_end_of_a_wall_and_out_of_it_is_no_wall() -> None:
    wall, person = Box(3.05, -1.4, 0.1, 2.2, 0.0, 1.0), Box(3.05, -0.09, 0.3, 0.4, 0.0, 1.1)
    known = np.array([[3.0, -2.5, 3.0, -0.3]])
    told = found(Scene((wall, person)), placed(0.6, 15.0), walls=known).objects
    [one] = told.detections
    assert np.ptp(one.polygon[:, 1]) > 0.35
    assert told.walls[:, [1, 3]].max() < -0.25


@pytest.mark.parametrize("thick_m", [0.1, 0.3])
def test_on_a_walls_line_a_further_piece_is_wall_and_what_stands_out_of_it_is_none(
    thick_m: float,
) -> None:
    """A door between; behind both lines the end faces are seen, which are no things either."""
    wall = Box(3.05, 1.6, 0.1, 1.8, 0.0, 1.0)
    other = Box(3.05, -0.55, thick_m, 0.5, 0.0, 1.0)
    known = np.array([[3.0, 0.7, 3.0, 2.5]])
    told = found(Scene((wall, other)), placed(0.6, 15.0), walls=known).objects
    assert bool(told.detections) == (thick_m > 0.1)
    ends = told.walls[:, [1, 3]]
    assert ends.min() == pytest.approx(-0.8 if thick_m == 0.1 else 0.7, abs=0.06)


@pytest.mark.parametrize("into_m", [0.04, 0.12, 0.2])
@pytest.mark.parametrize("aside_m", [0.0, 0.3])
@pytest.mark.parametrize("at_m", [0.0, 1.2])
def test_somebody_in_a_door_is_no_piece_of_its_wall(
    into_m: float, aside_m: float, at_m: float
) -> None:
    """Both his flanks are seen behind the wall's line: a piece of wall shows one end at most."""
    ends = (0.7, 4.7), (-0.7, -4.7)
    walls = tuple(Box(3.1, (a + b) / 2, 0.2, abs(b - a), 0.0, 1.1) for a, b in ends)
    known = np.array([[x, a, x, b] for x in (3.0, 3.2) for a, b in ends])
    body = column(3.1 + into_m, aside_m, 0.22, 1.2)
    yaw_deg = math.degrees(math.atan2(aside_m - at_m, 2.0))
    place = placed(0.7, 15.0, yaw_deg=yaw_deg, x_m=1.1, y_m=at_m)
    told = found(Scene((*walls, *body)), place, walls=known).objects
    middle = shapely.Point(3.1 + into_m, aside_m)
    assert any(shapely.Polygon(one.polygon).dwithin(middle, 0.25) for one in told.detections)


@pytest.mark.parametrize("known", [NO_WALLS, np.array([[2.0, -2.5, 2.0, 2.5]])])
@pytest.mark.parametrize("out_m", [0.0, 0.08])
def test_a_post_that_stands_out_of_a_wall_is_a_thing(known: F64, out_m: float) -> None:
    """`wall_m` and noise together reach farther than it stands out."""
    wall, post = Box(2.05, 0.0, 0.1, 5.0, 0.0, 1.0), Box(2.04 - out_m, 0.3, 0.08, 0.08, 0.0, 1.0)
    settings = msgspec.structs.replace(SETTINGS, wall_m=0.06, noise_m=0.012)
    told = found(Scene((wall, post)), placed(0.6, 15.0), walls=known, settings=settings).objects
    assert len(told.walls) == 1
    assert len(told.detections) == (out_m > 0.0)
    for one in told.detections:
        assert one.polygon[:, 0].min() == pytest.approx(1.92, abs=0.015)
        assert np.abs(one.polygon[:, 1] - 0.3).max() < 0.06


def test_walls_along_one_direction_leave_the_other_as_unsure_as_it_was() -> None:
    wall = Scene((Box(3.05, 0.0, 0.1, 5.0, 0.0, 1.0),))
    at = placed(0.6, 15.0)
    told = found(wall, at, walls=np.array([[3.0, -2.5, 3.0, 2.5]])).correction
    assert told is not None
    assert math.sqrt(told.covariance[1, 1]) == pytest.approx(0.03, rel=0.05)


def test_a_long_upright_plane_becomes_a_wall_and_a_box_does_not() -> None:
    at = placed(0.6, 12.0, yaw_deg=90.0)
    wall, box = Box(0.0, 3.05, 4.0, 0.1, 0.0, 1.1), Box(1.0, 2.0, 0.4, 0.4, 0.0, 0.6)
    told = found(Scene((wall, box)), at).objects
    assert len(told.walls) == 1
    assert told.walls[0, [1, 3]] == pytest.approx(3.0, abs=0.02)
    assert abs(told.walls[0, 2] - told.walls[0, 0]) > 2.8
    assert sum(one.polygon[:, 1].max() < 2.9 for one in told.detections) == 1


def test_a_replay_gives_the_same_bits_whatever_was_seen_before() -> None:
    scene = Scene((Box(1.5, 0.2, 0.3, 0.3, 0.0, 0.3), Box(2.0, -0.5, 0.1, 0.8, 0.0, 1.0)))
    frame, other = image(scene, T, CAMERA), image(Scene(), T, CAMERA, seed=5)
    once, steps = FrameSteps(SETTINGS).find(frame, pose(T), NO_WALLS), FrameSteps(SETTINGS)
    for _ in range(2):
        steps.find(other, pose(T), NO_WALLS)
        again = steps.find(frame, pose(T), NO_WALLS)
        assert again.objects.view.tobytes() == once.objects.view.tobytes()
        assert repr(again.objects.detections) == repr(once.objects.detections)
        assert again.floor is not None
        assert once.floor is not None
        assert again.floor.covariance.tobytes() == once.floor.covariance.tobytes()


FLOATS = st.floats(-1.0, 1.0)
BOXES = st.lists(
    st.builds(
        lambda x, y, a, b, h, low, yaw: Box(x, y, a, b, low * h, h, yaw),
        st.floats(0.9, 4.0), FLOATS, st.floats(0.02, 1.0), st.floats(0.02, 1.0),
        st.floats(0.03, 1.5), st.floats(0.0, 0.9), st.floats(0.0, 3.0),
    ),
    max_size=4,
)  # fmt: skip


@example([Box(3.75, 0.0, 0.125, 1.0, 0.0, 0.03125)], 5.0, 0.375, 0)  # hides more than it shows
@given(boxes=BOXES, pitch=st.floats(5.0, 45.0), height=st.floats(0.3, 1.0), seed=st.integers(0, 99))
def test_nothing_counts_as_seen_behind_what_stands_in_the_way(
    boxes: list[Box], pitch: float, height: float, seed: int
) -> None:
    at = placed(height, pitch)
    told = found(Scene(tuple(boxes)), at, seed=seed, lost=0.05).objects
    if len(told.view) == 0:
        return
    view = shapely.Polygon(told.view)
    assert view.is_valid
    assert shapely.is_ccw(shapely.linearrings(told.view))
    random = np.random.default_rng(seed)
    low, high = told.view.min(axis=0), told.view.max(axis=0)
    places = random.uniform(low, high, (300, 2))
    places = places[shapely.contains_xy(shapely.buffer(view, -0.05), places[:, 0], places[:, 1])]
    rays = np.column_stack([places, np.zeros(len(places))]) - at[:3, 3]
    sensor = rays @ at[:3, :3]
    aside = np.abs(sensor[:, 1:] / sensor[:, :1]) * FOCAL_PX
    assert (aside <= np.array([SIZE[1], SIZE[0]]) / 2).all()  # the camera looked there at all
    blocked = met(Scene(tuple(boxes)), at[:3, 3], rays) < 0.97
    assert np.mean(blocked) <= 0.02 if len(blocked) > 0 else True


@given(st.binary(min_size=64, max_size=64), st.integers(0, 5))
def test_no_numbers_make_it_raise(noise: bytes, kind: int) -> None:
    small = DepthCamera(np.ascontiguousarray(CAMERA.rays[::15, ::15]), (0.0, 0.0, 0.0))
    rows, columns, _ = small.rays.shape
    random = np.random.default_rng(list(noise))
    numbers = random.integers(0, [2, 100, 5000, 20000, 65536, 8000][kind], (rows, columns))
    frame = DepthImage(0.0, numbers.astype(np.uint16), small, 0, 0.0)
    result = FrameSteps(SETTINGS).find(frame, pose(T), NO_WALLS)
    assert result.doubt == "" or tells_nothing(result)


def test_rays_that_are_no_numbers_tell_nothing() -> None:
    for value in (0.0, np.nan, np.inf):
        rays = np.full((*SIZE, 3), value, np.float32)
        frame = DepthImage(
            0.0, np.full(SIZE, 900, np.uint16), DepthCamera(rays, (0.0,) * 3), 0, 0.0
        )
        assert tells_nothing(FrameSteps(SETTINGS).find(frame, pose(T), NO_WALLS))


def test_warming_compiles_all_that_a_frame_needs() -> None:
    if not COMPILED:
        return
    FrameSteps(SETTINGS).warm()
    kernels = [
        one
        for module in (
            *(floor, hulls, outlines, pixels, summits, view, voxels, wall_ends, wall_lines),
        )
        for one in vars(module).values()
        if isinstance(one, Dispatcher)
    ]
    before = [len(one.signatures) for one in kernels]
    wall = Box(3.05, 0.0, 0.1, 5.0, 0.0, 1.0)
    things = Box(1.5, 0.3, 0.3, 0.3, 0.0, 0.4), Box(1.5, -0.5, 0.4, 0.4, 0.0, 0.02)
    scene = Scene((wall, *things), holes=(Box(2.0, 0.5, 0.3, 0.3, -0.4, 0.0),))
    known = np.array([[3.0, -2.5, 3.0, 2.5]])
    for walls_given in (NO_WALLS, known):
        frame = image(scene, placed(0.6, 20.0), CAMERA)
        frame.numbers.setflags(write=False)
        FrameSteps(SETTINGS).find(frame, pose(placed(0.6, 20.0)), walls_given)
    assert [len(one.signatures) for one in kernels] == before
