"""`mapod calibrate` against the fakes: in the world, and over ports in real time."""

import codecs
import doctest
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from config_file import load_config, with_changes
from core.config import ConfigError
from fakes.lms1xx.device import FakeLms111
from fakes.scenes.scene import Scene, Solid
from fakes.wires.wire import MemoryPort, PtyWire, TcpWire, Wire
from fakes.world.rig import Rig
from tests import ROOT, Capsys, Patch
from tests.support.machine.real_time import level_sensor, served
from tools import settings
from tools.calibration import collect_floor
from tools.calibration.collect_floor import RefusedError
from tools.calibration.mount import Calibration, calibrate
from tools.cli import calibrate as tool
from tools.cli.options import settings_text

F64 = npt.NDArray[np.float64]
SHIPPED = (ROOT / "mapod.toml").read_text(encoding="utf-8")
LEVEL_RAD = math.radians(0.1)
TICK_S = 0.005
HALL = Scene(
    "hall",
    (
        Solid("floor", (-20.0, 20.0), (-20.0, 20.0), (-1.0, 0.0)),
        Solid("crate", (5.0, 5.6), (-2.0, -1.0), (0.0, 0.5)),
        Solid("wall", (-3.0, 14.0), (6.0, 6.3), (-1.0, 2.5)),
    ),
)
STAND, TURN = (0.0, 0.0), (-0.25, 0.25)  # powers of the left and the right wheel
OFF = {"mount_tilt_deg": 8.2, "mount_z_m": 1.08}  # the world's robot has 7.5


class Bench:
    """The world's scanner and attitude sensor on memory wires, and the tool's collector."""

    def __init__(self, powers: tuple[float, float], seconds: float = 3.0) -> None:
        self.config = with_changes(load_config(SHIPPED), scanner=OFF)
        self.rig = Rig(HALL, 1, drives=False)
        ports = MemoryPort(), MemoryPort()
        self.wires = Wire(self.rig.scanner, ports[0], 1), Wire(self.rig.ahrs, ports[1], 2)
        self.collector = collect_floor.Collector(self.config, *ports, seconds)
        self.now_s, self._powers = 100.0, powers

    def step(self) -> None:
        self.now_s += TICK_S
        self.rig.world.wheels.set_power(*self._powers)
        self.rig.world.step_to(self.now_s)
        for wire in self.wires:
            wire.step(self.now_s)
        self.collector.step(self.now_s)

    def run(self) -> Calibration:
        """Until the collector has enough, or refuses; what is made of it."""
        while not self.collector.done:
            self.step()
        view = self.collector.watch.view()
        return calibrate(view, tool.mount_of(self.config, 1.08), 0.005, LEVEL_RAD)


@pytest.fixture(scope="module")
def turned() -> Calibration:
    return Bench(TURN).run()


@pytest.fixture(scope="module")
def stood() -> Calibration:
    return Bench(STAND, 2.0).run()


def test_a_wrong_tilt_in_the_settings_is_found_by_turning_on_the_spot(turned: Calibration) -> None:
    assert math.degrees(turned.mount.tilt_rad) == pytest.approx(7.5, abs=0.05)
    assert math.degrees(turned.mount.roll_rad) == pytest.approx(0.0, abs=0.05)
    assert abs(turned.mount.tilt_rad - math.radians(7.5)) < 3 * turned.tilt_error_rad
    assert turned.is_proven
    assert turned.floor_returns > 0.5 * turned.returns
    assert turned.rms_m < 0.015


def test_standing_finds_it_too_but_proves_no_floor(stood: Calibration) -> None:
    assert abs(stood.mount.tilt_rad - math.radians(7.5)) < 3 * stood.tilt_error_rad
    assert stood.tilt_error_rad > LEVEL_RAD
    assert not stood.is_proven


def test_a_missing_or_silent_attitude_sensor_is_told(monkeypatch: Patch) -> None:
    monkeypatch.setattr(collect_floor, "READY_S", 4.0)
    bench = Bench(STAND)
    bench.rig.ahrs.mute = True
    with pytest.raises(RefusedError, match=r"not ready within 4 s: .*attitude sensor is"):
        bench.run()
    assert "scanner is" not in bench.collector.words(bench.now_s)
    bench = Bench(STAND, 1.0)
    while bench.collector.watch.scans <= 5:
        bench.step()
    bench.rig.ahrs.mute = True
    with pytest.raises(RefusedError, match=r"of 25 scans came with an attitude, \d\d without"):
        bench.run()


def told(found: Calibration, path: Path, *given: str, text: str = SHIPPED) -> None:
    path.write_bytes(text.encode())
    tool.tell(found, tool.arguments(["--config", str(path), *given]), load_config(text), text)


def test_the_report_has_values_errors_and_effect(
    turned: Calibration, tmp_path: Path, capsys: Capsys
) -> None:
    wrong = SHIPPED.replace("mount_tilt_deg = 7.5 ", "mount_tilt_deg = 8.2 ")
    told(turned, tmp_path / "mapod.toml", text=wrong)
    printed = capsys.readouterr()
    assert printed.err == ""
    assert "[scanner]\nmount_z_m = 1.080\nmount_roll_deg = " in printed.out
    found = re.search(r"mount_tilt_deg        8\.2   (\S+) \+- 0\.0", printed.out)
    assert found
    assert float(found[1]) == pytest.approx(7.5, abs=0.015)
    assert "mm rms in height, 95 % within" in printed.out
    straight_mm = 1000 * (8.0 - 0.25) * math.tan(math.radians(-0.7))
    said_mm = re.search(r"8 m ahead: (\S+) mm straight", printed.out)
    assert said_mm
    assert float(said_mm[1]) == pytest.approx(straight_mm, abs=5)
    assert (tmp_path / "mapod.toml").read_text() == wrong


def test_writing_changes_three_numbers_and_notes_the_day(
    turned: Calibration, tmp_path: Path
) -> None:
    path = tmp_path / "mapod.toml"
    for newline in ("\n", "\r\n"):
        text = SHIPPED.replace("mount_tilt_deg = 7.5", "mount_tilt_deg = 8.2")
        text = text.replace("\n", newline)
        path.touch()
        path.chmod(0o640)
        told(turned, path, "--write", text=text)
        noted = path.read_bytes().decode()
        told(turned, path, "--write", text=noted)  # an older note goes
        noted = path.read_bytes().decode()
        after = re.sub(f"(?<=\\[scanner\\]{newline})# calibrated \\S+Z by .*{newline}", "", noted)
        assert len(after.split(newline)) == len(noted.split(newline)) - 1
        lines = list(zip(text.split("\n"), after.split("\n"), strict=True))
        changed = [new for old, new in lines if old != new]
        keys = [line.split()[0] for line in changed]
        assert set(keys) >= {"mount_z_m", "mount_tilt_deg"}
        assert set(keys) <= {"mount_z_m", "mount_roll_deg", "mount_tilt_deg"}
        assert re.search(r"mount_tilt_deg = \d\.\d\d +# looking down is positive\r?\n", after)
        assert load_config(after).scanner.mount_tilt_deg == pytest.approx(7.5, abs=0.015)
        assert load_config(after).scanner.mount_z_m == 1.08
        assert path.stat().st_mode & 0o777 == 0o640
        assert list(tmp_path.iterdir()) == [path]


def test_a_standing_robots_floor_is_vouched_for(
    stood: Calibration, tmp_path: Path, capsys: Capsys
) -> None:
    path = tmp_path / "mapod.toml"
    told(stood, path)
    assert "take care: the robot neither turned nor nodded" in capsys.readouterr().err
    with pytest.raises(RefusedError, match="not written: the robot neither turned"):
        told(stood, path, "--write")
    assert path.read_text() == SHIPPED
    told(stood, path, "--write", "--floor")
    assert path.read_text() != SHIPPED


def test_a_large_change_needs_proof_that_it_was_floor(stood: Calibration, tmp_path: Path) -> None:
    tilt_rad = stood.mount.tilt_rad + math.radians(2.5)
    wall = replace(stood, mount=replace(stood.mount, tilt_rad=tilt_rad))
    with pytest.raises(RefusedError, match=r"2\.5 deg off the settings, but the robot neither"):
        told(wall, tmp_path / "mapod.toml")
    told(replace(wall, turned_rad=1.0), tmp_path / "mapod.toml", "--write")


def test_height_and_tilt_together_are_refused(
    stood: Calibration, tmp_path: Path, capsys: Capsys
) -> None:
    path = tmp_path / "mapod.toml"
    with pytest.raises(RefusedError, match=r"7\.5 deg at 1\.08 m.*--height.*plank"):
        told(replace(stood, z_is_separate=False), path, "--write", "--floor")
    printed = capsys.readouterr().out
    assert "mount_" not in printed
    assert "residual" in printed
    assert path.read_text() == SHIPPED
    with pytest.raises(RefusedError, match=r"no better than 0\.9 deg"):
        told(replace(stood, roll_error_rad=math.radians(0.9)), path, "--write", "--floor")


def test_a_file_that_changed_meanwhile_is_left_alone(turned: Calibration, tmp_path: Path) -> None:
    path = tmp_path / "mapod.toml"
    path.write_text(SHIPPED + "\n# somebody was here\n")
    given = tool.arguments(["--config", str(path), "--write"])
    with pytest.raises(settings.NotThereError, match="changed meanwhile"):
        tool.tell(turned, given, load_config(SHIPPED), SHIPPED)
    assert path.read_text().endswith("# somebody was here\n")
    link = tmp_path / "link.toml"
    link.symlink_to(path)
    told(turned, link, "--write")  # is written where it lies
    assert link.is_symlink()
    assert path.read_text() != SHIPPED


def test_a_file_that_begins_with_an_editors_mark_is_written_and_keeps_it(tmp_path: Path) -> None:
    path, mark = tmp_path / "mapod.toml", codecs.BOM_UTF8
    path.write_bytes(mark + SHIPPED.encode())
    text = settings_text(path)
    settings.rewrite(path, text, settings.with_values(text, "scanner", {"mount_z_m": "1.5"}))
    assert path.read_bytes().startswith(mark + b"#")
    assert load_config(settings_text(path)).scanner.mount_xyz_m[2] == 1.5


def test_a_section_is_found_or_left_alone_and_a_value_must_be_in_range() -> None:
    for old, new in (("mount_tilt_deg = 7", '"mount_tilt_deg" = 7'), ("[scanner]", "['scanner']")):
        text = SHIPPED.replace(old, new)
        assert load_config(text) == load_config(SHIPPED)
        with pytest.raises(settings.NotThereError, match=r"no scanner\.mount_tilt_deg on a line"):
            settings.with_values(text, "scanner", {"mount_tilt_deg": "6.25"})
    for head in ("[ scanner ]", "  [scanner]  # the laser", "[scanner]\t"):
        text = SHIPPED.replace("[scanner]", head)
        changed = settings.with_values(text, "scanner", {"mount_tilt_deg": "6.25"})
        assert load_config(changed).scanner.mount_tilt_deg == 6.25
    with pytest.raises(ConfigError, match="mount_z_m"):
        settings.with_values(SHIPPED, "scanner", {"mount_z_m": "-1.0"})
    assert doctest.testmod(tool).failed == 0


def floor_ranges_m(t_first_s: float, times_s: F64, bearings_rad: F64) -> F64:
    """A flat floor from 1.08 m, tilted by 8.2 deg: one straight line across."""
    return 1.08 / math.sin(math.radians(8.2)) / np.cos(bearings_rad)


def ran(path: Path, scanner: FakeLms111, *given: str) -> int:
    wires = TcpWire(scanner), PtyWire(level_sensor())
    text = SHIPPED.replace("tcp://192.168.0.1:2112", f"tcp://127.0.0.1:{wires[0].port}")
    path.write_text(text.replace("/dev/mti?", f"{wires[1].path}?"))
    with served(*wires):
        return tool.main(["--config", str(path), "--seconds", "2", *given])


@pytest.mark.real_time
def test_the_whole_tool_in_real_time(tmp_path: Path, capsys: Capsys) -> None:
    path, scanner = tmp_path / "mapod.toml", FakeLms111(floor_ranges_m, 1)
    status = ran(path, scanner, "--height", "1.08", "--floor", "--write")
    printed = capsys.readouterr()
    assert status == 0, printed
    assert load_config(path.read_text()).scanner.mount_tilt_deg == pytest.approx(8.2, abs=0.1)
    assert scanner.state != 2  # not left being configured


def test_a_height_that_can_not_be_is_refused_before_anything_is_read(capsys: Capsys) -> None:
    given = ["--config", str(ROOT / "mapod.toml")]
    with pytest.raises(SystemExit):
        tool.main([*given, "--height", "nan"])
    assert tool.main([*given, "--height", "1.8"]) == 1
    assert "is it in metres" in capsys.readouterr().err
