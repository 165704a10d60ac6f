"""Driving by Modbus: whole requests only, in time only, from this machine or a line only."""

import pytest

from hw.modbus.client import CLIENT_HZ, Client, Request, is_loopback
from hw.modbus.image import RegisterImage
from hw.modbus.layout import DRIVE, Refusal
from tests.support.machine.modbus_rig import (
    CLEAR,
    GOOD,
    START_S,
    Clock,
    Loop,
    context_of,
    new_image,
    some_cells,
    window_of,
    words,
)

V, W = 500, 65536 - 300
READ = Request(1, bytes.fromhex("03 00 00 00 01"))
ASKED = tuple[float, str, float, float, float]
WRITE = bytes((16,)) + DRIVE.to_bytes(2, "big") + bytes.fromhex("00 04 08 01F4 FED4 00C8 0007")


class Commander:
    """The app's side: remembers what it was asked, and says what it is told to."""

    def __init__(self) -> None:
        self.asked: list[ASKED] = []
        self.reason = ""

    def __call__(self, now_s: float, who: str, v_mps: float, w_radps: float, valid_s: float) -> str:
        self.asked.append((now_s, who, v_mps, w_radps, round(valid_s, 6)))
        return self.reason


def enabled() -> tuple[RegisterImage, Commander]:
    commander = Commander()
    return new_image(ask=commander), commander


def test_a_request_is_taken_whole_and_acknowledged_where_driving_is_enabled() -> None:
    image = new_image()
    assert image.read(START_S, None, DRIVE, 1) == Refusal.ADDRESS
    assert image.write(START_S, START_S, None, "", DRIVE, [V, W, 200, 1]) == Refusal.ADDRESS
    image, commander = enabled()
    assert words(image, DRIVE, 10) == [0] * 10
    assert image.write(START_S, START_S, None, "me", DRIVE, [V, W, 200, 7]) is Refusal.NONE
    assert commander.asked == [(START_S, "me", 0.5, -0.3, 0.2)]
    image.publish(START_S, GOOD, CLEAR, window_of(some_cells(1)), driven=(0.25, -0.1))
    assert words(image, DRIVE, 10, START_S + 0.05) == [V, W, 200, 7, 7, 0, 7, 150, 250, 65436]
    assert words(image, DRIVE, 10, START_S + 1)[7] == 0
    assert image.write(START_S, START_S, None, "me", DRIVE + 4, [1]) == Refusal.ADDRESS


@pytest.mark.parametrize(
    ("reason", "result"), [("somebody else is driving", 3), ("the map is not valid", 1)]
)
def test_a_refusal_of_the_app_shows_in_the_acknowledgement(reason: str, result: int) -> None:
    image, commander = enabled()
    image.write(START_S, START_S, None, "me", DRIVE, [V, W, 200, 7])
    commander.reason = reason
    assert image.write(START_S, START_S, None, "me", DRIVE, [V, W, 200, 8]) is Refusal.NONE
    assert words(image, DRIVE, 10)[3:7] == [8, 8, result, 7]


def test_part_of_a_request_or_a_value_out_of_range_changes_nothing() -> None:
    image, commander = enabled()
    for first, given in (
        (DRIVE, [V, W, 200]),
        (DRIVE + 3, [1]),
        (DRIVE, [V, W, 200, 1, 0]),
        (DRIVE - 1, [0, V, W, 200, 1]),
        (DRIVE, [V, W, 1001, 1]),
        (DRIVE, [0x8000, W, 200, 1]),
        (DRIVE, [V, 0x8000, 200, 1]),
    ):
        assert image.write(START_S, START_S, None, "me", first, given) == Refusal.VALUE
    assert commander.asked == []
    assert words(image, DRIVE, 10) == [0] * 10


def test_the_time_that_a_request_waited_is_taken_off_but_a_stop_is_never_too_late() -> None:
    image, commander = enabled()
    image.write(START_S + 0.15, START_S, None, "me", DRIVE, [V, W, 200, 1])
    assert commander.asked[-1][4] == 0.05
    image.write(START_S + 0.2, START_S, None, "me", DRIVE, [V, W, 200, 2])
    assert len(commander.asked) == 1
    assert words(image, DRIVE, 10)[4:7] == [2, 2, 1]
    image.write(START_S + 9, START_S, None, "me", DRIVE, [0, 0, 0, 3])
    assert commander.asked[-1] == (START_S + 9, "me", 0.0, 0.0, 0.0)
    assert words(image, DRIVE, 10)[5] == 0


def test_only_this_machine_and_a_line_may_drive_and_others_may_still_freeze_and_read() -> None:
    image, commander = enabled()
    context = context_of(image, Loop(Clock()))
    answers: list[bytes] = []
    latch = bytes.fromhex("06 00 5A 00 01")
    read = bytes((3,)) + DRIVE.to_bytes(2, "big") + b"\0\1"
    for host in ("192.168.0.9", "127.0.0.1"):
        client = Client(context, host, is_loopback(host), lambda _, pdu: answers.append(pdu))
        assert client.offer([Request(1, WRITE), Request(2, latch), Request(1, read)])
    refusal, taken = b"\x90\x01", WRITE[:5]
    assert answers == [refusal, latch, b"\x03\x02\0\0", taken, latch, b"\x03\x02\x01\xf4"]
    assert commander.asked == [(START_S, "127.0.0.1", 0.5, -0.3, 0.2)]


def test_a_request_behind_many_others_of_a_client_that_is_slowed_counts_from_its_arrival() -> None:
    image, commander = enabled()
    loop = Loop(Clock())
    context = context_of(image, loop)
    answers: list[bytes] = []
    client = Client(context, "me", True, lambda _, pdu: answers.append(pdu))
    client.offer([READ] * 100 + [Request(1, WRITE)])
    while client.waiting:
        loop.step()
    waited_s = loop.clock.now_s - START_S
    assert waited_s == pytest.approx(41 / CLIENT_HZ)
    assert len(answers) == 101
    assert commander.asked[0][4] == pytest.approx(0.2 - waited_s)
