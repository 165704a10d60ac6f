"""What a recording holds is all that moved the app: played again it says the same to the bit."""

from pathlib import Path
from typing import Any

from core.saved.state import state_of
from fakes.scenes.scene import Scene
from hw.modbus.layout import DRIVE
from recording.reader import Recording
from recording.records import ASK, CHANGED, RESTORED, STOP
from tests.support.robot.recorded import RecordedLoop
from tests.support.robot.shipped import FLOOR, shipped
from tools.replay.player import Player

READY: dict[str, Any] = {"enable_motors": True, "start_clear_m": 12.0}
MODBUS: dict[str, Any] = {"port": "tcp://127.0.0.1:5020", "allow_drive": True}


def assert_plays_the_same(path: Path, loop: RecordedLoop) -> set[bytes]:
    """The kinds of its records."""
    recording = Recording(path)
    kinds = {record.kind for record in recording.records()}
    assert (recording.gap, recording.is_cut, recording.from_start) == ("", False, True)
    player = Player(recording)
    while not player.done:
        player.step()
    assert player.remarks == []
    [check] = player.checks
    assert check.is_identical, check.describe()
    assert check.played_bytes == len(loop.sent) > 1000
    assert player.app.mapper.counts == loop.app.mapper.counts
    for mine, its in zip(loop.app.devices.every, player.app.devices.every, strict=True):
        assert (mine.status.state, mine.status.losses) == (its.status.state, its.status.losses)
    return kinds


def test_a_drive_by_modbus_with_faults_and_its_end_is_the_same_again(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    scene = Scene("hall", (FLOOR,))
    config = shipped(modbus=MODBUS, robot=READY)
    loop = RecordedLoop(path, config, scene, drives=False)
    loop.run(2.5)
    assert loop.app.image is not None
    for k in range(20):
        asked = [300, 100, 200, k]
        loop.app.image.write(loop.now_s, loop.now_s - 0.01, None, "modbus me", DRIVE, asked)
        loop.run(0.05)
    assert loop.app.pilot.control.v_mps > 0.1
    loop.wires["ahrs"].cut = True
    loop.run(0.2)
    loop.hang(0.15)
    loop.wires["ahrs"].cut = False
    loop.run(1.0)
    loop.app.stop()
    loop.run(0.3)
    loop.recorder.close()
    assert assert_plays_the_same(path, loop) >= {ASK, STOP, CHANGED}


def test_a_run_from_a_loaded_map_is_the_same_again(tmp_path: Path) -> None:
    config = shipped()
    before = RecordedLoop(tmp_path / "before.mcap", config)
    before.run(3.0)
    before.recorder.close()
    loaded = state_of(before.app.mapper, config, before.now_s)
    path = tmp_path / "after.mcap"
    loop = RecordedLoop(path, config, loaded=loaded)
    loop.run(2.5)
    loop.recorder.close()
    assert RESTORED in assert_plays_the_same(path, loop)
