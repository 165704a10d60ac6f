"""Recorded bytes through the whole app: numbers and bytes to the planner stay as they were."""

import json
from dataclasses import asdict

import pytest

from hw.lms1xx.session import Lms111
from tests import ROOT
from tests.support.robot.shipped import shipped
from tools.cli.replay import SHIPPED_RECORDING, config_for_recording
from tools.replay.laser import LaserReplay
from tools.replay.outcome import Outcome, Tally

STORED = ROOT / "tests" / "replays" / "lms111_session.json"


def replayed() -> tuple[LaserReplay, Outcome]:
    """The recorded LMS111 session, from its first command to its last scan."""
    config = config_for_recording(shipped(), 50, 0.5)
    replay, tally = LaserReplay(SHIPPED_RECORDING, config), Tally()
    while not replay.done:
        replay.step()
        tally.take(replay.frames)
    return replay, tally.outcome(replay.app, replay.now_s)


@pytest.fixture(scope="module")
def first() -> tuple[LaserReplay, Outcome]:
    return replayed()


def test_recorded_scans_are_mapped_but_for_warming_up(first: tuple[LaserReplay, Outcome]) -> None:
    replay, outcome = first
    assert isinstance(replay.app.devices.scanner, Lms111)
    assert outcome.counts.scans_added == 51  # of 58
    assert outcome.counts.scans_dropped == 0
    assert replay.app.devices.scanner.status.rejected == 0
    assert outcome.obstacle > 20
    unknown = {command.split(b" ")[1].decode() for command in replay.recording.unknown}
    assert unknown == {"LMPscancfg", "mLMPsetscancfg", "STlms", "LCMstate"}  # it was never asked
    pose = replay.planner.pose
    assert pose is not None
    assert pose.mode == 4  # which can never drive a machine


def test_two_replays_send_the_stored_bytes(first: tuple[LaserReplay, Outcome]) -> None:
    _, again = replayed()
    assert again.link_sha256 == first[1].link_sha256
    stored = json.loads(STORED.read_text(encoding="utf-8"))
    assert asdict(again) == stored, f"mapod replay --out {STORED} stores the new outcome"
