"""What scenes leave to chance: things that are scattered, slopes, mirrors, rooms, goals."""

import math
from pathlib import Path

import numpy as np
import pytest

from fakes.scenes.scatter import apart_m, away_m, cut, ground_m
from fakes.scenes.scene import Scene, load_scene, problems
from fakes.scenes.solids import Shape, Solid
from fakes.scenes.things import KINDS, Frame

BOX = '[[solid]]\nname = "a"\nx = [0, 1]\ny = [0, 1]\nz = [0, 1]\n'
FLOOR = """
x_axis_east_of_north_deg = 0.0
[[solid]]
name = "floor"
x = [-12.0, 30.0]
y = [-10.0, 10.0]
z = [-1.0, 0.0]
"""


def scene_of(folder: Path, text: str, seed: int = 1) -> Scene:
    """A floor and what is told."""
    file = folder / "some.toml"
    file.write_text(FLOOR + text)
    return load_scene(file, seed)


def scattered(kind: str, more: str = "", count: str = "[3, 6]", area: str = "[10, 28]") -> str:
    return f'[[scatter]]\nkind = "{kind}"\ncount = {count}\nx = {area}\ny = [-9, 9]\n{more}\n'


def test_a_seed_gives_the_same_scene_and_counts_sizes_and_areas_are_kept(tmp_path: Path) -> None:
    text = scattered("box", "size_m = [0.3, 0.5]\nheight_m = [0.2, 0.4]", "[2, 4]")
    scenes = [scene_of(tmp_path, text + scattered("walker"), seed) for seed in range(12)]
    assert scene_of(tmp_path, text + scattered("walker"), 11) == scenes[11]
    assert len({scene.solids for scene in scenes}) == 12
    assert len({scene.walkers for scene in scenes}) == 12
    assert {len(scene.solids) - 1 for scene in scenes} == {2, 3, 4}
    for box in (box for scene in scenes for box in scene.solids[1:]):
        assert isinstance(box, Solid)
        assert 0.3 <= box.x[1] - box.x[0] <= 0.5
        assert 0.2 <= box.z[1] <= 0.4
        assert 10.0 <= sum(box.x) / 2 <= 28.0


def test_things_keep_away_from_the_start_the_goals_and_each_other(tmp_path: Path) -> None:
    goals = "[goals]\nareas = [{x = [12, 20], y = [-3, 3]}]\n"
    more = "keep_m = 12.0\ngap_m = 2.0\ngoal_m = 2.5"
    text = goals + scattered("box", more, "[4, 8]", "[0, 28]")
    for seed in range(10):
        scene = scene_of(tmp_path, text, seed)
        rects = [(solid.x, solid.y) for solid in scene.solids[1:]]
        assert min(away_m((0.0, 0.0), rect) for rect in rects) >= 12.0
        assert min(away_m(scene.goals[0], rect) for rect in rects) >= 2.5
        pairs = [(a, b) for k, a in enumerate(rects) for b in rects[:k]]
        assert min(apart_m(a, b) for a, b in pairs) >= 2.0


def test_what_finds_no_place_makes_the_scene_be_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="seed 1 draws no scene"):
        scene_of(tmp_path, scattered("walker", "long_m = 80.0", "[1, 1]"))


@pytest.mark.slow
def test_a_goal_that_cannot_be_reached_is_refused_unless_the_file_says_that_it_may_be_so(
    tmp_path: Path,
) -> None:
    wall = 'solid]]\nname = "wall"\nx = [12.0, 12.2]\ny = [-10.0, 10.0]\nz = [-1.0, 2.5]\n'
    text = f"[goals]\nareas = [{{x = [15, 15], y = [0, 0]}}]\n[[{wall}"
    file = tmp_path / "unfair.toml"
    file.write_text("fair = false" + FLOOR + text)
    unfair = load_scene(file)
    assert unfair.goals == ((15.0, 0.0),)
    assert problems(unfair)
    with pytest.raises(ValueError, match=r"without problems: goal 15\.00, 0\.00"):
        scene_of(tmp_path, text)


def test_things_stand_on_the_ground_and_not_across_a_kerb(tmp_path: Path) -> None:
    low = '[[solid]]\nname = "road"\nx = [30, 60]\ny = [-10, 10]\nz = [-1, -0.2]\n'
    heights = set()
    for seed in range(12):
        scene = scene_of(tmp_path, low + scattered("pallet", "", "[4, 4]", "[25, 35]"), seed)
        for wood in (solid for solid in scene.solids[2:] if solid.name.endswith("wood")):
            assert isinstance(wood, Solid)
            heights.add(round(wood.z[1], 6))
            assert not wood.x[0] < 30.0 < wood.x[1]
    assert heights == {0.16, -0.04}


def test_on_a_slope_nothing_is_lower_than_it_was_made(tmp_path: Path) -> None:
    slope = '[[ramp]]\nname = "up"\nx = [30, 60]\ny = [-10, 10]\nrise_deg = 3.0\nalong = "x"\n'
    text = slope + scattered("box", "height_m = [0.3, 0.3]", "[3, 3]", "[35, 50]")
    _, ramp, *boxes = scene_of(tmp_path, text).solids
    assert len(boxes) == 3
    for box in boxes:
        assert isinstance(box, Solid)
        under = [ramp.tops_m(np.array([x]), np.array([0.0]))[0] for x in box.x]
        assert box.z[1] == pytest.approx(max(under) + 0.3)
        assert box.z[0] < min(under)


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_every_kind_stands_around_its_place_also_when_turned(kind: str) -> None:
    spans = []
    for turned in (False, True):
        maker, sizes = KINDS[kind]
        thing = maker(Frame("it", 20.0, 3.0, turned, sizes, np.random.default_rng(5)))
        spans.append([high - low for low, high in thing.spans])
        assert away_m((20.0, 3.0), thing.spans) < 0.5
        lowest = min((shape.bottom_m for shape in thing.shapes), default=0.0)
        assert lowest == 0.0
    np.testing.assert_allclose(spans[0], spans[1][::-1], atol=1e-9)


def test_a_ditch_is_cut_out_of_the_floor_and_nothing_else(tmp_path: Path) -> None:
    text = scattered("ditch", "depth_m = [0.4, 0.4]\nlong_m = [2, 2]\nwide_m = [1, 1]", "[2, 2]")
    scene = scene_of(tmp_path, text)
    x, y = (
        part.ravel() for part in np.meshgrid(np.arange(-11.9, 30, 0.1), np.arange(-9.9, 10, 0.1))
    )
    heights = scene.height_at(x, y)
    assert set(np.unique(heights)) == {-0.4, 0.0}
    assert (heights < 0).sum() * 0.01 == pytest.approx(4.0, abs=0.5)
    assert len(scene.solids) == 1 + 2 * 4


def test_a_hole_that_no_floor_holds_is_not_cut() -> None:
    floor = Solid("floor", (0.0, 10.0), (0.0, 10.0), (-1.0, 0.0))
    floors: list[Shape] = [floor]
    assert not cut(floors, (8.0, 11.0), (2.0, 3.0), 0.5)
    assert floors == [floor]
    assert cut(floors, (8.0, 9.0), (2.0, 3.0), 0.5)
    assert not cut(floors, (4.0, 6.0), (1.5, 2.5), 0.5)  # across two pieces of what is left
    assert len(floors) == 5
    assert ground_m([floor], [(5.0, 5.0), (11.0, 5.0)]) == [0.0, -math.inf]


def test_a_mirrored_scene_is_the_same_on_the_other_side(tmp_path: Path) -> None:
    """Which seeds are mirrored chance decides; both sides come, and all things change sides."""
    text = """
mirror = true
goals.areas = [{x = [15, 15], y = [2, 2]}]
route = {speed_mps = 0.5, waypoints = [[3, 1, 0.2], [5, 0]]}
ramp = [{name = "side", x = [30, 40], y = [-10, 10], rise_deg = 2.0}]
pillar = [{name = "post", at = [12.0, 5.0], radius_m = 0.2, z = [0.0, 2.0]}]
bump = [
    {name = "bump", x = [20, 21], y = [-2, 3], height_m = 0.02},
    {name = "across", x = [22, 24], y = [1, 3], height_m = 0.02, along = "y"},
]
steel = [{name = "door", at = [9.0, 4.0], yaw_deg = 20.0}]
slip = [{left = 0.1, right = 0.0, from_s = 1.0, until_s = 2.0}]
walker = [{name = "walks", waypoints = [[12.0, -6.0], [18.0, -6.0]]}]
person = [{name = "goes", waypoints = [[12.0, -5.0], [18.0, -6.0]]}]
moved_box = [{name = "box", x = [26, 27], y = [1, 2], z = [0, 1]}]
patch = [{name = "wet", x = [10, 11], y = [1, 2], friction = 0.3}]
"""
    file = tmp_path / "some.toml"
    file.write_text(text + FLOOR)
    scenes = {scene.goals[0][1]: scene for scene in (load_scene(file, k) for k in range(12))}
    assert set(scenes) == {2.0, -2.0}
    one, other = scenes[2.0], scenes[-2.0]
    x, y = np.random.default_rng(1).uniform([-5, -10], [40, 10], (500, 2)).T
    for at_s in (None, 1.0):
        heights = one.height_at(x, y, at_s), other.height_at(x, -y, at_s)
        np.testing.assert_allclose(*heights, atol=1e-9)
    assert one.waypoints == ((3.0, 1.0, 0.2), (5.0, 0.0))
    assert other.waypoints == ((3.0, -1.0, 0.2), (5.0, 0.0))
    assert one.steels[0].yaw_rad == -other.steels[0].yaw_rad
    assert one.steels[0].at == (9.0, -other.steels[0].at[1])
    assert (one.slips[0].left, one.slips[0].right) == (other.slips[0].right, other.slips[0].left)
    assert one.walkers[0].waypoints[1] == (18.0, -other.walkers[0].waypoints[1][1])
    assert one.patches[0].y == (-other.patches[0].y[1], -other.patches[0].y[0])


def test_a_slope_is_eased_at_both_ends_and_ends_where_the_level_ground_begins(
    tmp_path: Path,
) -> None:
    text = '[[slope]]\nname = "up"\nx = [30, 40]\ny = [-5, 5]\nrise_deg = [2, 4]\nuntil_x = 50\n'
    rises, x = set(), np.arange(29.9, 49.9, 0.01)
    for seed in range(3):
        heights = scene_of(tmp_path, text, seed).height_at(x, np.zeros(len(x)))
        slopes, at = np.degrees(np.arctan(np.diff(heights) / 0.01)), x[:-1]
        assert slopes.max() < 4.0 + 1e-6
        steepest = float(np.median(slopes[(at > 32) & (at < 38)]))
        np.testing.assert_allclose(slopes[(at > 30.1) & (at < 31.4)], steepest / 2, atol=0.02)
        assert abs(slopes[at > 40.1]).max() < 1e-6
        rises.add(round(steepest, 3))
    assert len(rises) == 3


def test_an_entry_with_a_chance_is_there_for_some_seeds(tmp_path: Path) -> None:
    text = '[[pillar]]\nname = "post"\nat = [5, 5]\nradius_m = 0.1\nz = [0, 2]\nchance = 0.5\n'
    there = [len(scene_of(tmp_path, text, seed).solids) - 1 for seed in range(20)]
    assert 4 <= sum(there) <= 16


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('[[scatter]]\nkind = "cow"\n', "no kind 'cow'"),
        (scattered("box", "radius_m = [1, 2]"), "scatter, box: no key 'radius_m'"),
        (scattered("walker", "gap_m = 2.0"), "scatter, walker: no key 'gap_m'"),
        ("[goals]\nnumber = 3\n", "goals: no key 'number'"),
        ("[goals]\nareas = [{x = [1, 2], z = [0, 1]}]\n", "an area has x and y"),
        ("[goals]\nareas = [{x = [2, 1], y = [0, 1]}]\n", "from <= to"),
        ("[upsets]\nfog = 1.0\n", "upsets: no key 'fog'"),
        ("[upsets]\nsun_azimuth_rad = 1.0\n", "upsets: no key 'sun_azimuth_rad'"),
        ("[upsets]\nsunlight_rate = 1.5\n", "goes up to 1"),
        ("[upsets]\nsunlight_rate = true\n", "sunlight_rate: must not be true or false"),
        ("[upsets]\nmixed_pixels = 1\n", "mixed_pixels: must be true or false"),
        ("[upsets]\ndust_per_m = -0.1\n", "must not be below 0"),
        ('[upsets]\nrain_per_m = "much"\n', "rain_per_m: could not convert"),
        ("[upsets]\nbeam_deg = nan\n", "must be finite"),
        ("[[solid]]\nz = [1, 0]\n", "solid, z: must be .* from < to"),
        ("[[solid]]\nz = [0, 1]\n", "solid: name is missing"),
        (f'{BOX}matrial = "glass"\n', "solid: no key 'matrial'"),
        (f'{BOX}material = "water"\n', "plain, glass, black or soft"),
        (f'{BOX}material = "soft"\n', "density_per_m"),
        (f"{BOX}density_per_m = 3.0\n", "density_per_m"),
        ('[[person]]\nname = "a"\nwaypoints = [[0, 1]]\nstarts_s = 3.0\n', "no key 'starts_s'"),
        ('[[patch]]\nname = "a"\nx = [0, 1]\ny = [0, 1]\nfriction = 3\n', "at most 2"),
        ("[rooms]\ncolour = 1\n", "rooms: no key 'colour'"),
    ],
)
def test_what_a_file_says_wrongly_is_refused_by_name(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        scene_of(tmp_path, text)
