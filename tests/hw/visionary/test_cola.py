"""Control telegrams: those of the sheet both ways, and whatever else comes."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw.device import BadFrame
from hw.visionary.access import password_hash, response
from hw.visionary.cola import (
    MOST_BYTES,
    ColaParser,
    Reply,
    arguments,
    encode_cola_2,
    encode_cola_b,
    flexstring,
    texts_of,
)
from tests.support.devices.visionary_vectors import TELEGRAMS

ANSWERS = [one for one in TELEGRAMS if not one.is_hosts]
NUMBERS = bytes(range(32))
SESSION = 0x4E11BA11
LOGIN = response("service", "CUST_SERV", NUMBERS[:16], NUMBERS[16:]) + b"\x04"
COMMANDS = [  # as control.tsv has them, in its order
    encode_cola_2(0, 1, "Ox", bytes([30]) + flexstring("mapod")),
    encode_cola_2(SESSION, 2, "RN", arguments("DeviceIdent", b"")),
    encode_cola_2(SESSION, 3, "MN", arguments("GetChallenge", b"")),
    encode_cola_2(SESSION, 4, "MN", arguments("GetChallenge", b"\x04")),
    encode_cola_2(SESSION, 5, "MN", arguments("SetUserLevel", LOGIN)),
    encode_cola_2(SESSION, 6, "WN", arguments("framePeriodUs", (50_000).to_bytes(4, "big"))),
    encode_cola_2(SESSION, 7, "MN", arguments("Run", b"")),
    encode_cola_2(SESSION, 8, "MN", arguments("PLAYSTART", b"")),
    encode_cola_2(SESSION, 9, "MN", arguments("PLAYSTOP", b"")),
    encode_cola_2(SESSION, 10, "MN", arguments("PLAYNEXT", b"")),
    encode_cola_2(SESSION, 11, "Cx", b""),
    encode_cola_b("RN", arguments("DeviceIdent", b"")),
    encode_cola_b("MN", arguments("PLAYSTART", b"")),
    encode_cola_b("MN", arguments("PLAYSTOP", b"")),
]


def replies(data: bytes, is_cola_2: bool) -> list[Reply | BadFrame]:
    return ColaParser(is_cola_2).feed(0.0, data)


def test_commands_are_as_the_sheet_has_them() -> None:
    assert [one.data for one in TELEGRAMS if one.is_hosts] == COMMANDS


def test_answers_of_the_sheet_are_understood() -> None:
    found = [replies(one.data, one.is_cola_2) for one in ANSWERS]
    assert all(len(events) == 1 for events in found)
    told = [events[0] for events in found]
    assert told[0] == Reply("OA", "", b"", 0, SESSION, 1)
    assert isinstance(told[1], Reply)
    assert texts_of(told[1].data) == ["Visionary-T Mini CX V3S105-1x", "3.0.0.2334"]
    assert told[2] == Reply("FA", "", b"", 8, SESSION, 3)
    assert told[3] == Reply("AN", "GetChallenge", b"\x00" + NUMBERS, 0, SESSION, 4)
    assert told[5] == Reply("WA", "framePeriodUs", b"", 0, SESSION, 6)
    assert told[-2] == Reply("FA", "", b"", 0x22, 0xDEAD, 12)
    assert told[-1] == Reply("FA", "", b"", 3)


def test_passwords_become_what_the_sheet_says() -> None:
    assert [password_hash(word) for word in ("CLIENT", "CUST_SERV", "client")] == [
        0xFB356CDE,
        0xED784BAA,
        0xF4724744,
    ]
    client = response("authorized_client", "CLIENT", NUMBERS[:16], NUMBERS[16:]).hex()
    assert client == "4a74090bc07f16ba2897b524545cbfd0b7ef0efc69d548a12b29f463c4757461"


JUNK = st.binary(max_size=20).map(lambda junk: junk.replace(b"\x02", b""))
WHOLE = [[one.data for one in ANSWERS if one.is_cola_2 == kind] for kind in (False, True)]


@given(st.booleans(), st.lists(st.tuples(JUNK, st.integers(0, 9))), st.lists(st.integers(0, 999)))
def test_answers_survive_junk_and_any_cutting(
    is_cola_2: bool, parts: list[tuple[bytes, int]], cuts: list[int]
) -> None:
    known = WHOLE[is_cola_2]
    sent = [known[k % len(known)] for _, k in parts]
    stream = b"".join(junk + one for (junk, _), one in zip(parts, sent, strict=True))
    edges = [0, *sorted(min(cut, len(stream)) for cut in cuts), len(stream)]
    parser = ColaParser(is_cola_2)
    events = [event for a, b in pairwise(edges) for event in parser.feed(0.0, stream[a:b])]
    wanted = [event for one in sent for event in replies(one, is_cola_2)]
    assert [event for event in events if isinstance(event, Reply)] == wanted


HEAD = st.sampled_from(
    [b"\x02" * 4, b"\x02\x02", bytes(3), b"\x0c", b"sFA", b"sAN x", b"FA", b"OA"]
)


@given(st.booleans(), st.lists(st.one_of(HEAD, st.binary(max_size=40))))
def test_no_bytes_make_the_parser_raise_or_keep_more_than_a_telegram(
    is_cola_2: bool, pieces: list[bytes]
) -> None:
    parser = ColaParser(is_cola_2)
    for piece in pieces:
        parser.feed(0.0, piece)
    assert len(parser._buffer) <= MOST_BYTES + 9


@pytest.mark.parametrize("length", [0, 9, MOST_BYTES + 1, 0xFFFFFFFF])
def test_a_length_that_cant_be_is_not_waited_for(length: int) -> None:
    wrong = b"\x02" * 4 + length.to_bytes(4, "big")
    events = replies(wrong + ANSWERS[0].data, True)
    assert events[-1] == Reply("OA", "", b"", 0, SESSION, 1)
