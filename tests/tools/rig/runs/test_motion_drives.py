"""Drives that are recorded once for the motion part."""

from pathlib import Path

import msgspec
import numpy as np

from core.records import WheelCounts
from tools.rig.runs.motion_drives import Drive, Log


def test_counts_of_a_saved_drive_come_back_as_they_were(tmp_path: Path) -> None:
    log = Log()
    told = [WheelCounts(1.0, 0.0, 0.0, 0), WheelCounts(1.05, 3.5, -4.0, 1, 0.9, True)]
    for counts in told:
        log.note(counts)
    none = np.zeros((0, 3))
    Drive(none, none, none, none, none, none, np.array(log.counts)).save(tmp_path / "drive.npz")
    found = Drive.load(tmp_path / "drive.npz").wheel_counts()
    assert list(map(msgspec.structs.astuple, found)) == list(map(msgspec.structs.astuple, told))
