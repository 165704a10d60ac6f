"""The real program and its writer, each of which may be slow or die: neither harms the other."""

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from recording.reader import Recording
from recording.records import READABLE, TURN
from tests.support.robot.house import House
from tools.replay.player import Player

pytestmark = pytest.mark.real_time
AHRS = 1 << 1  # among the ports of a turn
WRITTEN = 100_000  # bytes of a recording: more than a second of it


@pytest.fixture
def house(tmp_path: Path) -> Iterator[House]:
    """All of its devices run, and it is recorded."""
    wanted = {"record.path": f"{tmp_path}/run.mcap", "record.flight": f"{tmp_path}/flight"}
    house = House(tmp_path, **wanted)
    house.plug_in("ahrs")
    house.plug_in("drive")
    house.serve_scanner()
    house.start()
    try:
        house.until(house.all_run)
        house.run(1.0)
        path = tmp_path / "run.mcap"
        house.until(lambda: path.exists() and path.stat().st_size > WRITTEN)  # it is nice to others
        yield house
    finally:
        house.close()


def writer_of(house: House) -> int:
    """Its process id."""
    assert house.process is not None
    pid = house.process.pid
    [child] = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return int(child)


def events(house: House) -> list[str]:
    return [str(line["event"]) for line in house.log]


def arrivals_heard(recording: Recording, seconds: float) -> int:
    """How often a turn was taken for a sample of the attitude sensor, at its end."""
    turns = [record for record in recording.records() if record.kind == TURN]
    since_s = turns[-1].t_s - seconds
    bits = [READABLE.unpack(turn.data)[0] for turn in turns if turn.t_s > since_s]
    return sum(bool(readable & AHRS) for readable in bits)


def assert_plays_the_same(path: Path) -> Recording:
    recording = Recording(path)
    player = Player(recording)
    while not player.done:
        player.step()
    [check] = player.checks
    assert check.is_identical, check.describe()
    assert check.played_bytes > 1000
    return recording


def test_a_writer_that_is_held_up_misses_nothing_and_the_app_does_not_wait(
    house: House, tmp_path: Path
) -> None:
    writer = writer_of(house)
    assert os.getpriority(os.PRIO_PROCESS, writer) == 19
    assert os.sched_getscheduler(writer) == os.SCHED_OTHER
    os.kill(writer, signal.SIGSTOP)
    house.seen.clear()
    house.run(2.0)
    assert len(house.seen) > 50  # poses came meanwhile
    os.kill(writer, signal.SIGCONT)
    assert house.process is not None
    house.process.send_signal(signal.SIGUSR2)
    house.until(lambda: any(line.get("cause") == "asked" for line in house.log))
    assert house.close() == 0
    recording = assert_plays_the_same(tmp_path / "run.mcap")
    assert not recording.is_cut
    assert arrivals_heard(recording, 2.0) >= 10  # else no stamp is true to its arrival
    assert "flight_saved" in {line.event for line in recording.logs()}
    [flight] = (tmp_path / "flight").glob("*-asked.mcap")
    assert assert_plays_the_same(flight).from_start


def test_a_writer_that_is_killed_ends_the_recording_alone(house: House, tmp_path: Path) -> None:
    os.kill(writer_of(house), signal.SIGKILL)
    house.until(lambda: "recording_ended" in events(house))
    [line] = [line for line in house.log if line["event"] == "recording_ended"]
    assert line["reason"] == "its writer has ended"
    assert house.process is not None
    house.process.send_signal(signal.SIGUSR2)
    house.until(lambda: "flight_not_saved" in events(house))
    house.seen.clear()
    house.until(lambda: len(house.seen) > 50)
    house.until(house.all_run)
    assert house.close() == 0
    assert assert_plays_the_same(tmp_path / "run.mcap").is_cut


def test_an_app_that_is_killed_leaves_its_last_seconds(house: House, tmp_path: Path) -> None:
    assert house.process is not None
    house.process.kill()
    house.process.wait()
    assert house.process.stderr is not None
    os.set_blocking(house.process.stderr.fileno(), True)
    assert b"Traceback" not in house.process.stderr.read()  # which the writer ends, too
    [flight] = (tmp_path / "flight").glob("*-died.mcap")
    for path in (flight, tmp_path / "run.mcap"):
        recording = assert_plays_the_same(path)
        assert (recording.from_start, recording.is_cut) == (True, False)
