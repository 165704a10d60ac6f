"""The settings of robots/: each is complete, and names ports that there may be."""

from pathlib import Path

import pytest

from config_file import load_config
from tests import ROOT
from wiring import check_ports

ROBOTS = sorted((ROOT / "robots").glob("*.toml"))


def test_there_are_some() -> None:
    assert ROBOTS


@pytest.mark.parametrize("path", ROBOTS, ids=lambda path: path.stem)
def test_a_robots_settings_are_whole(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    check_ports(load_config(text))
