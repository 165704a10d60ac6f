"""Serial ports on ptys, in simulated time; opening and closing happen in a thread of their own."""

import contextlib
import errno
import fcntl
import os
import select
import sys
import termios
import threading
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from hw.device import Port
from hw.ports import serial
from hw.ports.reopening import BACKLOG, RETRY_FIRST_S
from hw.ports.serial import SerialPort
from hw.ports.wires import open_port
from tests import Patch
from tests.support.machine.real_wires import START_S, is_lost, opened, pty_at, read_all, until

TICK_S = 0.005


@pytest.fixture
def pty() -> Iterator[tuple[int, str]]:
    with pty_at() as ends:
        yield ends


@contextlib.contextmanager
def port_at(path: str, settings: str = "baud=9600") -> Iterator[SerialPort]:
    with contextlib.closing(open_port(f"serial://{path}?{settings}")) as port:
        assert isinstance(port, SerialPort)
        yield port


def settled(port: Port, now_s: float = START_S) -> bool:
    """Whether it is open, once an attempt to open it has come to its end."""
    before = port.cause
    until(lambda: port.poll(now_s) or port.cause != before)
    return port.poll(now_s)


def is_told(port: Port, wait_s: float = 0.0) -> bool:
    """Whether the port's descriptor is readable, as an event loop sees it."""
    return bool(select.select([port.fileno()], [], [], wait_s)[0])


def waiting(port: SerialPort) -> int:
    """How many bytes have come and are not read."""
    count = fcntl.ioctl(port._fd, termios.FIONREAD, bytes(4))
    return int.from_bytes(count, sys.byteorder)


def test_a_pty_carries_all_bytes_both_ways(pty: tuple[int, str]) -> None:
    master, path = pty
    with port_at(path) as port:
        assert port.fileno() == -1
        opened(port)
        assert (port.read(), is_told(port)) == ([], False)
        everything = bytes(range(256))
        port.write(everything)
        until(lambda: select.select([master], [], [], 0)[0])
        assert os.read(master, 1000) == everything
        for data in (everything, b"second"):
            os.write(master, data)
            assert is_told(port, 30)
            assert is_told(port)
            assert b"".join(port.read()) == data
            assert not is_told(port)
        port.close()
        assert port.fileno() == -1


def test_what_arrives_in_pieces_is_read_whole(pty: tuple[int, str]) -> None:
    master, path = pty
    with port_at(path) as port:
        opened(port)
        sent, got = os.urandom(40_000), b""
        left = memoryview(sent)
        while len(got) < len(sent):
            if left and select.select([], [master], [], 0.0)[1]:
                left = left[os.write(master, left[:1000]) :]
            elif not is_told(port, 30):
                break
            got += b"".join(port.read())
        assert got == sent


def test_what_is_gathered_is_told_and_read_when_it_is_whole(pty: tuple[int, str]) -> None:
    master, path = pty
    with port_at(path) as port:
        assert settled(port)
        port.gather(10)
        for count in (9, 1):
            assert not is_told(port)
            assert port.read() == []
            os.write(master, bytes(count))
        assert is_told(port, 60.0)
        os.write(master, bytes(14))  # it is late: one more whole one, and a part
        until(lambda: waiting(port) == 24)  # they come over as the kernel finds time
        assert b"".join(port.read()) == bytes(20)
        assert not is_told(port)
        os.write(master, bytes(5))
        until(lambda: waiting(port) == 9)
        port.gather(1)  # of what is there already as well
        assert is_told(port, 60.0)
        assert port.read() == [bytes(9)]


def test_seven_bits_and_parity_open_again_also_by_a_link(tmp_path: Path) -> None:
    with pty_at(str(tmp_path / "ax3500")) as (_, path):
        for _ in range(3):
            with port_at(path, "baud=9600&parity=E&bytesize=7") as port:
                assert settled(port), port.cause


def test_the_last_bytes_leave_before_the_line_is_closed() -> None:
    for _ in range(10):
        with pty_at() as (master, path):
            with port_at(path) as port:
                opened(port)
                port.write(b"!A00\r!B00\r")
            assert os.read(master, 100) == b"!A00\r!B00\r"


def test_closing_waits_for_a_reader_not_for_ever(pty: tuple[int, str], monkeypatch: Patch) -> None:
    master, path = pty
    sent = os.urandom(30_000)
    with port_at(path) as port:
        opened(port)
        port.write(sent)
        assert port.backlog > 0
        got = bytearray()

        def read_on() -> None:
            while len(got) < len(sent):
                if select.select([master], [], [], 30)[0]:
                    got.extend(os.read(master, 4096))

        reader = threading.Thread(target=read_on)
        reader.start()
        port.close()
        reader.join()
        assert got == sent
    monkeypatch.setattr(serial, "DRAIN_S", 0.01)
    with port_at(path) as port:
        opened(port)
        port.write(sent)  # and nobody reads


def test_a_full_line_waits_for_nothing_and_is_given_up(pty: tuple[int, str]) -> None:
    with port_at(pty[1]) as port:
        opened(port)
        port.write(bytes(60_000))
        assert 0 < port.backlog < 60_000
        for _ in range(100):  # a kernel takes some thousand bytes, not always as many
            if not port.poll(START_S):
                break
            port.write(bytes(10_000))
            assert port.backlog <= BACKLOG
        assert port.cause == f"{pty[1]} is not taking bytes"


def test_a_line_that_hangs_up_is_lost_with_a_cause_and_tells_no_more(pty: tuple[int, str]) -> None:
    master, path = pty
    with port_at(path) as port:
        opened(port)
        os.write(master, b"last words")
        assert read_all(port, 10) == b"last words"
        os.close(master)
        assert is_told(port, 30)
        until(partial(is_lost, port, START_S))
        assert (port.cause, port.fileno()) == (f"{path} is gone", -1)


def test_no_line_and_a_line_in_use_are_named(pty: tuple[int, str], tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.touch()
    with port_at(str(path)) as port:
        assert not settled(port)
        assert str(path) in port.cause
        assert "ioctl" in port.cause or "not a serial line" in port.cause
    with port_at(pty[1]) as one, port_at(pty[1]) as two:
        opened(one)
        assert not settled(two)
        assert two.cause == f"{pty[1]} is in use by another program"


def open_after(port: Port, now_s: float) -> float:
    """How long, in ticks of the loop, until it is open."""
    began_s = now_s
    while not port.poll(now_s):
        if not port._opening.is_under_way:  # type: ignore[attr-defined]
            now_s += TICK_S  # what is under way in the thread takes no time here
    return now_s - began_s


def test_an_unplugged_device_is_open_soon_after_it_is_back(tmp_path: Path) -> None:
    now_s, path = START_S, str(tmp_path / "mti")
    with port_at(path) as port:
        for gone_s in (0.1, 20.0):
            assert not port.poll(now_s)
            assert port.cause in (f"no such device {path}", f"{path} is gone")
            port.reopen("not open: nothing changes")
            with pty_at(path) as (device, _):
                waited_s = open_after(port, now_s)
                assert waited_s <= 0.5
                now_s += waited_s
                os.write(device, b"x")
                assert read_all(port, 1) == b"x"
            until(partial(is_lost, port, now_s))
            for _ in range(round(gone_s / TICK_S)):
                now_s += TICK_S
                assert not port.poll(now_s)


def test_a_refused_line_is_opened_once_its_rights_change(tmp_path: Path) -> None:
    path, target = str(tmp_path / "mti"), tmp_path / "file"
    target.touch()
    os.symlink(target, path)
    now_s = START_S
    with port_at(path) as port:
        assert not settled(port)
        for _ in range(2000):  # 10 s; what is there is no serial line
            now_s += TICK_S
            assert not port.poll(now_s)
        os.unlink(path)
        with pty_at(path):
            assert open_after(port, now_s) <= 0.5


def test_an_absent_path_is_looked_at_now_and_then(tmp_path: Path, monkeypatch: Patch) -> None:
    looked: list[object] = []
    with port_at(str(tmp_path / "mti")) as port:
        path_now = port._path_now

        def count_look() -> tuple[int, ...]:
            looked.append(None)
            return path_now()

        monkeypatch.setattr(port, "_path_now", count_look)
        for tick in range(4_000):  # 20 s
            assert not port.poll(START_S + tick * TICK_S)
            assert not port._opening.is_under_way
        assert len(looked) <= 20 / RETRY_FIRST_S + 16  # pauses of 0.2, 0.4, .. 5 s


class SlowLine:
    """A driver that takes as long as the test wants to open and close a line that is no pty."""

    def __init__(self, fd: int) -> None:
        self.fd, self.asked = fd, list[bool]()
        self.may_open, self.may_close, self.closed = (threading.Event() for _ in range(3))

    def open(self, *_given: Any, **_settings: Any) -> "SlowLine":
        self.may_open.wait()
        return self

    def fileno(self) -> int:
        return self.fd

    def set_low_latency_mode(self, wanted: bool) -> None:
        self.asked.append(wanted)
        raise ValueError("Failed to update ASYNC_LOW_LATENCY flag")

    def close(self) -> None:
        self.may_close.wait()
        self.closed.set()


@pytest.fixture
def slow(tmp_path: Path, monkeypatch: Patch) -> Iterator[tuple[SlowLine, str]]:
    (tmp_path / "ttyUSB0").touch()
    near, far = os.pipe()
    line = SlowLine(near)
    monkeypatch.setattr(serial, "OPEN_LINE", line.open)
    yield line, str(tmp_path / "ttyUSB0")
    line.may_open.set()
    line.may_close.set()
    os.close(near)
    os.close(far)


def test_no_tick_waits_while_a_line_opens_or_closes(slow: tuple[SlowLine, str]) -> None:
    line, path = slow
    with port_at(path) as port:
        for tick in range(1000):
            assert not port.poll(START_S + tick * TICK_S)
        line.may_open.set()
        opened(port, START_S + 5)
        assert line.asked == [True]  # an adapter that can't answer sooner is used as it is
        port.reopen("nothing heard for 10 s")
        for tick in range(1000):
            assert not port.poll(START_S + 6 + tick * TICK_S)
        assert not line.closed.is_set()
        line.may_close.set()
        opened(port, START_S + 12)
        assert line.closed.is_set()  # before it is opened again
        assert port.opened == 2


def test_a_line_that_opens_too_late_is_closed(slow: tuple[SlowLine, str]) -> None:
    line, path = slow
    with port_at(path) as port:
        assert not port.poll(START_S)
    line.may_close.set()
    line.may_open.set()
    assert line.closed.wait(30)


def test_what_fails_in_the_thread_is_told(slow: tuple[SlowLine, str], monkeypatch: Patch) -> None:
    def fails(error: Exception) -> Callable[..., object]:
        def fail(*_given: Any, **_settings: Any) -> object:
            raise error

        return fail

    monkeypatch.setattr(serial, "OPEN_LINE", fails(OSError(errno.EACCES, "")))
    with port_at(slow[1]) as port:
        assert not settled(port)
        assert port.cause == f"no permission for {slow[1]}"
    monkeypatch.setattr(serial, "OPEN_LINE", fails(LookupError("a mistake of ours")))
    with port_at(slow[1]) as port, pytest.raises(LookupError, match="a mistake of ours"):
        settled(port)
