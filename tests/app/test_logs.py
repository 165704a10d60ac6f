"""The log: nobody waits for who reads it, and what was dropped is told."""

import json
import os
import re
from collections.abc import Iterator
from typing import IO

import pytest

from core.motion.odometry import Odometry
from hw.runtime.threads import LINES, LogWriter
from logs import LOG, person_line, set_up_logging
from tests.support.robot.closed_loop import ClosedLoop
from tests.support.robot.shipped import shipped

CONFIG = shipped(log={"format": "json", "level": "debug"})
MANY = LINES + 5000  # more than wait, and than a pipe of 64 KiB holds


@pytest.fixture
def pipe() -> Iterator[tuple[IO[str], LogWriter]]:
    read, write = os.pipe()
    writer = set_up_logging(CONFIG, write)
    with os.fdopen(read) as far_end:
        yield far_end, writer
    writer.close()
    os.close(write)
    LOG.close()


def test_a_log_that_nobody_reads_stops_nobody(pipe: tuple[IO[str], LogWriter]) -> None:
    far_end, _ = pipe
    for k in range(MANY):
        LOG.info("said", number=k, text="x" * 80)
    heard = [json.loads(far_end.readline())["number"] for _ in range(LINES)]
    assert heard == list(range(LINES))  # from the beginning on, in order
    LOG.info("said", number=MANY)
    events = [json.loads(far_end.readline())]
    while events[-1]["number"] != MANY:
        events.append(json.loads(far_end.readline()))
    dropped = sum(event.get("lines_dropped", 0) for event in events)  # told with the next line
    assert dropped == MANY - LINES - (len(events) - 1) > 0


def test_a_reader_that_has_gone_stops_nobody(pipe: tuple[IO[str], LogWriter]) -> None:
    far_end, writer = pipe
    far_end.close()
    for _ in range(10):
        writer.write("said\n")
    writer.close()
    assert writer.take_dropped() == 10


def test_changes_are_told_once_and_counters_every_second(pipe: tuple[IO[str], LogWriter]) -> None:
    far_end, writer = pipe
    loop = ClosedLoop(CONFIG)
    loop.run(3.0)
    writer.close()
    os.set_blocking(far_end.fileno(), False)
    events = [json.loads(line) for line in far_end.read().splitlines()]
    for device in ("scanner", "ahrs", "drive"):
        told = [
            (event["state"], event["cause"]) for event in events if event.get("device") == device
        ]
        assert told[-1] == ("running", "")
        assert len(told) == len(set(told))
    assert [event["event"] for event in events].count("ticks_counted") == 3


def test_restarts_and_what_is_refused_are_told_with_their_causes(
    pipe: tuple[IO[str], LogWriter],
) -> None:
    far_end, writer = pipe
    loop = ClosedLoop(CONFIG)
    loop.run(2.5)
    odometry, planners = loop.app.mapper.odometry, loop.app.planners
    assert isinstance(odometry, Odometry)
    odometry._break(loop.now_s, "for a test")
    loop.link_port.give(b"no frame of ours")
    planners.links[0].peer.refusal = "the planner is too small"
    planners._era += 1  # the clock of the frames wraps
    loop.run(1.2)
    writer.close()
    os.set_blocking(far_end.fileno(), False)
    told = {event.pop("event"): event for event in map(json.loads, far_end.read().splitlines())}
    assert told["map_erased"]["because"] == "for a test"
    assert told["session_renewed"]["because"] == "the clock of the frames wraps"
    assert told["answers_rejected"]["newest_reason"] == "bad checksum"
    assert told["answers_rejected"]["total"] == 1
    assert told["map_refused"]["because"] == "the planner is too small"


def test_lines_for_a_person() -> None:
    keys = {"reason": "no space left", "file": "hall.map", "late_s": 0.5}
    assert re.fullmatch(
        r"\d{4}-\d\d-\d\dT[\d:]{8}\.\d{6}Z \[warning\] map_not_saved +"
        r"file=hall.map late_s=0.5 reason='no space left'",
        person_line("warning", "map_not_saved", keys),
    )
    assert "[\x1b[32minfo   \x1b[0m] said" in person_line("info", "said", {}, has_colours=True)


def test_nothing_below_the_level_is_told() -> None:
    read, write = os.pipe()
    writer = set_up_logging(shipped(log={"level": "warning", "format": "json"}), write)
    LOG.debug("counted")
    LOG.info("changed")
    LOG.warning("lost", number=7)
    LOG.close()
    LOG.warning("unheard")
    writer.close()
    os.close(write)
    with os.fdopen(read) as far_end:
        [event] = [json.loads(line) for line in far_end]
    assert (event["level"], event["event"], event["number"]) == ("warning", "lost", 7)


def test_the_journal_gets_no_time_and_a_weight() -> None:
    read, write = os.pipe()
    found = os.fstat(write)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("JOURNAL_STREAM", f"{found.st_dev}:{found.st_ino}")
        writer = set_up_logging(shipped(), write)
    LOG.warning("said", number=7)
    LOG.close()
    writer.close()
    os.close(write)
    with os.fdopen(read) as far_end:
        assert re.fullmatch(r"<4>said +number=7\n", far_end.read())


def test_the_state_of_devices_and_link_in_words() -> None:
    loop = ClosedLoop(CONFIG)
    first = loop.app.states.describe(0.0)
    assert first.startswith("scanner closed: not opened yet; ahrs closed: not opened yet; drive")
    loop.run(3.0)
    told = loop.app.states.describe(loop.now_s)
    assert told == "scanner running; ahrs running; drive running; planner heard"
    loop.app.devices.ahrs.status.fall_back("starting", "no answer; asks again")
    assert "ahrs starting: no answer, asks again; drive" in loop.app.states.describe(loop.now_s)
