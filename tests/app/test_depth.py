"""The depth camera in the app: cells and objects from its bytes, its loss, a replay of it all."""

import json
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from beside import Beside
from config_file import text_from
from core.driving.health import SIGHT_IMPAIRED
from core.mapping.combined import CombinedMaps
from core.objects.seen import Seen
from core.objects.told import ToldObjects
from core.records import FREE, OBJECT_STATIC, OBSTACLE, UNKNOWN, ObjectReport
from core.saved.encoding import StateError
from core.summary import describe_robot
from fakes.scenes.scene import Solid
from map_files import ObjectsSaver, load_objects
from mapod_link.objects import WALL
from recording.reader import Recording
from recording.records import SEEN
from tests import ROOT
from tests.support.robot.depth_loop import DepthLoop, hall, with_camera
from tests.support.robot.shipped import shipped
from tools.replay.player import Player

BOX = Solid("box", (1.6, 2.0), (-0.3, 0.3), (0.0, 0.4))  # nearer than the laser meets the floor
INVALID_S = 0.8  # longer than a camera may be silent, shorter than it is given up


def state_at(loop: DepthLoop, x_m: float, y_m: float) -> int:
    window = loop.app.mapper.maps.window
    i, j = window.grid.cell_of(x_m, y_m)
    return int(window.cells[j % window.grid.size, i % window.grid.size])


def combined(loop: DepthLoop) -> CombinedMaps:
    maps = loop.app.mapper.maps
    assert isinstance(maps, CombinedMaps)
    return maps


def is_impaired(loop: DepthLoop) -> bool:
    return bool(loop.app.report(loop.now_s)[1].health & SIGHT_IMPAIRED)


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> tuple[DepthLoop, Path]:
    """A robot before a box, whose camera has looked for a while; and its recording so far."""
    path = tmp_path_factory.mktemp("depth") / "drive.mcap"
    loop = DepthLoop(hall(BOX), to=path, drives=False)
    loop.run(2.0)
    return loop, path


def test_floor_and_box_of_the_near_field_are_in_the_planners_map_and_list(
    told: tuple[DepthLoop, Path],
) -> None:
    loop, _ = told
    assert state_at(loop, 1.3, 0.0) == FREE
    assert state_at(loop, 1.7, 0.1) == OBSTACLE
    assert combined(loop).scanned.window.cells[0, 8] == UNKNOWN  # 1.7 m ahead: the laser can't
    assert not is_impaired(loop)
    planner, objects = loop.planner, loop.planner.vectors.objects
    assert planner.cell_at(1.7, 0.1) == 2
    assert planner.cell_at(1.3, 0.0) == 1
    assert objects.state(loop.now_s, planner.numbers.gaps) == ("known", "")
    near = min(
        (np.asarray(one.outline_m)[:, 0].min() for one in objects.by_id.values()), default=np.inf
    )
    assert near == pytest.approx(1.6, abs=0.05)


def test_a_floor_plan_begins_the_map_of_objects_and_what_became_of_it_is_saved(
    tmp_path: Path,
) -> None:
    plan, kept = tmp_path / "plan.json", tmp_path / "kept.json"
    box = [[1.6, -0.3], [2.0, -0.3], [2.0, 0.3], [1.6, 0.3], [1.6, -0.3]]
    far = [[x + 40.0, y] for x, y in box]
    shapes: list[dict[str, object]] = [
        {"type": "Polygon", "coordinates": [ring]} for ring in (box, far)
    ]
    shapes.append({"type": "LineString", "coordinates": [[-1, 5], [4, 5]]})
    features = [{"type": "Feature", "geometry": shape, "properties": {}} for shape in shapes]
    plan.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    loop = DepthLoop(hall(BOX), drives=False)
    perception = loop.app.perception
    assert perception is not None
    assert perception.look is not None
    perception.look.start_from(load_objects(str(plan), loop.config), loop.now_s)
    loop.run(1.0)
    told = loop.planner.vectors.objects.by_id.values()
    (wall,) = (one for one in told if one.kind == WALL)
    np.testing.assert_allclose(wall.outline_m.mean(axis=0), (1.5, 5.0), atol=0.1)
    assert np.ptp(wall.outline_m[:, 0]) == pytest.approx(5.0, abs=0.1)
    assert wall.top_m == 32.767
    assert max(np.asarray(one.outline_m)[:, 0].max() for one in told) == pytest.approx(42.0)
    frames = Beside[Seen]()
    saver = ObjectsSaver(perception.look, frames, str(kept))
    saver.finish()
    again = load_objects(str(kept), loop.config)
    assert (len(again.objects), len(again.walls)) == (2, 1)  # the box is no new thing
    np.testing.assert_allclose(again.objects[1].polygon[:, 0].max(), 42.0, atol=1e-3)
    ObjectsSaver(perception.look, frames, str(tmp_path)).finish()  # a folder: told in the log
    other = with_camera(object_map={"cell_m": 0.03})
    with pytest.raises(StateError, match=r"kept\.json'.*the map was made with others"):
        load_objects(str(kept), other)


def test_what_steps_before_it_is_an_obstacle_with_the_first_frame() -> None:
    loop = DepthLoop(hall(), drives=False)
    loop.run(1.0)
    assert state_at(loop, 1.7, 0.1) != OBSTACLE
    perception = loop.app.perception
    assert perception is not None
    other = DepthLoop(hall(BOX), drives=False)
    other.run(1.0)
    loop.camera.camera._sight = other.rig.world.met  # a box, from one picture to the next
    put_s = loop.now_s
    while perception.seen_s < put_s + 0.01:
        other.rig.step(loop.now_s + 1 / 200)
        loop.step()
    assert state_at(loop, 1.7, 0.1) == OBSTACLE


def test_a_camera_that_sees_nothing_or_is_lost_frees_nothing_any_more(
    told: tuple[DepthLoop, Path],
) -> None:
    loop, path = told
    perception, device = loop.app.perception, loop.app.devices.depth
    assert perception is not None
    assert device is not None
    loop.camera.small = True  # other frames in mid-stream
    used = perception.counts["used"]
    loop.run(0.5)
    assert perception.counts["used"] > used + 2
    assert state_at(loop, 1.3, 0.0) == FREE
    loop.camera.all_invalid = True
    loop.run(INVALID_S)
    assert state_at(loop, 1.3, 0.0) == UNKNOWN
    assert state_at(loop, 1.7, 0.1) == OBSTACLE
    assert is_impaired(loop)
    loop.camera.all_invalid = False
    loop.run(1.0)
    assert state_at(loop, 1.3, 0.0) == FREE
    assert not is_impaired(loop)
    loop.camera.gone = True
    for wire in loop.depth_wires:
        wire.cut = True
    loop.run(1.5)
    assert device.status.state != "running"
    assert loop.app.states.describe(loop.now_s).count("depth") == 1
    assert state_at(loop, 1.3, 0.0) == UNKNOWN
    assert loop.planner.cell_at(1.3, 0.0) == 0
    assert loop.planner.cell_at(1.7, 0.1) == 2
    objects = loop.planner.vectors.objects
    assert objects.state(loop.now_s, loop.planner.numbers.gaps)[1] == "nothing looks for objects"
    loop.recorder.close()
    assert_plays_the_same(path, loop)


def assert_plays_the_same(path: Path, loop: DepthLoop) -> None:
    recording = Recording(path)
    assert sum(record.kind == SEEN for record in recording.records()) > 20
    player = Player(recording)
    while not player.done:
        player.step()
    [check] = player.checks
    assert check.is_identical, check.describe()
    assert check.played_bytes == len(loop.sent) > 1000
    assert player.app.mapper.counts == loop.app.mapper.counts
    mine, its = loop.app.mapper.maps.window, player.app.mapper.maps.window
    np.testing.assert_array_equal(mine.cells, its.cells)


def test_objects_are_told_by_version_and_forgotten_with_the_map() -> None:
    outline = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])

    def frame(t_s: float, changed: list[int], gone: tuple[int, ...] = ()) -> Seen:
        reports = [
            ObjectReport(n, OBJECT_STATIC, outline, 0.0, 1.0, (0.0, 0.0), 1.0, t_s) for n in changed
        ]
        rays = np.zeros((0, 3), np.float32), np.zeros(0, np.float32), np.zeros((0, 2), np.int64)
        return Seen(t_s, 0, "", (0.0, 0.0, 0.0), *rays, tuple(reports), gone)

    objects = ToldObjects()
    objects.take(frame(1.0, [2, 5]))
    objects.take(frame(2.0, [5], (2, 77)))
    assert [one.id for one in objects.changes(-1).changed] == [5]
    assert [one.seen_s for one in objects.changes(1).changed] == [2.0]
    assert objects.changes(1).gone == (2,)
    assert objects.changes(2) is not None
    assert (objects.changes(2).changed, objects.changes(2).gone) == ((), ())
    objects.clear()
    assert objects.changes(2).gone == (5,)
    assert objects.looked_s == -np.inf


def test_a_frame_that_is_looked_at_beside_the_loop_is_there_once_when_it_is_done() -> None:
    work, may_end = Beside[Seen](), threading.Event()
    nothing = np.zeros((0, 3), np.float32), np.zeros(0, np.float32), np.zeros((0, 2), np.int64)
    told = Seen(1.0, 0, "", (0.0, 0.0, 0.0), *nothing, (), ())

    def look() -> Seen:
        may_end.wait()
        return told

    work.give(look)
    assert not work.is_idle
    assert work.maybe_take() is None
    may_end.set()
    while (seen := work.maybe_take()) is None:
        pass
    assert seen is told
    assert work.is_idle
    assert work.maybe_take() is None


NO_LIBRARY = """
import sys
sys.modules["shapely"] = None
from main import run
status = run(["--check", "--config", sys.argv[1]])
loaded = [name for name in sys.modules if name.startswith(("core.objects", "perception"))]
print(status, loaded)
"""


def test_only_a_robot_with_a_camera_needs_the_library_of_polygons(tmp_path: Path) -> None:
    for name, config in (("blind", shipped()), ("seeing", with_camera())):
        (tmp_path / name).write_text(text_from(config), encoding="utf-8")
    blind, seeing = (
        subprocess.run(
            [sys.executable, "-c", NO_LIBRARY, str(tmp_path / name)],
            capture_output=True, text=True, check=True, cwd=ROOT,
        )
        for name in ("blind", "seeing")
    )  # fmt: skip
    assert blind.stdout.endswith("\n0 []\n")
    assert "depth" not in blind.stdout
    told = describe_robot(with_camera(), [None])
    assert "depth     visionary at tcp://192.168.1.10:2122: depth camera by CoLa-2" in told
    assert "0.7 m above the ground, looking 25 deg down" in told
    assert seeing.stdout == "2 []\n"
    assert seeing.stderr.endswith(
        "seeing: depth.driver: 'visionary' needs the library of polygons, which is not installed: "
        "pip install 'mapod[objects]'\n"
    )
