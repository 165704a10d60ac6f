"""The pipe to a writer that is slow or gone: nothing waits, and what is missing is told."""

import json
import os
from collections.abc import Iterator

import pytest

from recording.flight import records_in
from recording.records import BYE, GAP, HEAD, IN, STATE
from recording.tap import HELD_BYTES, Tap

Pipe = tuple[Tap, int]


@pytest.fixture
def pipe() -> Iterator[Pipe]:
    reading, writing = os.pipe()
    yield Tap(writing), reading
    os.close(writing)


def read_on(tap: Tap, fd: int, now_s: float) -> bytearray:
    """As a writer would, until nothing is left."""
    os.set_blocking(fd, False)
    data, is_idle = bytearray(), 0
    while is_idle < 2:
        tap.flush(now_s)
        now_s += 1.0
        try:
            data += os.read(fd, 1 << 20)
            is_idle = 0
        except BlockingIOError:
            is_idle += 1
    return data


def test_what_a_slow_writer_does_not_take_is_counted_and_told_before_what_follows(
    pipe: Pipe,
) -> None:
    tap, fd = pipe
    pieces = 3 * HELD_BYTES // 100_000
    for k in range(pieces):
        tap.note(float(k), STATE if k % 2 else IN, 1, bytes(100_000))
        tap.flush(float(k))
    dropped = tap.dropped.copy()
    assert dropped["M"] > dropped["I"] > 10  # states go first
    assert tap.trouble == ""
    got = read_on(tap, fd, 1e6)
    tap.note(2e6, IN, 1, b"again")
    got += read_on(tap, fd, 3e6)
    records = list(records_in(bytes(got)))
    assert len(records) == pieces - dropped.total() + 2
    *_, (_, gap, _, missing), (t_s, kind, _, data) = records
    assert (gap, json.loads(missing)) == (GAP, dict(dropped))
    assert (t_s, kind, data) == (2e6, IN, b"again")
    os.close(fd)


def test_a_writer_that_is_gone_ends_the_recording_and_not_the_run(pipe: Pipe) -> None:
    tap, fd = pipe
    os.close(fd)
    for k in range(3):
        tap.note(float(k), IN, 0, b"x")
        tap.flush(float(k))
    assert tap.trouble == "its writer has ended"
    tap.end(10.0)
    tap.begin({"path": ""})


def test_the_end_goes_out_though_nothing_else_fits(pipe: Pipe) -> None:
    tap, fd = pipe
    for _ in range(200):
        tap.note(0.0, IN, 0, bytes(100_000))
    tap.end(0.0)
    records = list(records_in(bytes(read_on(tap, fd, 1.0))))
    assert records[-1][1] == BYE
    assert json.loads(records[-1][3])["I"] == 200 - HELD_BYTES // (100_000 + HEAD.size)
    os.close(fd)
