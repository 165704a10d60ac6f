"""What the writer makes of what it is told: files that follow each other, and the last seconds."""

import json
import os
import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from recording.reader import Recording
from recording.records import (
    BYE,
    CHANGED,
    FIRST,
    FLIGHT,
    GAP,
    IN,
    LOST,
    OPENED,
    OUT,
    STEP,
    Record,
    RecordingError,
)
from recording.writer import Writer
from tests.support.robot.recorded import ListTap, RecordedLoop
from tests.support.robot.shipped import shipped

MB = 1_000_000
PLANNER = 3  # its port


class Told:
    """A writer that is told of a run by hand."""

    def __init__(self, **wanted: Any) -> None:
        tap = RecordedLoop(ListTap, shipped()).tap
        assert isinstance(tap, ListTap)
        self._reports, out = os.pipe()
        os.set_blocking(self._reports, False)
        self.writer, self._count = Writer(out), 0
        given = {"path": "", "flight": "", "max_mb": 1000, "file_mb": 1000, "flight_keep": 3}
        self.take(0.0, FIRST, 0, json.dumps({**tap.first, **given, **wanted}).encode())

    def take(self, t_s: float, kind: bytes, port: int = 0, data: bytes = b"") -> None:
        self.writer.take(t_s, kind, port, data)

    def run(self, begin_s: float, end_s: float, piece: int = 1000) -> list[Record]:
        """A hundred records a second that nothing can pack, synced each second."""
        made = []
        for k in range(round(100 * begin_s), round(100 * end_s)):
            record = Record(k / 100, (STEP, IN, OUT)[k % 3], 0, b"")
            if k % 3:
                record = Record(k / 100, record.kind, 1 + k % 3, os.urandom(piece))
            made.append(record)
            self.take(record.t_s, record.kind, record.port, record.data)
            if k % 100 == 99:
                self.writer.sync()
        return made

    def reports(self) -> list[tuple[str, bool]]:
        """Events, and whether they are well."""
        lines = map(json.loads, os.read(self._reports, 1 << 16).splitlines())
        return [(line["event"], line["is_well"]) for line in lines]


@contextmanager
def files_of_at_most(size: int) -> Iterator[None]:
    """As a disk that is full: this process can make no file larger."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_large_recording_goes_on_in_further_files_and_is_read_as_one(tmp_path: Path) -> None:
    told = Told(path=f"{tmp_path}/hall.mcap", file_mb=0.2)
    made = told.run(0.0, 12.0)
    told.take(12.0, BYE, 0, b"{}")
    names = [path.name for path in sorted(tmp_path.iterdir())]
    assert names[:2] == ["hall.2.mcap", "hall.3.mcap"]
    for given in (tmp_path / "hall.mcap", tmp_path):
        recording = Recording(given)
        assert list(recording.records()) == made
        assert len(recording.parts) == len(names) > 2
    second = Recording(tmp_path / "hall.2.mcap")
    assert (second.from_start, second.metadata["continues"]) == (False, "hall.mcap")
    (tmp_path / "hall.3.mcap").unlink()
    with pytest.raises(RecordingError, match="records are missing"):
        list(Recording(tmp_path).records())


def test_the_oldest_files_make_room_and_other_files_stay(tmp_path: Path) -> None:
    (tmp_path / "others.mcap").write_bytes(bytes(3 * MB))
    (tmp_path / "mapod-20200101T000000Z.mcap").write_bytes(bytes(MB))
    os.utime(tmp_path / "mapod-20200101T000000Z.mcap", (1.0, 1.0))
    told = Told(path=f"{tmp_path}/", file_mb=0.3, max_mb=1.0)
    made = told.run(0.0, 30.0)
    told.take(30.0, BYE, 0, b"{}")
    (tmp_path / "others.mcap").unlink()  # it was not touched
    left = sorted(tmp_path.iterdir())
    assert sum(path.stat().st_size for path in left) < 1.1 * MB
    recording = Recording(tmp_path)
    assert not recording.from_start
    records = list(recording.records())
    assert records == made[-len(records) :]
    assert len(records) > 500


def test_a_full_disk_ends_the_recording_which_is_read_up_to_there(tmp_path: Path) -> None:
    told = Told(path=f"{tmp_path}/full.mcap", flight=f"{tmp_path}/flight")
    with files_of_at_most(300_000):
        made = told.run(0.0, 10.0)
    assert told.reports() == [("recording_begun", True), ("recording_ended", False)]
    recording = Recording(tmp_path / "full.mcap")
    records = list(recording.records())
    assert records == made[: len(records)]
    assert len(records) >= 300
    assert recording.is_cut
    told.take(10.0, FLIGHT, 0, b'{"cause": "asked", "message": "by somebody"}')
    assert told.reports() == [("flight_saved", True)]


def test_a_recording_ends_where_something_is_missing(tmp_path: Path) -> None:
    told = Told(path=f"{tmp_path}/gap.mcap")
    made = told.run(0.0, 1.0)
    told.take(1.0, GAP, 0, b'{"I": 7}')
    told.run(1.5, 2.0)
    told.take(2.0, BYE, 0, b'{"I": 7}')
    recording = Recording(tmp_path / "gap.mcap")
    assert list(recording.records()) == made
    assert '{"I": 7}' in recording.gap


def test_a_flight_is_the_last_half_minute_and_the_newest_are_kept(tmp_path: Path) -> None:
    folder = tmp_path / "new" / "flight"
    told = Told(flight=str(folder))
    early = told.run(0.0, 5.0, 10)
    told.take(5.0, FLIGHT, 0, b'{"cause": "stop", "message": "an obstacle is in the way"}')
    [path] = folder.iterdir()
    assert path.name.endswith("Z-stop.mcap")
    recording = Recording(path)
    assert recording.from_start
    assert recording.metadata["message"] == "an obstacle is in the way"
    assert list(recording.records()) == early
    late = told.run(5.0, 100.0, 10)
    for name in ("b-fault", "c fault!", "d", "e"):
        message = json.dumps({"cause": name, "message": "a fault"}).encode()
        told.take(100.0, FLIGHT, 0, message)
    names = sorted(path.name.partition("-")[2] for path in folder.iterdir())
    assert names == ["c-fault.mcap", "d.mcap", "e.mcap"]
    recording = Recording(next(folder.glob("*-e.mcap")))
    records = list(recording.records())
    assert not recording.from_start
    assert records == late[-len(records) :]
    assert 30.0 <= records[-1].t_s - records[0].t_s <= 33.0


def test_a_flight_may_wait_for_what_follows_but_not_longer_than_the_run(tmp_path: Path) -> None:
    told = Told(flight=str(tmp_path))
    early = told.run(0.0, 5.0, 10)
    told.take(5.0, FLIGHT, 0, b'{"cause": "stop", "message": "", "after_s": 1.0}')
    assert list(tmp_path.iterdir()) == []
    late = told.run(5.0, 7.0, 10)
    [path] = tmp_path.iterdir()
    assert list(Recording(path).records()) == early + late[:100]
    told.take(7.0, FLIGHT, 0, b'{"cause": "fault", "message": "", "after_s": 1.0}')
    told.take(7.0, BYE, 0, b"{}")
    [path] = tmp_path.glob("*-fault.mcap")
    assert list(Recording(path).records()) == early + late


def test_a_file_from_the_middle_has_how_its_ports_were_opened_at_its_head(tmp_path: Path) -> None:
    told = Told(flight=f"{tmp_path}/flight", path=f"{tmp_path}/hall.mcap", file_mb=0.2)
    for kind in (OPENED, CHANGED, OUT, LOST, OPENED, CHANGED, OUT, IN):
        told.take(0.0, kind, 0, bytes(12))
    made = [Record(0.0, kind, 0, bytes(12)) for kind in (OPENED, CHANGED, OUT, IN)]
    told.run(0.0, 40.0)
    told.take(40.0, CHANGED, 2, bytes(12))  # whose first bytes fill all that is kept
    told.run(40.0, 80.0)
    told.take(80.0, FLIGHT, 0, b'{"cause": "asked", "message": ""}')
    told.take(80.0, BYE, 0, b"{}")
    [flight] = (tmp_path / "flight").iterdir()
    opening = Recording(flight).opening()
    assert [record for record in opening if record.port == 0] == made
    kept = [record for record in opening if record.port == 2]
    assert 50 < len(kept) < 70
    assert kept[-1] == Record(40.0, CHANGED, 2, bytes(12))
    assert [record for record in opening if record.port == PLANNER] == []
    assert opening[0].t_s == 0.0 < 49.0 < next(Recording(flight).records()).t_s
    third = Recording(tmp_path / "hall.3.mcap")
    assert third.opening()[:4] == made
    assert next(third.records()).t_s > third.opening()[-1].t_s


def test_where_no_flight_can_be_kept_it_is_said_once(tmp_path: Path) -> None:
    (tmp_path / "taken").touch()
    told = Told(flight=f"{tmp_path}/taken/flight", path=f"{tmp_path}/none/x.mcap")
    assert told.reports() == [("recording_ended", False), ("flight_not_kept", False)]
    told.run(0.0, 2.0)
    told.take(2.0, FLIGHT, 0, b'{"cause": "stop", "message": ""}')
    told.take(2.0, BYE, 0, b"{}")
