"""How soon a lost wire is there again: real sockets and ptys, simulated time."""

import contextlib
import errno
import os
import select
import socket
import tty
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import pytest

from hw.device import Port, Reopens
from hw.ports import wires as ports
from hw.ports.reopening import (
    CHEAP_LAST_S,
    RETRY_FIRST_S,
    RETRY_LAST_S,
    SILENCE_S,
    ReopeningPort,
    describe_loss,
)
from hw.ports.wires import open_port

START_S, TICK_S = 100.0, 0.005


def until(done: Callable[[], object]) -> None:
    """Give the kernel up to a few seconds to bring it about."""
    for _ in range(2000):
        if done():
            return
        select.select([], [], [], 0.001)
    raise AssertionError("it did not come about")


def is_lost(port: Port, now_s: float) -> bool:
    return not port.read() and not port.poll(now_s)


@contextlib.contextmanager
def pty_at(path: str) -> Iterator[int]:
    """A serial device whose node is at `path` until the block ends; gives its own end."""
    master, slave = os.openpty()
    tty.setraw(slave)
    os.symlink(os.ttyname(slave), path)
    try:
        yield master
    finally:
        os.unlink(path)
        os.close(slave)
        os.close(master)


class ScriptedPort(ReopeningPort):
    """Fails to open with the given error, over and over; no wire."""

    def __init__(self, error: OSError) -> None:
        super().__init__("somewhere")
        self.error, self.tries_s = error, list[float]()

    def _try_open(self) -> bool:
        self.tries_s.append(self._now_s)
        raise self.error

    def _let_go(self) -> None:
        """There is nothing."""


def longest_pause_s(error_number: int) -> float:
    """Between two tries, of a minute's."""
    port = ScriptedPort(OSError(error_number, os.strerror(error_number)))
    for tick in range(12_000):
        port.poll(START_S + tick * TICK_S)
    pauses = [b - a for a, b in zip(port.tries_s, port.tries_s[1:], strict=False)]
    assert min(pauses) >= RETRY_FIRST_S - 1e-6
    return max(pauses)


@pytest.mark.parametrize(
    "number", [errno.ECONNREFUSED, errno.EHOSTUNREACH, errno.ENETUNREACH, errno.ENETDOWN]
)
def test_what_costs_nobody_anything_is_tried_at_least_twice_a_second(number: int) -> None:
    assert longest_pause_s(number) <= CHEAP_LAST_S + TICK_S + 1e-6


@pytest.mark.parametrize("number", [errno.EBUSY, errno.EACCES, errno.EMFILE, errno.ECONNRESET])
def test_other_failures_are_tried_ever_less_often_but_every_five_seconds(number: int) -> None:
    assert longest_pause_s(number) == pytest.approx(RETRY_LAST_S, abs=2 * TICK_S)


def test_a_host_that_vanished_is_told_with_one_cause_however_the_kernel_puts_it() -> None:
    unreachable = describe_loss(OSError(errno.EHOSTUNREACH, ""), "192.168.0.1:2112")
    assert unreachable == "no answer from 192.168.0.1:2112"  # as after CONNECT_S


def test_a_host_that_drops_packets_is_asked_twice_a_second_and_found_at_once() -> None:
    with socket.socket() as full:  # a full queue of newcomers: the kernel drops what comes then
        full.bind(("127.0.0.1", 0))
        full.listen(0)
        address = full.getsockname()
        waiting = [socket.socket() for _ in range(4)]
        for one in waiting:
            one.setblocking(False)
            one.connect_ex(address)
        with contextlib.closing(open_port(f"tcp://127.0.0.1:{address[1]}")) as port:
            for tick in range(2000):  # 10 s
                assert not port.poll(START_S + tick * TICK_S)
                assert port.fileno() == -1
            for one in waiting:
                one.close()
            accepted: list[socket.socket] = []
            full.settimeout(1)
            with contextlib.suppress(TimeoutError):
                while len(accepted) < len(waiting):
                    accepted.append(full.accept()[0])
            now_s = START_S + 2000 * TICK_S + ports.CONNECT_S  # the next attempt begins here
            port.poll(now_s)
            until(partial(port.poll, now_s + TICK_S))
            assert port.fileno() >= 0
        for one in accepted:
            one.close()


def test_a_tcp_port_that_is_told_to_reopen_does_so_after_the_shortest_pause_each_time() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        url = f"tcp://127.0.0.1:{listener.getsockname()[1]}"
        with contextlib.closing(open_port(url)) as port:
            assert isinstance(port, Reopens)
            assert port.silence_s == SILENCE_S
            now_s = START_S
            for opened in (1, 2, 3, 4, 5, 6):  # and nothing was ever heard
                until(partial(port.poll, now_s))
                assert port.opened == opened
                old = listener.accept()[0]
                port.reopen("nothing heard for 10 s")
                assert (port.fileno(), port.cause) == (-1, "nothing heard for 10 s")
                old.settimeout(3)
                assert old.recv(10) == b""  # the device's end knows
                old.close()
                assert not port.poll(now_s + RETRY_FIRST_S - 0.01)
                now_s += RETRY_FIRST_S + 1e-6


def test_reopening_what_is_not_open_changes_nothing() -> None:
    with contextlib.closing(open_port("serial:///dev/nothing-here?baud=9600")) as port:
        assert isinstance(port, Reopens)
        port.poll(START_S)
        port.reopen("because")
        assert port.cause == "no such device /dev/nothing-here"


def test_a_descriptor_is_told_only_while_open(tmp_path: Path) -> None:
    path = str(tmp_path / "mti")
    with contextlib.closing(open_port(f"serial://{path}?baud=9600")) as port:
        assert not port.poll(START_S)
        assert port.fileno() == -1
        with pty_at(path) as device:
            assert port.poll(START_S + RETRY_FIRST_S)
            os.write(device, b"x")
            assert select.select([port.fileno()], [], [], 3)[0]
            assert port.read() == [b"x"]
            port.close()
            assert port.fileno() == -1
    with contextlib.closing(open_port("udp://127.0.0.1:9")) as port:
        assert port.fileno() == -1
        assert port.poll(START_S)
        assert port.fileno() >= 0


def test_an_unplugged_serial_device_is_open_again_soon_after_it_is_back_however_long_it_was_gone(
    tmp_path: Path,
) -> None:
    path = str(tmp_path / "mti")
    now_s, port = START_S, open_port(f"serial://{path}?baud=9600")
    with contextlib.closing(port):
        for gone_s in (0.1, 5.0, 60.0):
            with pty_at(path) as device:
                appeared_s = now_s
                while not port.poll(now_s):
                    now_s += TICK_S
                assert now_s - appeared_s <= 0.5
                os.write(device, b"x")
                until(partial(lambda p: p.read(), port))
            until(partial(is_lost, port, now_s))
            assert port.cause == f"{path} is gone"
            for _ in range(round(gone_s / TICK_S)):
                now_s += TICK_S
                assert not port.poll(now_s)


def test_a_line_that_was_refused_is_opened_soon_after_its_rights_have_changed(
    tmp_path: Path,
) -> None:
    path, target = str(tmp_path / "mti"), tmp_path / "file"
    target.touch()
    os.symlink(target, path)
    now_s, port = START_S, open_port(f"serial://{path}?baud=9600")
    with contextlib.closing(port):
        for _ in range(6000):  # 30 s; what is there is no serial line
            now_s += TICK_S
            assert not port.poll(now_s)
        os.unlink(path)
        with pty_at(path):
            changed_s = now_s
            while not port.poll(now_s):
                now_s += TICK_S
            assert now_s - changed_s <= 0.5


def test_an_absent_serial_path_is_opened_by_nobody_and_looked_at_five_times_a_second(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[str] = []
    looked: list[object] = []

    def count_open(path: str, **_settings: object) -> object:
        opened.append(path)
        raise FileNotFoundError(errno.ENOENT, "No such file or directory")

    port = open_port(f"serial://{tmp_path}/mti?baud=9600")
    assert isinstance(port, ports.SerialPort)
    path_now = port._path_now

    def count_look() -> tuple[int, ...]:
        looked.append(None)
        return path_now()

    monkeypatch.setattr(ports, "OPEN_LINE", count_open)
    monkeypatch.setattr(port, "_path_now", count_look)
    for tick in range(12_000):  # a minute
        port.poll(START_S + tick * TICK_S)
    assert len(opened) <= 16  # 0.2, 0.4, .. 5 s
    assert len(looked) <= 60 / RETRY_FIRST_S + len(opened)
    port.close()


def test_a_line_that_can_answer_sooner_is_asked_to_and_one_that_can_t_is_used_as_it_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    master, slave = os.openpty()
    asked: list[bool] = []

    class Line:
        """A serial line that is no pty, by what the port can see."""

        def fileno(self) -> int:
            return slave

        def set_low_latency_mode(self, wanted: bool) -> None:
            asked.append(wanted)
            raise ValueError("Failed to update ASYNC_LOW_LATENCY flag")

        def close(self) -> None:
            os.close(slave)

    monkeypatch.setattr(ports, "OPEN_LINE", lambda *_given, **_settings: Line())
    with contextlib.closing(open_port("serial:///dev/ttyUSB0?baud=115200")) as port:
        assert port.poll(START_S), port.cause
        assert asked == [True]
    os.close(master)
