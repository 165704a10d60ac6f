"""Modbus clients of the whole app: they read what it maps, and drive it only where they may."""

from typing import Any

import numpy as np
import pytest

from core.records import I8
from fakes.scenes.scene import Scene
from hw.modbus.layout import DRIVE, WINDOW, WINDOW_CELLS, Refusal, stride_of
from tests.support.machine.modbus_rig import rows_of, words
from tests.support.robot.closed_loop import ClosedLoop
from tests.support.robot.shipped import FLOOR, shipped

OFFERED = {"port": "tcp://127.0.0.1:5020"}
READY: dict[str, Any] = {"enable_motors": True, "start_clear_m": 12.0}
HEALTH, ZONE, MODE, ALLOWED_AHEAD = 21, 38, 65, 72


class Served(ClosedLoop):
    """The app, with a register image."""

    def __init__(
        self, scene: Scene | str = "corridor", *, may_drive: bool = False, **robot: Any
    ) -> None:
        config = shipped(modbus={**OFFERED, "allow_drive": may_drive}, robot=robot)
        super().__init__(config, scene, drives=not may_drive)
        assert self.app.image is not None
        self.image = self.app.image

    def word(self, register: int) -> int:
        """One register, now."""
        return words(self.image, register, 1, self.now_s)[0]

    def cells(self) -> I8:
        """The codes of the live window, (n, n) from its corner."""
        size = self.config.obstacle.window_cells
        packed = words(self.image, WINDOW_CELLS, size * stride_of(size), self.now_s)
        return np.array(rows_of(packed, size), dtype=np.int8)

    def until_packed(self) -> None:
        """Up to the tick in which a new window was taken."""
        before = self.word(WINDOW)
        for _ in range(100):
            self.step()
            if self.word(WINDOW) != before:
                return
        raise AssertionError("no window was taken")

    def ask(self, v_mms: int, w_mrads: int, valid_ms: int, sequence: int) -> Refusal:
        asked = [v_mms % 65536, w_mrads % 65536, valid_ms, sequence]
        return self.image.write(self.now_s, self.now_s, None, "modbus tcp me", DRIVE, asked)


def test_the_window_is_the_apps_map_and_a_silent_scanner_takes_all_that_is_free_from_it() -> None:
    loop = Served()
    loop.run(3.0)
    loop.until_packed()
    codes = np.choose(loop.map_now() + 1, [1, 0, 2])
    assert (codes == 1).sum() > 10
    assert (codes == 2).sum() > 20
    np.testing.assert_array_equal(loop.cells(), codes)
    assert loop.word(MODE) == 1
    assert loop.word(HEALTH) & 0b11111 == 0b11111
    assert loop.word(ZONE) in (1, 2, 3)
    loop.rig.scanner.mute = True
    loop.run(0.4)
    cells = loop.cells()
    assert not (cells == 1).any()
    assert (cells == 2).any()
    assert loop.word(HEALTH) & 0b10001 == 0
    assert loop.word(ZONE) == loop.word(ALLOWED_AHEAD) == 0


def test_a_commander_drives_only_as_long_as_its_requests_hold() -> None:
    loop = Served(Scene("hall", (FLOOR,)), may_drive=True, **READY)
    loop.run(2.5)
    for k in range(20):
        assert loop.ask(300, 0, 200, k) is Refusal.NONE
        loop.run(0.05)
    assert loop.word(DRIVE + 4) == loop.word(DRIVE + 6) == 19
    assert loop.word(DRIVE + 5) == 0
    assert loop.word(DRIVE + 8) > 100
    assert loop.rig.drive.powers() != (0, 0)
    loop.run(0.5)
    assert loop.word(DRIVE + 7) == loop.word(DRIVE + 8) == 0
    assert loop.rig.drive.powers() == (0, 0)


@pytest.mark.parametrize(
    ("may_drive", "motors"), [(False, True), (True, False)], ids=["modbus", "motors"]
)
def test_without_both_settings_there_are_no_drive_registers(may_drive: bool, motors: bool) -> None:
    loop = Served("corridor", may_drive=may_drive, enable_motors=motors)
    loop.run(0.1)
    assert loop.ask(300, 0, 200, 1) is Refusal.ADDRESS
    assert loop.image.read(loop.now_s, None, DRIVE, 1) is Refusal.ADDRESS
