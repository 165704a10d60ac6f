"""How often what fails is tried again, and how it is told."""

import errno
import os
import termios

import pytest

from hw.ports.reopening import (
    CHEAP_LAST_S,
    RETRY_FIRST_S,
    RETRY_LAST_S,
    ReopeningPort,
    describe_loss,
)

START_S, TICK_S = 100.0, 0.005


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


@pytest.mark.parametrize(
    ("number", "longest_s"),
    [
        (errno.ECONNREFUSED, CHEAP_LAST_S),
        (errno.ENETDOWN, CHEAP_LAST_S),
        (errno.EBUSY, RETRY_LAST_S),
    ],
)
def test_only_what_costs_nothing_is_tried_often(number: int, longest_s: float) -> None:
    port = ScriptedPort(OSError(number, os.strerror(number)))
    for tick in range(12_000):  # a minute
        port.poll(START_S + tick * TICK_S)
    pauses = [b - a for a, b in zip(port.tries_s, port.tries_s[1:], strict=False)]
    assert min(pauses) >= RETRY_FIRST_S - 1e-6
    assert max(pauses) == pytest.approx(longest_s, abs=2 * TICK_S)


def test_a_loss_is_told_with_the_name_of_the_wire() -> None:
    unreachable = describe_loss(OSError(errno.EHOSTUNREACH, ""), "192.168.0.1:2112")
    assert unreachable == "no answer from 192.168.0.1:2112"  # as when it did not answer in time
    configuring = OSError("Could not configure port: (25, ...)")  # as pyserial wraps it
    configuring.__context__ = termios.error(errno.ENOTTY, "Inappropriate ioctl for device")
    assert describe_loss(configuring, "/dev/null") == "/dev/null is not a serial line"
    for error in (termios.error(22, "Invalid argument"), ValueError("Failed to set custom baud")):
        assert describe_loss(error, "/dev/mti").startswith("/dev/mti: ")
