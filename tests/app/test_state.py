"""A restarted app goes on in its saved map; files of the command line; layers of a drive."""

import asyncio
import json
import math
import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from app import App, Ports
from config_file import load_config, with_changes
from core.mapping.layers import UNITS
from core.records import FREE, OBSTACLE
from core.saved.encoding import Arrays, StateError, arrays_from_bytes
from core.saved.state import restore, state_of
from fakes.world.driver import Driver
from map_files import MapSaver, load_map, write_map
from tests import ROOT
from tests.app.test_drive import START_S, Commander
from tests.support.closed_loop import SESSION, SHIPPED, ClosedLoop


def driven(seconds: float, method: str = "beams") -> ClosedLoop:
    """A robot that has driven down the corridor, and stands."""
    config = load_config(SHIPPED.read_text(encoding="utf-8"))
    loop = ClosedLoop(with_changes(config, map={"method": method}))
    loop.run(seconds)
    rig = loop.rig
    rig.driver = Driver(rig.world.pose, rig.drive.command, (), 0.0, 0.0)
    rig.drive.command(0, 0)
    loop.run(2.0)
    return loop


def restarted(loop: ClosedLoop, arrays: Arrays | None) -> None:
    """The app ends and starts again while its robot stands."""
    before = loop.app
    before.stop()
    ports = Ports(before.ports.scanner, before.ports.ahrs, before.ports.drive, before.ports.planner)
    loop.app = App(loop.config, ports, session=SESSION + 1)
    if arrays is not None:
        restore(loop.app.mapper, arrays, loop.config, loop.now_s)


@pytest.fixture(scope="module")
def ended() -> tuple[ClosedLoop, Arrays]:
    """A loop whose app has been restarted from its own state, and that state."""
    loop = driven(9.0)
    arrays = state_of(loop.app.mapper, loop.config, loop.now_s)
    restarted(loop, arrays)
    loop.run(4.0)
    return loop, arrays


def test_a_restarted_app_goes_on_in_the_same_map_frame(ended: tuple[ClosedLoop, Arrays]) -> None:
    loop, arrays = ended
    pose = loop.app.mapper.maybe_pose(loop.now_s)
    assert pose is not None
    x_m, y_m, _, yaw_rad = (float(part) for part in arrays["pose"])
    assert x_m > 1.0
    assert math.hypot(pose.x_m - x_m, pose.y_m - y_m) < 0.02
    assert abs(pose.yaw_rad - yaw_rad) < math.radians(1.0)


def test_its_obstacles_are_still_there_and_only_what_it_sees_again_is_free(
    ended: tuple[ClosedLoop, Arrays],
) -> None:
    loop, arrays = ended
    before, now = arrays["window.cells"], loop.app.mapper.maps.window.cells
    assert loop.app.mapper.counts.scans_added > 30
    walls, floor = (before == OBSTACLE).sum(), (before == FREE).sum()
    assert ((now == OBSTACLE) & (before == OBSTACLE)).sum() > 0.95 * walls > 50
    assert floor > 300
    assert 0 < (now == FREE).sum() < 0.3 * floor


def test_the_planner_is_told_the_same_as_the_window_holds(
    ended: tuple[ClosedLoop, Arrays],
) -> None:
    loop, _ = ended
    told = loop.planner.window()
    now = loop.map_now()
    assert ((told == 2) == (now == OBSTACLE)).all()
    assert ((told == 1) <= (now == FREE)).all()


@pytest.mark.parametrize("goes_on", [False, True])
def test_nobody_vouches_for_the_ground_around_the_start_of_an_earlier_run(goes_on: bool) -> None:
    commander = Commander()
    loop = commander.loop
    arrays = state_of(loop.app.mapper, loop.config, loop.now_s)
    restarted(loop, arrays if goes_on else None)
    commander.run(START_S)
    commander.powers = set()
    commander.drive(0.4, 0.0, 1.0)
    assert commander.has_moved == (not goes_on)


def test_layers_of_a_drive_tell_flat_floor_from_walls() -> None:
    loop = driven(6.0)
    mapper = loop.app.mapper
    views = {name: mapper.maybe_layer(name) for name in UNITS}
    shown = {name: view.values for name, view in views.items() if view is not None}
    assert shown.keys() == UNITS.keys()
    floor, walls = shown["state"] == FREE, shown["state"] == OBSTACLE
    assert np.nanmedian(shown["step"][floor]) < 0.03
    assert np.nanmedian(shown["step"][walls]) > 0.10
    assert np.nanmedian(shown["roughness"][floor]) < 0.01
    assert np.nanmedian(shown["roughness"][walls]) > 0.015
    assert math.degrees(np.nanmedian(shown["slope"][floor])) < 3.0
    unseen = np.isnan(shown["height"])
    for name in ("slope", "step", "roughness", "z", "variance", "soft"):
        assert np.isnan(shown[name][unseen]).all()
    assert not np.isnan(shown["step"][floor]).any()
    assert mapper.maybe_layer("colour") is None


def test_the_papers_method_has_heights_and_states_and_goes_on_too() -> None:
    loop = driven(5.0, "reference_plane")
    names = [name for name in UNITS if loop.app.mapper.maybe_layer(name) is not None]
    assert names == ["height", "state"]
    arrays = state_of(loop.app.mapper, loop.config, loop.now_s)
    restarted(loop, arrays)
    before = arrays["window.cells"] == OBSTACLE
    assert before.sum() > 50
    assert (loop.app.mapper.maps.window.cells[before] == OBSTACLE).all()
    loop.run(3.0)
    now = loop.app.mapper.maps.window.cells
    assert (now[before] == OBSTACLE).mean() > 0.7
    assert 0 < (now == FREE).sum() < 0.5 * (arrays["window.cells"] == FREE).sum()


def test_a_saver_writes_whole_files_and_keeps_the_old_one_where_it_can_not(
    ended: tuple[ClosedLoop, Arrays], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    loop, _ = ended
    path = tmp_path / "hall.npz"

    async def save(app: App, to: Path) -> None:
        await MapSaver(app, str(to), lambda: loop.now_s).finish()

    asyncio.run(save(loop.app, path))
    assert load_map(str(path), loop.config).keys() == arrays_from_bytes(path.read_bytes()).keys()
    content = path.read_bytes()
    empty = ClosedLoop(loop.config)
    asyncio.run(save(empty.app, path))
    asyncio.run(save(loop.app, tmp_path / "none" / "hall.npz"))
    assert path.read_bytes() == content
    assert [entry.name for entry in tmp_path.iterdir()] == ["hall.npz"]
    told = capsys.readouterr()
    assert (told.out + told.err).count("map_not_saved") == 2


def test_the_last_map_is_saved_though_another_one_is_still_being_written(
    ended: tuple[ClosedLoop, Arrays], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    loop, now_s = ended[0], ended[0].now_s

    async def save_twice() -> None:
        nonlocal now_s
        saver = MapSaver(loop.app, str(tmp_path / "hall.npz"), lambda: now_s)
        saver.save()
        last = asyncio.ensure_future(saver.finish())
        await asyncio.sleep(0)  # it has begun, and waits for the first to be written
        now_s += 1.0  # nobody reads the sensors any more: no pose is known now
        await last

    asyncio.run(save_twice())
    told = capsys.readouterr()
    assert (told.out + told.err).count("map_saved") == 2
    assert "map_not_saved" not in told.out + told.err


def test_what_was_not_written_to_its_end_does_not_replace_a_map(
    ended: tuple[ClosedLoop, Arrays], tmp_path: Path
) -> None:
    path = tmp_path / "hall.npz"
    path.write_bytes(b"the one before")
    with pytest.raises(ValueError, match="pickle"):
        write_map(str(path), {"pose": np.array([object()])})
    assert path.read_bytes() == b"the one before"
    write_map(str(path), ended[1])
    assert load_map(str(path), ended[0].config)["pose"].shape == (4,)


def test_a_damaged_file_ends_the_app_with_status_2_and_one_line_that_says_why(
    ended: tuple[ClosedLoop, Arrays], tmp_path: Path
) -> None:
    path = tmp_path / "hall.npz"
    write_map(str(path), ended[1])
    path.write_bytes(path.read_bytes()[:-200])
    for file, reason in ((path, "no saved map"), (tmp_path / "none.npz", "No such file")):
        with pytest.raises(StateError, match=reason):
            load_map(str(file), ended[0].config)
    done = subprocess.run(
        [sys.executable, "main.py", "--load-map", str(path)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 2
    assert "can't load the map" in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_the_process_loads_a_map_tells_its_obstacles_and_saves_when_asked(
    ended: tuple[ClosedLoop, Arrays], tmp_path: Path
) -> None:
    saved, path, config = tmp_path / "hall.npz", tmp_path / "new.npz", tmp_path / "robot.toml"
    write_map(str(saved), ended[1])
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as planner:
        planner.bind(("127.0.0.1", 0))
        planner.settimeout(60)
        text = SHIPPED.read_text(encoding="utf-8").replace('"console"', '"json"', 1)
        text = text.replace("127.0.0.1:9750", f"127.0.0.1:{planner.getsockname()[1]}")
        text = text.replace("tcp://192.168.0.1:2112", "tcp://127.0.0.1:1")
        config.write_text(text.replace("/dev/", f"{tmp_path}/no_"), encoding="utf-8")
        process = subprocess.Popen(
            [
                sys.executable,
                "main.py",
                "--config",
                config,
                "--load-map",
                saved,
                "--save-map",
                path,
            ],
            cwd=ROOT,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONUNBUFFERED": "1"},
        )
        try:
            for _ in range(30):
                planner.recv(2048)
            process.send_signal(signal.SIGUSR1)
            for _ in range(30):
                planner.recv(2048)
            process.send_signal(signal.SIGTERM)
            _, log = process.communicate(timeout=120)
        finally:
            process.kill()
    assert process.returncode == 0
    events = [json.loads(line) for line in log.splitlines()]
    assert [e["event"] for e in events].count("map_not_saved") == 2  # no device: no pose
    assert [e["moving_when_saved"] for e in events if e["event"] == "map_loaded"] == [False]
    assert not path.exists()
