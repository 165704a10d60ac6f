"""`mapod calibrate range`: over the fake in simulated time, from tables, and what it refuses."""

import codecs
import math
import os
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image

from config_file import load_config, with_changes
from fakes.urg04lx.device import FakeUrg04lx
from fakes.wires.wire import MemoryPort, PtyWire, Wire
from tests import ROOT, Capsys
from tests.support.machine.real_time import served
from tools.calibration.collect_floor import RefusedError
from tools.calibration.collect_ranges import Person, Plan, RangeCollector, Vouched
from tools.cli import calibrate, calibrate_range

F64 = npt.NDArray[np.float64]
SHIPPED = (ROOT / "robots" / "urg04lx.toml").read_text(encoding="utf-8")
TICK_S = 0.005
AT_M = (0.5, 1.0, 1.6, 2.3, 3.1, 4.0)
CUBIC = "true_m,read_m\n0.5,0.512\n1,1.014\n1.5,1.517\n2,2.02\n3,3.021\n4,4.018\n"
OFF_M = 0.04  # by which the fake's ranges are too far


class Mover:
    """Puts the board where it is wanted, some seconds after it was asked to."""

    def __init__(self, bench: "Bench", away_s: float = 1.0) -> None:
        self._bench, self._away_s = bench, away_s
        self._wanted_m, self._asked_s = math.nan, math.inf

    def ask(self, distance_m: float) -> None:
        self._wanted_m, self._asked_s = distance_m, self._bench.now_s

    def has_placed(self) -> bool:
        if self._bench.now_s < self._asked_s + self._away_s:
            return False
        self._bench.board_m = self._wanted_m
        return True


class Bench:
    """The fake before a board, on a memory wire, and the tool's collector."""

    def __init__(self, *at_m: float, scans: int = 20) -> None:
        self.board_m, self.now_s = 0.3, 100.0
        self.config = with_changes(load_config(SHIPPED), scanner={"from_deg": -20, "to_deg": 20})
        self.fake = FakeUrg04lx(self.board, 1, "URG-04LX-UG01")
        self.fake.offset_m = OFF_M
        self.port = MemoryPort()
        self.wire = Wire(self.fake, self.port, 1)
        plan = Plan(at_m, scans, math.radians(1.0))
        self.collector = RangeCollector(self.config, self.port, plan, Mover(self))

    def board(self, t_first_s: float, times_s: F64, bearings_rad: F64) -> F64:
        """A board, 0.3 m wide and square to the laser, before a round wall."""
        away_m: F64 = self.board_m / np.cos(np.minimum(np.abs(bearings_rad), 1.0))
        meets = np.abs(away_m * np.sin(bearings_rad)) < 0.15
        return np.where(meets & (np.abs(bearings_rad) < 1.0), away_m, 20.0)

    def run(self, seconds: float = 200.0, until: Callable[[], bool] = lambda: False) -> None:
        end_s = self.now_s + seconds
        while not self.collector.done and not until():
            self.now_s += TICK_S
            assert self.now_s < end_s, self.collector.words()
            self.wire.step(self.now_s)
            self.collector.step(self.now_s)


def options_of(path: Path, *given: str, text: str = SHIPPED) -> list[str]:
    path.write_bytes(text.encode())
    return ["range", "--config", str(path), *given]


def readings(tmp_path: Path, text: str = CUBIC) -> str:
    path = tmp_path / "board.csv"
    path.write_text(text)
    return str(path)


def test_the_fakes_offset_is_found_from_end_to_end(tmp_path: Path, capsys: Capsys) -> None:
    bench = Bench(*AT_M)
    bench.run()
    found = bench.collector.targets
    assert [target.true_m for target in found] == list(AT_M)
    assert [target.scans for target in found] == [20] * len(AT_M)
    read_m = [target.read_m for target in found]
    np.testing.assert_allclose(read_m, np.array(AT_M) + OFF_M, atol=0.01)
    path = tmp_path / "mapod.toml"
    options = calibrate_range.arguments(
        options_of(path, "--write", *(f"--at={at_m}" for at_m in AT_M))[1:]
    )
    report = calibrate_range.Report.of(found, bench.config, 0.002)
    calibrate_range.tell(report, options, SHIPPED)
    written: Any = load_config(path.read_text()).scanner.options
    corrected_m = written.corrected_m(np.array(read_m))
    assert np.sqrt(np.mean((corrected_m - AT_M) ** 2)) < 0.004
    printed = capsys.readouterr()
    assert "third order" in printed.out
    assert re.search(
        r"take care: the scanner tells ranges from 0\.02 to 5\.6 m, .* 0\.54 to 4\.0", printed.err
    )


def test_only_scans_after_the_board_stands_count_and_gone_scanners_are_told() -> None:
    bench = Bench(0.5, 2.0, scans=5)
    bench.run(until=lambda: len(bench.collector.targets) == 1)
    bench.fake.mute = True
    with pytest.raises(
        RefusedError, match="no scan for 15 s: 1 of 2 targets measured; the scanner is"
    ):
        bench.run()
    assert bench.collector.targets[0].read_m == pytest.approx(0.5 + OFF_M, abs=0.02)
    silent = Bench(0.5, 2.0)
    silent.fake.mute = True
    with pytest.raises(RefusedError, match="no scan for 45 s: 0 of 2 targets measured"):
        silent.run()


def test_nothing_straight_ahead_and_no_beam_there_are_refused() -> None:
    bench = Bench(0.5, 9.0, scans=10)
    with pytest.raises(RefusedError, match=r"nothing is seen .* in 3 of \d+ scans: .* at 9 m"):
        bench.run()
    sideways = Bench(0.5)
    sideways.collector = RangeCollector(
        with_changes(sideways.config, scanner={"from_deg": 0.5}),
        sideways.port,
        Plan((0.5, 1.0), 5, math.radians(0.1)),
        Vouched(),
    )
    with pytest.raises(
        RefusedError, match=r"no beam within \+-0\.1 deg .* nearest is at 0\.\d deg"
    ):
        sideways.run()


@contextmanager
def terminal() -> Iterator[tuple[int, int]]:
    ends = os.pipe()
    try:
        yield ends
    finally:
        for end in ends:
            os.close(end)


def test_each_return_is_one_target_and_an_end_of_input_is_told() -> None:
    said: list[str] = []
    with terminal() as (here, there):
        person = Person(here, said.append)
        person.ask(0.5)
        assert said == ["put the target 0.5 m ahead of the lens, and press return"]
        assert not person.has_placed()
        os.write(there, b"yes\n\n")
        assert [person.has_placed() for _ in range(3)] == [True, True, False]
    with open(os.devnull) as nobody, pytest.raises(RefusedError, match="--yes vouches"):
        Person(nobody.fileno(), said.append).has_placed()


def test_a_table_is_fitted_told_drawn_and_written(tmp_path: Path, capsys: Capsys) -> None:
    path, picture = tmp_path / "mapod.toml", tmp_path / "off.png"
    given = options_of(path, "--readings", readings(tmp_path), "--picture", str(picture), "--write")
    assert calibrate.main(given) == 0
    printed = capsys.readouterr()
    assert re.search(r" 0\.500 m +0\.512 m +0\.0 mm +\+12\.0 mm +[+-]0\.\d mm\n", printed.out)
    assert re.search(r"rms: 17\.\d mm now, 0\.\d mm corrected", printed.out)
    with Image.open(picture) as drawn:
        assert drawn.size == (720, 420)
    changed = {
        new.split(" =")[0]
        for old, new in zip(
            SHIPPED.splitlines(),
            re.sub(r"# ranges calibrated \S+Z by .*\n", "", path.read_text()).splitlines(),
            strict=True,
        )
        if old != new
    }
    assert changed == {"correction", "correction_m"}
    options: Any = load_config(path.read_text()).scanner.options
    read_m = np.array([0.512, 1.014, 1.517, 2.02, 3.021, 4.018])
    off_m = options.corrected_m(read_m) - np.array([0.5, 1, 1.5, 2, 3, 4])
    assert np.abs(off_m).max() < 0.001
    again = options_of(path, "--readings", readings(tmp_path), "--write", text=path.read_text())
    assert calibrate.main(again) == 0  # its own reading of the table: nothing is counted twice
    assert path.read_text().count("# ranges calibrated") == 1
    told = capsys.readouterr().err
    assert "the present settings fit" not in told
    assert "the scanner tells ranges from 0.02 to 5.6 m" in told  # whatever is corrected by now


def test_one_wrong_row_is_named_and_little_is_known_of_few(tmp_path: Path, capsys: Capsys) -> None:
    path = tmp_path / "mapod.toml"
    wrong = CUBIC + "3.5,3.62\n"
    assert calibrate.main(options_of(path, "--readings", readings(tmp_path, wrong))) == 0
    printed = capsys.readouterr()
    assert "99.9 mm   left out: the others contradict it" in printed.out
    assert path.read_text() == SHIPPED
    few = "".join(CUBIC.splitlines(keepends=True)[:4])
    assert calibrate.main(options_of(path, "--readings", readings(tmp_path, few))) == 0
    printed = capsys.readouterr()
    assert "fitted: a straight line" in printed.out
    assert "six targets or more" in printed.err
    assert "too few targets to notice a wrong one" in printed.err
    one = "true_m,read_m\n1,1.01\n"
    assert calibrate.main(options_of(path, "--readings", readings(tmp_path, one))) == 1
    assert "targets at two distances are the least, 1 given" in capsys.readouterr().err


def test_a_correction_that_no_settings_may_have_is_not_told_as_one(
    tmp_path: Path, capsys: Capsys
) -> None:
    path, far = tmp_path / "mapod.toml", "true_m,read_m\n1,5\n2,4\n3,3\n4,2\n5,1\n"
    assert calibrate.main(options_of(path, "--readings", readings(tmp_path, far))) == 2
    printed = capsys.readouterr()
    assert "scanner.correction: must move no range of correction_m by 1 m or more" in printed.err
    assert "[scanner]" not in printed.out


def test_the_mark_that_some_editors_put_first_stays(tmp_path: Path) -> None:
    path = tmp_path / "mapod.toml"
    given = options_of(path, "--readings", readings(tmp_path), "--write", text=f"\ufeff{SHIPPED}")
    assert calibrate.main(given) == 0
    written = path.read_bytes()
    assert written.startswith(codecs.BOM_UTF8)
    assert written.count(codecs.BOM_UTF8) == 1
    assert b"# ranges calibrated" in written


def test_another_driver_and_wrong_use_end_with_one_line(tmp_path: Path, capsys: Capsys) -> None:
    path = tmp_path / "mapod.toml"
    sick = (ROOT / "mapod.toml").read_text(encoding="utf-8")
    given = options_of(path, "--at=1", "--at=2", "--yes", text=sick)
    assert calibrate.main(given) == 2
    told = capsys.readouterr().err
    assert "scanner.driver: 'lms111' has no correction of ranges" in told
    assert told.count("\n") == 1
    for wrong, words in (
        ([], "either --at"),
        (["--at=1", "--at=1"], "each distance once"),
        (["--at=1"], "two distances are the least"),
        (["--at=1", "--at=2", "--scans=1"], "a whole number from 5"),
        (["--at=1", "--at=2", "--picture=off.jpg"], r"must be a \.png"),
        (["--at=1", f"--readings={path}"], "either --at"),
    ):
        with pytest.raises(SystemExit) as ended:
            calibrate.main(options_of(path, *wrong))
        assert ended.value.code == 2
        assert re.search(words, capsys.readouterr().err)
    assert calibrate.main(options_of(path, "--readings", str(tmp_path / "none.csv"))) == 2


@pytest.mark.real_time
def test_the_whole_tool_in_real_time(tmp_path: Path, capsys: Capsys) -> None:
    """Of two distances that are nearly alike, for the board goes away by 2 cm a second."""
    path = tmp_path / "mapod.toml"

    def board(t_s: float, times_s: F64, bearings_rad: F64) -> F64:
        return 0.9 + 0.02 * (times_s % 50.0)

    fake = FakeUrg04lx(board, 1, "URG-04LX-UG01")
    wire = PtyWire(fake)
    text = SHIPPED.replace("/dev/urg?", f"{wire.path}?")
    with served(wire):
        given = options_of(path, "--at=0.99", "--at=1.01", "--scans=5", "--yes", text=text)
        assert calibrate.main(given) == 0
    assert "fitted: a constant" in capsys.readouterr().out
