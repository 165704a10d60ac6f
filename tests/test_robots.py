"""The settings of robots/: each is complete, and names ports that there may be."""

from pathlib import Path

import numpy as np
import pytest

from config_file import load_config
from core.objects.vector_map.tracker import Kalman
from tests import ROOT
from wiring import check_ports

ROBOTS = sorted((ROOT / "robots").glob("*.toml"))


def test_there_are_some() -> None:
    assert ROBOTS


@pytest.mark.parametrize("path", ROBOTS, ids=lambda path: path.stem)
def test_a_robots_settings_are_whole(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    check_ports(load_config(text))


def test_what_is_taken_away_is_gone_in_time_and_who_walks_gets_a_velocity() -> None:
    """Five frames a second had the counts of ten: 4 s, and never a velocity."""
    config = load_config((ROOT / "robots" / "cleaner.toml").read_text(encoding="utf-8"))
    assert config.depth is not None
    assert config.object_map is not None
    period_s = config.depth.options.period_s
    assert config.object_map.gone_frames * period_s <= 2.5  # 3 s are asked, and frames are late
    track, still = Kalman(0.0, np.zeros(2), config.object_map), np.zeros(2)
    for k in range(1, 20):
        track.predict(k * period_s)
        track.correct(still, still)
    assert track.speed_sigma_mps < config.object_map.speed_sigma_mps
