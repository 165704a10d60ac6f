"""The exchange that all device sessions share, on ticks made by hand."""

from collections.abc import Container
from typing import Any

import pytest

from hw.device import DeviceStatus, Tick
from hw.exchange import Exchange, StartAgainError, Steps

TICK_S = 0.125  # exact in binary


class Line:
    """Drives one part of a session: what it wrote at which tick, and its result."""

    def __init__(self, exchange: Exchange, part: Steps[Any]) -> None:
        self.exchange, self.part = exchange, part
        self.wrote = [next(part)]
        self.result: Any = None
        self.done = False

    def hear(self, *events: Any, ticks: int = 1) -> "Line":
        for tick in range(ticks):
            now_s = self.exchange.now_s + TICK_S
            try:
                self.wrote.append(self.part.send(Tick(now_s, list(events) if tick == 0 else [])))
            except StopIteration as end:
                self.done, self.result = True, end.value
                break
        return self


def exchange(**changes: Any) -> Exchange:
    settings = {"pause_s": 0.25, "longest_pause_s": 0.75} | changes
    return Exchange(DeviceStatus("device"), **settings)


def number(event: Any) -> int | None:
    return event if isinstance(event, int) else None


def test_a_command_is_written_once_and_its_answer_found_among_other_events() -> None:
    talk = exchange()
    line = Line(talk, talk.ask(b"?", number, 1.0))
    line.hear("scan").hear().hear("scan", 7, 8)
    assert (line.wrote, line.result) == ([b"?", b"", b""], 7)


def test_a_command_without_an_answer_is_written_again_and_given_up_after_its_tries() -> None:
    talk = exchange()
    line = Line(talk, talk.ask(b"?", number, 0.375, tries=2)).hear("scan", ticks=10)
    assert line.wrote == [b"?", b"", b"", b"?", b"", b""]
    assert (line.done, line.result) == (True, None)


def test_what_came_before_a_command_is_no_answer_and_what_came_behind_an_echo_is() -> None:
    talk = exchange()

    def echo_then_value() -> Steps[list[Any]]:
        echo = yield from talk.ask(b"?Q\r", lambda event: event if event == "?Q" else None, 1.0)
        value = yield from talk.wait_for(number, 1.0)
        other = yield from talk.ask(b"?R\r", number, 0.25)
        return [echo, value, other]

    line = Line(talk, echo_then_value()).hear(3, "?Q", 4, 5).hear(ticks=5)
    assert line.result == ["?Q", 4, None]


def test_the_session_hears_each_tick_first_and_may_reply_or_begin_anew() -> None:
    def hear(tick: Tick) -> list[Any]:
        if "wake-up" in tick.events:
            talk.reply(b"ack ")
        if "restart" in tick.events:
            raise StartAgainError("it has restarted")
        return [event for event in tick.events if event != 7]

    talk = exchange(hear=hear)
    line = Line(talk, talk.ask(b"?", number, 1.0)).hear("wake-up", 7)
    assert line.wrote == [b"?", b"ack "]
    with pytest.raises(StartAgainError, match="it has restarted"):
        line.hear("restart", 8)


@pytest.mark.parametrize(
    ("heard_at", "least_s", "ticks"),
    [([], 0.0, 2), ([1, 3], 0.0, 5), (range(99), 0.0, 8), ([], 1.5, 12)],
)
def test_quiet_is_waited_for(heard_at: Container[int], least_s: float, ticks: int) -> None:
    talk, passed = exchange(), 0
    line = Line(talk, talk.until_quiet(0.25, 1.0, least_s=least_s, out=b"stop"))
    while not line.done:
        passed += 1
        line.hear(*(["late"] if passed in heard_at else []))
    assert passed == ticks
    assert b"".join(line.wrote) == b"stop"


def test_pauses_grow_with_each_failure_until_the_device_delivers() -> None:
    status = DeviceStatus("device")
    talk = Exchange(status, pause_s=0.25, longest_pause_s=0.75)
    pauses = []
    for attempt in range(5):
        status.state = "running"
        talk.fail(StartAgainError(f"silence {attempt}"))
        assert (status.state, status.cause, talk.failure) == (
            "starting", f"silence {attempt}", f"silence {attempt}",
        )  # fmt: skip
        began_s = talk.now_s
        line = Line(talk, talk.back_off())
        while not line.done:
            line.hear()
        pauses.append(talk.now_s - began_s)
        if attempt == 3:
            talk.succeed()
            assert talk.failure == ""
    assert pauses == [0.25, 0.5, 0.75, 0.75, 0.25]
    assert status.losses == 5
