"""The command line, as a person uses it."""

from pathlib import Path

import pytest

from main import options_of, run, settings_of, slots_missed
from tests import ROOT, Capsys

SHIPPED = (ROOT / "mapod.toml").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("rate_hz = 200 ", "rate_hz = 0 ", "loop.rate_hz: must be a number from 10 to 1000, is 0"),
        ("[log]", "[lag]", "[lag]: unknown section"),
        ("serial:///dev/mti?baud=115200", "mti", "ahrs.port: "),
        ('key_file = ""', 'key_file = "no/such/key"', "planner.key_file: can't read"),
        ('key_file = ""', f'key_file = "{ROOT}/mapod.toml"', "only its owner may have access"),
        (SHIPPED, "", "No such file"),
    ],
)
def test_a_bad_setting_is_named_in_one_line(
    tmp_path: Path, capsys: Capsys, old: str, new: str, told: str
) -> None:
    assert old in SHIPPED
    path = tmp_path / "robot.toml"
    if new:
        path.write_text(SHIPPED.replace(old, new, 1), encoding="utf-8")
    assert run(["--config", str(path)]) == 2
    said = capsys.readouterr()
    assert told in said.err
    assert str(path) in said.err
    assert len(said.err.splitlines()) == 1
    assert said.out == ""


@pytest.mark.parametrize(
    ("late_s", "missed"),
    [(0.0, 0), (0.002, 0), (0.0024, 0), (0.0026, 1), (0.0074, 1), (0.0076, 2), (0.1, 20)],
)
def test_a_slot_is_late_for_half_its_time_then_missed(late_s: float, missed: int) -> None:
    assert slots_missed(late_s, 0.005) == missed


def test_a_start_that_nobody_watches_vouches_for_no_ground_and_loads_no_map(
    tmp_path: Path, capsys: Capsys
) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(SHIPPED.replace("start_clear_m = 0.0", "start_clear_m = 9.0"), encoding="utf-8")
    vouched = {
        words: settings_of(options_of([*words.split(), "--config", str(path)])).robot.start_clear_m
        for words in ("", "--unattended")
    }
    assert vouched == {"": 9.0, "--unattended": 0.0}
    assert run(["--config", str(path), "--unattended", "--load-map", "hall.map"]) == 2
    said = capsys.readouterr().err
    assert said.startswith("--unattended goes without --load-map: nobody sees whether")
    assert len(said.splitlines()) == 1
