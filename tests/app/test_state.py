"""A restarted app goes on in its saved map; files of the command line; layers of a drive."""

import json
import math
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from app import App, Ports
from core.mapping.layers import UNITS
from core.records import FREE, OBSTACLE
from core.saved.encoding import Arrays, StateError, arrays_from_bytes
from core.saved.state import restore, state_of
from fakes.world.driver import Driver
from logs import LOG, set_up_logging
from main import run
from map_files import MapSaver, load_map, write_map
from tests import ROOT, Capsys
from tests.app.test_drive import START_S, Commander
from tests.support.cases import few
from tests.support.machine.modbus_rig import free_port, read_request, words_of
from tests.support.robot.closed_loop import SESSION, ClosedLoop
from tests.support.robot.shipped import TEXT, shipped
from tools.settings import rewritten

Ended = tuple[ClosedLoop, Arrays]


def driven(seconds: float, method: str = "surface") -> ClosedLoop:
    """A robot that has driven down the corridor, and stands."""
    loop = ClosedLoop(shipped(map={"method": method}))
    loop.run(seconds)
    rig = loop.rig
    rig.driver = Driver(rig.world.pose, rig.drive.command, (), 0.0, 0.0)
    rig.drive.command(0, 0)
    loop.run(1.5)
    return loop


@pytest.fixture
def told() -> Iterator[Callable[[], list[str]]]:
    """Ends the log, and gives the events that it was told."""
    read, write = os.pipe()
    writer = set_up_logging(shipped(log={"format": "json"}), write)

    def events() -> list[str]:
        writer.close()
        os.close(write)
        with os.fdopen(read) as far_end:
            return [json.loads(line)["event"] for line in far_end]

    yield events
    LOG.close()


def restarted(loop: ClosedLoop, arrays: Arrays) -> None:
    before = loop.app
    before.stop()
    ports = Ports(before.ports.scanner, before.ports.ahrs, before.ports.drive, before.ports.planner)
    loop.app = App(loop.config, ports, session=SESSION + 1)
    restore(loop.app.mapper, arrays, loop.config, loop.now_s)


@pytest.fixture(scope="module")
def ended() -> Ended:
    """A loop whose app has been restarted from its own state, and that state."""
    loop = driven(6.0)
    arrays = state_of(loop.app.mapper, loop.config, loop.now_s)
    restarted(loop, arrays)
    loop.run(2.5)
    return loop, arrays


def test_a_restarted_app_goes_on_in_the_same_map_frame(ended: Ended) -> None:
    loop, arrays = ended
    pose = loop.app.mapper.maybe_pose(loop.now_s)
    assert pose is not None
    x_m, y_m, _, yaw_rad = (float(part) for part in arrays["pose"])
    assert x_m > 1.0
    assert math.hypot(pose.x_m - x_m, pose.y_m - y_m) < 0.02
    assert abs(pose.yaw_rad - yaw_rad) < math.radians(1.0)


def test_obstacles_stay_and_nothing_is_free_on_the_word_of_an_earlier_run(ended: Ended) -> None:
    loop, arrays = ended
    before, now = arrays["window.cells"], loop.app.mapper.maps.window.cells
    assert loop.app.mapper.counts.scans_added > 30
    walls, floor = (before == OBSTACLE).sum(), (before == FREE).sum()
    assert ((now == OBSTACLE) & (before == OBSTACLE)).sum() > 0.95 * walls > 50
    assert floor > 150
    assert not (now == FREE).any()  # it stands, and sees no more than a line of floor
    told, now = loop.planner.window(), loop.map_now()
    assert ((told == 2) == (now == OBSTACLE)).all()
    assert ((told == 1) <= (now == FREE)).all()


def test_nobody_vouches_for_the_ground_around_the_start_of_an_earlier_run() -> None:
    commander = Commander()
    loop = commander.loop
    restarted(loop, state_of(loop.app.mapper, loop.config, loop.now_s))
    commander.run(START_S)
    commander.powers = set()
    commander.drive(0.4, 0.0, 0.6)
    assert not commander.has_moved
    assert commander.blocked_by == "ground in the way was not seen to be free"


def test_layers_of_a_drive_tell_flat_floor_from_walls() -> None:
    loop = driven(4.5)
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
    loop = driven(4.0, "reference_plane")
    names = [name for name in UNITS if loop.app.mapper.maybe_layer(name) is not None]
    assert names == ["height", "state"]
    arrays = state_of(loop.app.mapper, loop.config, loop.now_s)
    restarted(loop, arrays)
    before = arrays["window.cells"] == OBSTACLE
    assert before.sum() > 50
    assert (loop.app.mapper.maps.window.cells[before] == OBSTACLE).all()
    loop.run(2.5)
    now = loop.app.mapper.maps.window.cells
    assert (now[before] == OBSTACLE).mean() > 0.7
    assert 0 < (now == FREE).sum() < 0.5 * (arrays["window.cells"] == FREE).sum()


def test_a_saver_that_fails_keeps_the_file(
    ended: Ended, tmp_path: Path, told: Callable[[], list[str]]
) -> None:
    loop, _ = ended
    path = tmp_path / "hall.npz"

    def save(app: App, to: Path) -> None:
        MapSaver(app, str(to), lambda: loop.now_s).finish()

    save(loop.app, path)
    assert load_map(str(path), loop.config).keys() == arrays_from_bytes(path.read_bytes()).keys()
    content = path.read_bytes()
    empty = ClosedLoop(loop.config)
    save(empty.app, path)
    save(loop.app, tmp_path / "none" / "hall.npz")
    assert path.read_bytes() == content
    assert [entry.name for entry in tmp_path.iterdir()] == ["hall.npz"]
    assert told() == ["map_saved", "map_not_saved", "map_not_saved"]


def test_the_last_map_waits_for_the_first(
    ended: Ended, tmp_path: Path, told: Callable[[], list[str]]
) -> None:
    instants_s = iter([ended[0].now_s, ended[0].now_s, math.inf])  # later no pose is known
    saver = MapSaver(ended[0].app, str(tmp_path / "hall.npz"), lambda: next(instants_s))
    saver.save()
    saver.finish()
    assert told() == ["map_saved", "map_saved"]


def test_a_damaged_file_is_told_and_ends_it(ended: Ended, tmp_path: Path, capsys: Capsys) -> None:
    path = tmp_path / "hall.npz"
    path.write_bytes(b"the one before")
    with pytest.raises(ValueError, match="pickle"):
        write_map(str(path), {"pose": np.array([object()])})
    assert path.read_bytes() == b"the one before"  # half a file replaces none
    write_map(str(path), ended[1])
    assert load_map(str(path), ended[0].config)["pose"].shape == (4,)
    path.write_bytes(path.read_bytes()[:-200])
    for file, reason in ((path, "no saved map"), (tmp_path / "none.npz", "No such file")):
        with pytest.raises(StateError, match=reason):
            load_map(str(file), ended[0].config)
    assert run(["--config", str(ROOT / "mapod.toml"), "--load-map", str(path)]) == 2
    told = capsys.readouterr().err
    assert "can't load the map" in told
    assert len(told.splitlines()) == 1


@pytest.mark.parametrize("ending", few([signal.SIGHUP, signal.SIGTERM, signal.SIGINT], 1))
def test_without_any_device_it_serves_and_ends(ended: Ended, tmp_path: Path, ending: int) -> None:
    saved, new, config = tmp_path / "hall.npz", tmp_path / "new.npz", tmp_path / "robot.toml"
    write_map(str(saved), ended[1])
    port = free_port()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as planner:
        planner.bind(("127.0.0.1", 0))
        planner.settimeout(60)
        values = {
            "modbus.port": f"tcp://127.0.0.1:{port}",
            "scanner.port": "tcp://127.0.0.1:1",
            "planner.port": f"udp://127.0.0.1:{planner.getsockname()[1]}",
            "log.format": "json",
            "record.flight": "",
        }
        text = rewritten(TEXT, values)
        config.write_text(text.replace("/dev/", f"{tmp_path}/no_"), encoding="utf-8")
        command = [sys.executable, "main.py", "--config", str(config)]
        process = subprocess.Popen(
            [*command, "--load-map", str(saved), "--save-map", str(new)],
            cwd=ROOT,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONUNBUFFERED": "1"},
        )
        try:
            frames = [planner.recv(2048) for _ in range(60)]
            with socket.create_connection(("127.0.0.1", port), 60) as client:
                client.sendall(read_request(0, 80))
                registers = words_of(client.recv(2048))
            process.send_signal(signal.SIGUSR1)
            for _ in range(20):
                planner.recv(2048)
            process.send_signal(ending)
            _, log = process.communicate(timeout=120)
        finally:
            process.kill()
    assert process.returncode == 0
    check_told_nothing_good(frames, registers)
    events = [json.loads(line) for line in log.splitlines()]
    assert {"scanner", "ahrs", "drive"} <= {e.get("device") for e in events}
    assert [e["event"] for e in events].count("map_not_saved") == 2  # no device: no pose
    assert [e["moving_when_saved"] for e in events if e["event"] == "map_loaded"] == [False]
    assert not new.exists()


def check_told_nothing_good(frames: list[bytes], registers: list[int]) -> None:
    assert {frame[0] & 0x0F for frame in frames} >= {1, 2, 3}
    poses = [frame for frame in frames if frame[0] & 0x0F == 2]
    assert all(pose[8 + 23] == 0 for pose in poses)  # mode: booting
    assert all(int.from_bytes(pose[8 + 18 : 8 + 20], "little") & 0x37 == 0 for pose in poses)
    health, utc_s = registers[21], registers[18] << 16 | registers[19]
    stop_zone, allowed_ahead = registers[38], registers[72]
    assert registers[:2] == [0x4D50, 0x0100]
    assert stop_zone == allowed_ahead == health & 0b11111 == 0
    assert utc_s > 1_700_000_000
