"""What wakes the loop: bytes on ports that are listened to, an instant, a server beside it."""

import asyncio
import math
import os
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from hw.device import DeviceStatus, NoPort, Port
from hw.runtime.servers import ROUNDS, Loop, Servers
from hw.runtime.wakeup import NoEvents, WakeUp


class Wire(NoPort):
    """A port on one end of a socket pair, and the other end."""

    def __init__(self) -> None:
        self.opened = 0
        self.reopen()

    def reopen(self) -> None:
        self.near, self.far = socket.socketpair()
        self.opened += 1

    def fileno(self) -> int:
        return self.near.fileno()

    def close(self) -> None:
        self.near.close()
        self.far.close()


class Echo:
    """A server that gives back what a socket gets, some turns of asyncio later."""

    def __init__(self, fails: bool = False) -> None:
        self.status, self.fails = DeviceStatus("echo"), fails
        self.near, self.far = socket.socketpair()
        self.far.setblocking(False)

    def start(self) -> None:
        self._task = asyncio.get_running_loop().create_task(self._serve())

    async def _serve(self) -> None:
        loop = asyncio.get_running_loop()
        while True:
            data = await loop.sock_recv(self.far, 100)
            await asyncio.sleep(0.001)
            await loop.sock_sendall(self.far, data.upper())

    async def stop(self) -> None:
        self._task.cancel()
        self.near.close()
        self.far.close()
        if self.fails:
            raise OSError("it has failed before")


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


def wires(stack: ExitStack, count: int) -> tuple[WakeUp, list[Wire]]:
    wake_up, made = WakeUp(NoEvents()), [Wire() for _ in range(count)]
    stack.callback(wake_up.close)
    for wire in made:
        stack.callback(wire.close)
    return wake_up, made


def heard(wake_up: WakeUp, seconds: float, ports: list[Wire]) -> list[Port]:
    """Who is heard within so long, all listened to now."""
    return list(wake_up.wait(time.monotonic() + seconds, ports, [-math.inf] * len(ports)))


def test_only_the_ports_that_became_readable_are_given_and_only_those_listened_to(
    stack: ExitStack,
) -> None:
    wake_up, (one, two, three) = wires(stack, 3)
    assert heard(wake_up, 0.0, [one, two]) == []
    two.far.send(b"x")
    three.far.send(b"x")
    assert heard(wake_up, 60.0, [one, two]) == [two]
    assert heard(wake_up, 0.0, [one]) == []
    assert set(heard(wake_up, 60.0, [one, two, three])) == {two, three}


def test_who_is_listened_to_later_wakes_nobody_sooner(stack: ExitStack) -> None:
    wake_up, (one, two) = wires(stack, 2)
    one.far.send(b"x")
    now_s = time.monotonic()
    assert wake_up.wait(now_s + 0.01, [one, two], [now_s + 60.0, now_s]) == []
    assert wake_up.wait(now_s + 60.0, [one, two], [now_s + 0.02, now_s]) == [one]
    assert time.monotonic() >= now_s + 0.02


def test_a_descriptor_that_comes_again_is_another_wire(stack: ExitStack) -> None:
    wake_up, (one, two) = wires(stack, 2)
    assert heard(wake_up, 0.0, [one, two]) == []
    fd = one.fileno()
    one.close()
    two.close()
    two.reopen()
    one.reopen()
    assert fd in (one.fileno(), two.fileno())
    one.far.send(b"x")
    assert heard(wake_up, 60.0, [one, two]) == [one]


def test_an_end_of_a_connection_wakes_too_and_a_closed_port_never(stack: ExitStack) -> None:
    wake_up, (one,) = wires(stack, 1)
    one.far.close()
    assert heard(wake_up, 60.0, [one]) == [one]
    one.close()
    assert heard(wake_up, 0.0, [one]) == []


@pytest.mark.parametrize("due_s", [-1.0, -float("inf"), float("nan"), 0.0])
def test_what_is_past_is_due_at_once(due_s: float, stack: ExitStack) -> None:
    wake_up, ports = wires(stack, 1)
    assert wake_up.wait(due_s, ports, [-math.inf]) == []


def test_a_timer_that_falls_due_while_others_run_is_not_forgotten() -> None:
    class Slow(Loop):
        now_s = 0.0

        def time(self) -> float:
            return self.now_s

        def take_long(self) -> None:
            self.now_s = 2.0

    loop, rung = Slow(), list[str]()
    loop.call_at(1.0, rung.append, "timer")
    loop.call_soon(loop.take_long)
    loop.run_once()
    assert loop.wait_s < 0.0
    loop.run_once()
    assert rung == ["timer"]
    assert loop.wait_s == math.inf
    loop.close()


def test_servers_run_while_the_loop_waits_and_their_timers_wake_it() -> None:
    echo = Echo()
    servers = Servers({"echo": echo})
    wake_up = WakeUp(servers)
    assert servers.statuses == {"echo": echo.status}
    echo.near.setblocking(False)
    for word in (b"one", b"two"):
        echo.near.send(word)
        for _ in range(100):  # each wait ends by the server's socket or its timer
            assert heard(wake_up, 60.0, []) == []
            try:
                assert os.read(echo.near.fileno(), 100) == word.upper()
                break
            except BlockingIOError:
                continue
        else:
            pytest.fail(f"no answer to {word!r}")
    servers.close()
    wake_up.close()


def test_a_server_that_is_never_done_comes_back_to_the_loop_each_time() -> None:
    class Busy(Echo):
        turns = 0

        async def _serve(self) -> None:
            while True:
                self.turns += 1
                await asyncio.sleep(0)

    busy = Busy()
    servers = Servers({"busy": busy})
    for _ in range(3):
        servers.run()
    assert 0 < busy.turns <= 3 * ROUNDS
    assert servers.wait_s == 0.0
    servers.close()


def test_what_has_ended_a_server_is_raised_at_the_end() -> None:
    servers = Servers({"echo": Echo(fails=True)})
    servers.run()
    with pytest.raises(OSError, match="failed before"):
        servers.close()
