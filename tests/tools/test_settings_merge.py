"""An older settings file with what is new: the robot's own lines stay, to the byte."""

import re
from pathlib import Path

import pytest

from config_file import load_config, with_changes
from core.config import ConfigError
from tests import ROOT, Capsys
from tools.cli.command import main
from tools.settings_merge import merged

SHIPPED = (ROOT / "mapod.toml").read_text(encoding="utf-8")
MAX_AGE = re.compile(r"^free_max_age_s.*\n(?: +#.*\n)*", re.MULTILINE)
LOG = SHIPPED[SHIPPED.index("\n[log]") :]


def test_a_file_that_lacks_nothing_stays_as_it_is() -> None:
    own = SHIPPED.replace("cells = 101 ", "cells = 103 ").replace("\n", "\r\n") + "# mine"
    assert merged(own, SHIPPED).text == own


def test_what_is_new_comes_with_its_comment_into_its_section() -> None:
    older = MAX_AGE.sub("", SHIPPED).replace(LOG, "").replace("0.15  ", "0.151 # own\n#")
    result = merged(older, SHIPPED)
    assert result.added == [
        "[obstacle] free_max_age_s = 120", '[log] level = "info"', '[log] format = "console"'
    ]  # fmt: skip
    [new] = MAX_AGE.findall(SHIPPED)
    assert result.text.replace(new, "").replace(LOG, "") == older
    expected = with_changes(load_config(SHIPPED), robot={"wheel_radius_m": 0.151})
    assert load_config(result.text) == with_changes(expected, robot={"stop_margin_m": 0.151})


def test_lines_end_as_the_file_s_do() -> None:
    older = MAX_AGE.sub("", SHIPPED).replace("\n", "\r\n").rstrip()
    text = merged(older, SHIPPED).text
    assert text.count("\n") == text.count("\r\n") > older.count("\n")
    assert text.startswith(older[: older.index("free_max") if "free_max" in older else 100])


@pytest.mark.parametrize(
    ("before", "after", "told"),
    [
        ("cells = 101 ", "celsl = 101 ", "map.celsl: unknown key"),
        ("cells = 101 ", "cells = 1 ", "map.cells: must be a whole number from 3 to 2001, is 1"),
        ("[map]", "[map", "not valid TOML"),
        ("[map]", "[old]", r"\[old\]: unknown section"),
        ('driver = "mti"', 'driver = "x"', "ahrs.driver: must be 'mti', is 'x'"),
    ],
)
def test_what_the_new_version_does_not_know_is_refused(before: str, after: str, told: str) -> None:
    with pytest.raises(ConfigError, match=told):
        merged(MAX_AGE.sub("", SHIPPED).replace(before, after), SHIPPED)


def test_a_section_without_lines_of_its_own_is_refused_with_what_to_add() -> None:
    older = SHIPPED.replace(LOG, "").replace("# mapod.toml", 'log.level = "info"\n#')
    with pytest.raises(ConfigError, match=r"add by hand: \[log\] format"):
        merged(older, SHIPPED)


def test_the_command_writes_a_new_file_and_leaves_the_old(tmp_path: Path, capsys: Capsys) -> None:
    older, out = tmp_path / "old.toml", tmp_path / "new.toml"
    older.write_text(MAX_AGE.sub("", SHIPPED), encoding="utf-8")
    assert main(["init", "--from", str(older), "--out", str(out)]) == 0
    told = f"{out} is written: the new settings are those above\n"
    assert capsys.readouterr().out == f"new setting: [obstacle] free_max_age_s = 120\n{told}"
    assert load_config(out.read_text(encoding="utf-8")) == load_config(SHIPPED)
    older.write_text("[loop]\nrate_hz = 1\n", encoding="utf-8")
    assert main(["init", "--from", str(older), "--out", str(tmp_path / "x")]) == 2
    assert "loop.rate_hz: must be a number from 10 to 1000" in capsys.readouterr().err
    assert not (tmp_path / "x").exists()


def test_the_command_tells_that_nothing_was_new_and_refuses_another_robot(
    tmp_path: Path, capsys: Capsys
) -> None:
    older, out = tmp_path / "old.toml", tmp_path / "new.toml"
    older.write_text(SHIPPED, encoding="utf-8")
    given = ["init", "--from", str(older), "--out", str(out)]
    assert main([*given, "--robot", "cart"]) == 2
    told = "[scanner] driver is 'lms111', of --robot cart 'urg04lx'"
    assert capsys.readouterr().err == f"mapod init: {older}: {told}\n"
    assert not out.exists()
    assert main(given) == 0
    assert capsys.readouterr().out == f"{out} is written: no setting is new\n"
