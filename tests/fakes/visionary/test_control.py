"""The fake's control port against the telegrams of the sheet; its sessions, refusals, frames."""

import random
from typing import Any

import pytest

from fakes.visionary.cola import checksum
from fakes.visionary.device import FakeVisionary, Guest
from fakes.visionary.models import KINDS, Model
from fakes.world.simple import Ground
from tests.support.devices.visionary_vectors import TELEGRAMS

SESSION = bytes.fromhex("4e11ba11")
HOSTS = {one.meaning: one.data for one in TELEGRAMS if one.is_hosts and one.is_cola_2}
CAMERAS = {one.meaning: one.data for one in TELEGRAMS if not one.is_hosts and one.is_cola_2}


class Counting(random.Random):
    """Gives challenge and salt of the sheet, one behind the other."""

    def __init__(self) -> None:
        super().__init__(1)
        self._next = 0

    def randbytes(self, n: int) -> bytes:
        self._next += n
        return bytes(range(self._next - n, self._next))


class Bench:
    """A fake, and a host's end of both ports."""

    def __init__(self, model: Model = "t_mini", **attributes: Any) -> None:
        self.fake = FakeVisionary(model, Ground("wall:1.6").met, 1)
        self.fake._chance = Counting()
        if model == "t_mini":
            self.fake.memory.written["binningOption"] = b"\x02"
        self.now_s = 50.0
        for name, value in attributes.items():
            assert hasattr(self.fake, name)
            setattr(self.fake, name, value)
        self.control, self.stream = (
            door.connect(self.now_s) for door in (self.fake.control, self.fake.stream)
        )

    def ask(self, data: bytes, guest: Guest | None = None) -> bytes:
        return (guest or self.control).exchange(self.now_s, data)

    def say(
        self, letters: bytes, request: int, rest: bytes = b"", session: bytes = SESSION
    ) -> bytes:
        """By CoLa-2; what follows the letters of the answer, these with it."""
        body = bytes(2) + session + request.to_bytes(2, "big") + letters + rest
        answer = self.ask(b"\x02" * 4 + len(body).to_bytes(4, "big") + body)
        assert answer[14:16] == request.to_bytes(2, "big")
        return answer[16:]

    def frames(self, seconds: float) -> int:
        got = b""
        for _ in range(round(seconds / 0.005)):
            self.now_s += 0.005
            self.control.exchange(self.now_s, b"")
            got += self.stream.exchange(self.now_s, b"")
        return got.count(b"<SickRecord>")


def open_bench(**attributes: Any) -> Bench:
    bench = Bench(**attributes)
    assert bench.ask(HOSTS["open, 30 s, mapod"]) == CAMERAS["open"]
    return bench


def test_the_exchange_of_the_sheet_byte_for_byte() -> None:
    bench = open_bench()
    assert (
        bench.ask(HOSTS["read DeviceIdent"]) == CAMERAS["Visionary-T Mini CX V3S105-1x, 3.0.0.2334"]
    )
    write = HOSTS["write framePeriodUs 50000"]
    assert bench.ask(write) == CAMERAS["refused: not logged in"]
    refused = bench.ask(HOSTS["call GetChallenge"])
    assert refused == CAMERAS["refused: arguments are missing"]
    given = bench.ask(HOSTS["call GetChallenge, level 4"])
    assert given == CAMERAS["challenge and salt"]
    login = HOSTS["call SetUserLevel"]
    assert bench.ask(login) == CAMERAS["accepted"]
    assert bench.ask(login)[-1] == 3  # a challenge is good once
    assert bench.ask(write) == CAMERAS["written"]
    assert bench.fake.memory.period_s == pytest.approx(0.05)
    assert bench.ask(HOSTS["call Run"]) == CAMERAS["logged out"]
    assert bench.ask(write) == CAMERAS["refused: not logged in"]
    assert bench.ask(HOSTS["call PLAYSTART"]) == CAMERAS["started"]
    assert bench.frames(1.0) in (19, 20)
    assert bench.ask(HOSTS["call PLAYSTOP"])[-10:] == b" PLAYSTOP "
    bench.frames(0.1)
    assert bench.frames(0.5) == 0
    assert bench.ask(HOSTS["close"]) == CAMERAS["closed"]
    assert bench.ask(HOSTS["close"])[-4:] == b"FA\x00\x22"


def test_cola_b_as_the_sheet_has_it() -> None:
    bench = Bench("s")
    by_meaning = {one.meaning: one.data for one in TELEGRAMS if not one.is_cola_2}
    answer = bench.ask(by_meaning["read DeviceIdent"])
    assert answer[8:25] == b"sRA DeviceIdent \x00"
    assert checksum(answer[8:]) == 0
    content = b"sRN nothing "
    read = b"\x02" * 4 + len(content).to_bytes(4, "big") + content + bytes([checksum(content)])
    assert bench.ask(read) == by_meaning["refused: no such variable"]
    assert bench.ask(read[:-1] + b"\x00") == b""  # a wrong checksum is not heard
    for level, word, result in ((3, "fb356cde", 1), (4, "ed784baa", 1), (3, "f4724744", 0)):
        content = b"sMN SetAccessMode " + bytes([level]) + bytes.fromhex(word)
        login = b"\x02" * 4 + len(content).to_bytes(4, "big") + content
        assert bench.ask(login + bytes([checksum(content)]))[-2] == result


def test_a_name_without_its_space_is_understood_and_answered_with_it() -> None:
    bench = open_bench()
    assert bench.say(b"MN", 2, b"PLAYSTOP ") == b"AN PLAYSTOP "


@pytest.mark.parametrize(
    ("letters", "rest", "error"),
    [
        (b"RN", b" nothing ", 0x03),
        (b"MN", b" nothing ", 0x02),
        (b"WN", b" nothing \x00", 0x03),
        (b"WN", b" DeviceIdent \x00", 0x0A),
        (b"MN", b" SetUserLevel \x00", 0x08),
        (b"XY", b" nothing ", 0x0C),
    ],
)
def test_what_it_refuses_and_how(letters: bytes, rest: bytes, error: int) -> None:
    assert open_bench().say(letters, 2, rest) == b"FA" + error.to_bytes(2, "big")


def test_a_period_that_it_does_not_have_is_out_of_its_range() -> None:
    bench = open_bench()
    bench.fake.desk.sessions[int.from_bytes(SESSION, "big")].level = 3
    assert bench.say(b"WN", 2, b" framePeriodUs \x00\x00\x00\x01") == b"FA\x00\x04"
    assert bench.say(b"WN", 3, b" framePeriodUs \x00\x00") == b"FA\x00\x08"


def test_sessions_end_when_nobody_asks_and_are_not_without_number() -> None:
    bench = open_bench(sessions=1)
    assert bench.say(b"Ox", 2, b"\x1e\x00\x01a", bytes(4)) == b"FA\x00\x21"
    bench.now_s += 29.0
    assert bench.say(b"RN", 3, b" deviceState ") == b"RA deviceState \x00\x01"
    bench.now_s += 31.0
    assert bench.say(b"RN", 4, b" deviceState ") == b"FA\x00\x22"
    assert bench.say(b"OX", 5, b"\x1e\x00\x01a", bytes(4)) == b"OA"


def test_a_single_frame_sooner_than_a_period_is_silently_dropped() -> None:
    bench = open_bench()
    for request in (2, 3):
        assert bench.say(b"MN", request, b" PLAYNEXT ") == b"AN PLAYNEXT "
    assert bench.frames(0.3) == 1


@pytest.mark.parametrize("model", list(KINDS))
def test_while_somebody_is_logged_in_it_does_not_stream(model: Model) -> None:
    bench = Bench(model)
    bench.fake.play(bench.now_s)
    if model == "t_mini":
        bench.ask(HOSTS["open, 30 s, mapod"])
    (session,) = bench.fake.desk.sessions.values()
    assert bench.frames(0.5) > 0
    session.level = 3
    bench.frames(0.1)
    assert bench.frames(0.5) == 0
    session.level = 0
    assert bench.frames(0.5) > 0


def test_what_is_no_telegram_is_ignored() -> None:
    bench = open_bench()
    junk = b"\x02\x02\x02\x02\xff\xff\xff\xff" + bytes(range(256)) + b"\x02" * 9
    assert bench.ask(junk) == b""
    assert bench.ask(HOSTS["read DeviceIdent"]).endswith(b"3.0.0.2334")


def test_a_rebooted_camera_drops_its_hosts_and_begins_anew() -> None:
    bench = open_bench()
    bench.fake.play(bench.now_s)
    assert bench.frames(0.5)
    bench.fake.reboot(bench.now_s)
    assert bench.frames(1.0) == 0
    assert bench.control.gone
    assert bench.stream.gone
    bench.now_s += 2.0
    assert not bench.fake.is_off(bench.now_s)
    assert not bench.fake.is_playing
    assert bench.fake.desk.sessions == {}
