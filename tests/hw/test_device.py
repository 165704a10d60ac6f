"""The step that all devices share, on ports in memory with simulated time."""

from typing import Any

import pytest

from fakes.wires.wire import MemoryPort
from hw.device import NEVER_HEARD_S, PIECE, BadFrame, Device, DeviceStatus, Intake, NoPort, Session
from hw.fingerprint import SEEMS

NMEA = b"$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47\r\n"


class Bytes:
    """A parser to which each piece of letters is an event; anything else is a bad frame."""

    def feed(self, now_s: float, data: bytes) -> list[Any]:
        return [(now_s, data)] if data.isalpha() else [BadFrame("no letters", data)]


class Answers(Device[tuple[float, bytes]]):
    """A device that runs once it has heard a letter, and whose session answers each one."""

    def __init__(self, port: Any, name: str = "mti") -> None:
        self.sessions = 0
        super().__init__(DeviceStatus(name), port, Bytes, self._run)

    def _run(self) -> Session:
        self.sessions += 1
        out = b""
        while True:
            tick = yield out
            words = [event[1] for event in tick.events if not isinstance(event, BadFrame)]
            out = b"!" * len(words)
            if words:
                self.status.state, self.status.cause = "running", ""

    def _measure(self, now_s: float, events: list[Any]) -> list[tuple[float, bytes]]:
        return [event for event in events if not isinstance(event, BadFrame)]


class MortalPort(MemoryPort):
    """One whose connection may be renewed, as a real port's."""

    silence_s = 2.5

    def __init__(self) -> None:
        super().__init__()
        self.reopened: list[str] = []
        self.renews = True

    def fileno(self) -> int:
        return 7 if self.connected else -1

    def reopen(self, cause: str) -> None:
        self.reopened.append(cause)
        self.connected = False
        self.cause = cause

    def poll(self, now_s: float) -> bool:
        if self.renews and self.cause in self.reopened:
            self.connected = True
        return super().poll(now_s)


def test_what_is_heard_between_ticks_is_answered_then_and_delivered_later() -> None:
    port = MemoryPort()
    device = Answers(port)
    assert device.step(1.000) == []
    port.give(b"one")
    device.hear(1.002)
    assert port.take() == b"!"
    assert device.status.heard_s == 1.002
    port.give(b"two")
    assert device.step(1.005) == [(1.002, b"one"), (1.005, b"two")]
    assert device.step(1.010) == []


def test_what_was_heard_before_the_wire_was_lost_is_still_delivered_and_nothing_more() -> None:
    device = Answers(port := MemoryPort())
    device.hear(0.9)  # not even stepped yet
    device.step(1.0)
    port.give(b"last")
    device.hear(1.002)
    port.give(b"lost")
    port.connected = False
    device.hear(1.003)
    assert device.step(1.005) == [(1.002, b"last")]
    assert (device.status.state, device.status.losses) == ("closed", 1)
    Answers(NoPort()).hear(1.0)


def test_bytes_of_a_new_connection_are_left_for_the_tick_that_starts_its_session() -> None:
    device = Answers(port := MemoryPort())
    device.step(1.0)
    port.connected = False
    port.connected = True
    port.give(b"new")
    device.hear(1.002)
    assert device.step(1.005) == [(1.005, b"new")]
    assert device.sessions == 3  # made with the device, and once for each connection


def heard_once(port: MemoryPort) -> Answers:
    device = Answers(port)
    device.step(1.0)
    port.give(b"hello")
    device.step(1.005)
    return device


def run(device: Answers, begin_s: float, seconds: float) -> list[tuple[str, str]]:
    """The changes of state on the way."""
    changes: list[tuple[str, str]] = [(device.status.state, device.status.cause)]
    for tick in range(round(seconds * 200)):
        device.step(begin_s + tick * 0.005)
        if (now := (device.status.state, device.status.cause)) != changes[-1]:
            changes.append(now)
    return changes[1:]


def test_a_device_that_fell_silent_gets_a_fresh_connection_and_one_line_says_so() -> None:
    device = heard_once(port := MortalPort())
    changes = run(device, 1.01, 2.6)
    assert port.reopened == ["nothing heard for 2.5 s"]
    assert changes == [("starting", "nothing heard for 2.5 s")]
    assert (device.sessions, device.status.losses) == (3, 1)


def test_a_device_that_never_spoke_is_left_in_peace_for_ten_seconds_each_time() -> None:
    device = Answers(port := MortalPort())
    changes = run(device, 1.0, 4 * NEVER_HEARD_S + 1)
    assert len(port.reopened) == 4
    assert changes == [("starting", "waiting for the first answer")]  # one line in 41 s

    device = heard_once(port := MortalPort())  # its connection can't be renewed: it is lost
    port.renews = False
    run(device, 1.01, 3.0)
    port.cause = "no answer from 192.168.0.1:2112"
    changes = run(device, 4.01, 10.0)
    assert changes == [("closed", "no answer from 192.168.0.1:2112")]
    assert len(port.reopened) == 1


def test_a_device_that_talks_keeps_its_connection_whatever_it_says() -> None:
    device = Answers(port := MortalPort())
    for tick in range(6000):
        if tick % 400 == 0:
            port.give(b"...")
        device.step(tick * 0.005)
    assert port.reopened == []


class Pieces:
    """Counts what is parsed; lines with an x are junk."""

    def __init__(self) -> None:
        self.fed: list[tuple[float, bytes]] = []

    def feed(self, now_s: float, data: bytes) -> list[Any]:
        self.fed.append((now_s, data))
        lines = data.split(b"\n")
        return [BadFrame("junk", line) if b"x" in line else line for line in lines if line]


FLOOD = 65_536  # bytes that one read may bring


@pytest.mark.parametrize(
    ("data", "per_step", "piece"),
    [
        (b"." * FLOOD, 10_000 + PIECE, PIECE),  # one event a piece: bytes alone count
        (b".\n" * (FLOOD // 2), PIECE * 2, PIECE),  # many events
        (b"x" * FLOOD, PIECE, PIECE),  # junk
        (b"x" * FLOOD, 2000, 2000),  # junk, for a device of long telegrams
    ],
    ids=["good", "events", "junk", "long"],
)
def test_a_flood_is_parsed_over_many_steps_in_order(data: bytes, per_step: int, piece: int) -> None:
    intake = Intake(Pieces, piece)
    parser, events, now_s = intake._parser, [], 1.0
    assert isinstance(parser, Pieces)
    intake.allowance = 10_000
    events += intake.events(now_s, [data, b"end"])
    steps = 1
    while intake.waits:
        before, now_s = len(parser.fed), now_s + 0.005
        intake.allowance = 10_000
        events += intake.events(now_s, [])
        assert sum(len(piece) for _, piece in parser.fed[before:]) <= per_step
        steps += 1
    assert b"".join(piece for _, piece in parser.fed) == data + b"end"
    assert {arrived_s for arrived_s, _ in parser.fed} == {1.0}
    assert events[-1] == b"end"
    assert steps >= FLOOD // per_step


def test_while_bytes_wait_the_port_is_not_read_neither_in_a_step_nor_between_two() -> None:
    device = Answers(port := MemoryPort())
    device.step(1.0)
    port.give(b"." * 50_000)
    device.step(1.005)
    port.give(b"after")
    device.hear(1.006)
    assert device.step(1.010) == []
    heard: list[tuple[float, bytes]] = []
    for tick in range(100):
        heard += device.step(1.015 + tick * 0.005)
    assert [word for _, word in heard] == [b"after"]
    assert device.status.skipped_bytes == 50_000
    assert device.status.rejected > 10


def test_another_device_on_the_port_is_named_until_the_right_one_answers() -> None:
    device = Answers(port := MemoryPort())
    device.step(1.0)
    for tick in range(100):
        port.give(NMEA)
        device.step(1.005 + tick * 0.005)
    assert device.status.cause == (
        f"waiting for the first answer: {SEEMS}a GNSS receiver or compass that speaks NMEA"
    )
    port.give(b"hello")
    device.step(2.0)
    assert (device.status.state, device.status.cause) == ("running", "")
    for tick in range(100):  # the session stays the judge of what runs
        port.give(NMEA)
        device.step(2.1 + tick * 0.005)
    assert device.status.cause == ""


def test_a_loop_back_plug_is_named() -> None:
    class Asks(Answers):
        def _run(self) -> Session:
            self.sessions += 1
            while True:
                yield b"\x02sRN DeviceIdent\x03"

    device = Asks(port := MemoryPort(), "lms111")
    for tick in range(50):
        device.step(tick * 0.005)
        port.give(port.take())
    assert device.status.cause.endswith("an echo of what mapod sends, as from a loop-back plug")
