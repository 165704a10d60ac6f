"""SCIP replies: the sheet's, cut anywhere, mixed with junk, damaged, never ending."""

import contextlib
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hw.device import BadFrame
from hw.urg04lx.scip import (
    INCOMPLETE_S,
    MOST_BYTES,
    Reply,
    ScipError,
    ScipParser,
    number_in,
    numbers_in,
    sum_of,
)
from hw.urg04lx.sensor import maybe_sensor, texts_of
from tests.support.cases import cut, examples
from tests.support.devices.urg04lx_vectors import CONTENTS, REPLIES, STATUSES

FEWER = settings(max_examples=examples(50))


def fed(*pieces: bytes) -> list[Any]:
    parser = ScipParser()
    return [event for piece in pieces for event in parser.feed(0.0, piece)]


def only(data: bytes) -> Reply:
    (reply,) = fed(data)
    assert isinstance(reply, Reply)
    return reply


@pytest.mark.parametrize("name", REPLIES)
def test_every_reply_of_the_sheet_is_read(name: str) -> None:
    reply, content = only(REPLIES[name]), CONTENTS[name]
    assert reply.command == REPLIES[name].split(b"\n")[0].decode()
    assert (reply.status, reply.size) == (STATUSES[name], len(REPLIES[name]))
    if "=" in content:
        key, _, text = content.partition("=")
        assert texts_of(reply)[key] == text
    elif content:
        ticks, _, values = content.partition(": ")
        characters = 3 if reply.command.startswith("MD") else 2
        assert number_in(reply.lines[0]) == int(ticks)
        assert numbers_in(reply.data, characters).tolist() == [float(v) for v in values.split()]


def test_a_sensor_is_what_its_parameters_say() -> None:
    found = maybe_sensor(only(REPLIES["vendor PP"]))
    assert found is not None
    assert (found.first_step, found.last_step, found.front_step) == (44, 725, 384)
    assert (found.steps, found.turn_s, found.least_mm, found.most_mm) == (1024, 0.1, 20, 5600)
    lines = REPLIES["vendor PP"].split(b"\n")
    for k, value in ((4, b"ARES:0;"), (5, b"AMIN:726;"), (7, b"AFRT:800;"), (8, b"SCAN:x;")):
        text = value[:-1]
        damaged = [*lines[:k], value + bytes([sum_of(text)]), *lines[k + 1 :]]
        assert maybe_sensor(only(b"\n".join(damaged))) is None


def test_numbers_have_two_three_or_four_characters() -> None:
    assert [number_in(text) for text in (b"CB", b"oo", b"1Dh", b"00D", b"m2@0", b"oooo")] == [
        1234, 4095, 5432, 20, 16_000_000, 16_777_215,
    ]  # fmt: skip
    assert numbers_in(b"", 3).size == 0
    for wrong in (b"0", b"0p", b"0/"):
        with pytest.raises(ScipError):
            numbers_in(wrong, 2)
    with pytest.raises(ScipError):
        number_in(b"p")


@pytest.mark.parametrize("status", [b"\xb2", b"e", b" "])
def test_a_status_of_one_character_is_a_digit_or_a_capital(status: bytes) -> None:
    (bad,) = fed(b"QT\n" + status + b"\n\n")
    assert isinstance(bad, BadFrame)


@pytest.mark.parametrize("end", [b"", b";"])
def test_a_sum_counts_the_semicolon_or_not(end: bytes) -> None:
    text = b"SERI:H0614967"
    reply = only(b"VV\n00P\n" + text + b";" + bytes([sum_of(text + end)]) + b"\n\n")
    assert texts_of(reply) == {"SERI": "H0614967"}


@FEWER
@given(st.data())
def test_replies_survive_any_cutting_and_each_is_told_once(data: st.DataObject) -> None:
    names = data.draw(st.lists(st.sampled_from(list(REPLIES)), min_size=1, max_size=6))
    stream = b"".join(REPLIES[name] for name in names)
    cuts = data.draw(st.lists(st.integers(0, len(stream)), max_size=8))
    assert fed(*cut(stream, cuts)) == [event for name in names for event in fed(REPLIES[name])]


@FEWER
@given(st.data())
def test_a_damaged_byte_costs_its_own_reply_at_most_and_gives_no_other_range(
    data: st.DataObject,
) -> None:
    scan = REPLIES["MD scan"]
    at = data.draw(st.integers(0, len(scan) - 1))
    byte = data.draw(st.integers(0, 255).filter(lambda byte: byte != scan[at]))
    damaged = scan[:at] + bytes([byte]) + scan[at + 1 :]
    good = only(scan)
    replies = [event for event in fed(scan + damaged + scan + scan) if isinstance(event, Reply)]
    assert replies[0] == good
    assert replies[-1] == good
    for reply in replies:
        if reply.command == good.command:  # the echo has no sum
            assert reply.status == good.status
            with contextlib.suppress(ScipError):  # a sum does not see 64 more or less
                values = numbers_in(reply.data, 3)
                if values.size == 6:  # else it is no scan: a byte has become the end of a line
                    assert number_in(reply.lines[0]) == 74565
                    assert values.tolist() == [0.0, 7.0, 19.0, 20.0, 1000.0, 5600.0]


def test_a_torn_reply_costs_none_behind_it() -> None:
    """Its last bytes are lost, with the empty line that ends it; one sum in 64 fits by chance."""
    scan, good = REPLIES["MD scan"], only(REPLIES["MD scan"])
    ends = [
        fed(reply[:kept] + scan)[-1] for reply in REPLIES.values() for kept in range(len(reply))
    ]
    assert ends.count(good) > 0.95 * len(ends)
    for end in ends:
        if isinstance(end, Reply) and end.command == good.command and len(end.data) == 18:
            assert numbers_in(end.data, 3).tolist() == numbers_in(good.data, 3).tolist()


@FEWER
@given(st.lists(st.binary(max_size=300) | st.sampled_from(list(REPLIES.values()))))
def test_no_bytes_make_the_parser_raise_or_keep_more_than_a_reply(pieces: list[bytes]) -> None:
    parser = ScipParser()
    for tick, piece in enumerate(pieces):
        for event in parser.feed(tick * 0.1, piece):
            assert isinstance(event, Reply | BadFrame)
        assert len(parser._buffer) <= MOST_BYTES + 300


def test_what_never_ends_is_given_up_and_the_next_reply_is_read() -> None:
    parser = ScipParser()
    assert parser.feed(0.0, b"MD0044") == []
    (bad, reply) = parser.feed(INCOMPLETE_S + 0.1, REPLIES["MD begun"])
    assert isinstance(bad, BadFrame)
    assert isinstance(reply, Reply)
    (bad,) = parser.feed(5.0, b"0" * (MOST_BYTES + 1))
    assert isinstance(bad, BadFrame)
    assert len(parser.feed(5.0, b"\n\n" + REPLIES["MD begun"])) == 1


def test_three_characters_may_be_cut_by_the_end_of_a_line() -> None:
    values = np.arange(0, 45)
    text = b"".join(bytes([0x30, 0x30 + (v >> 6), 0x30 + (v & 63)]) for v in values)
    lines = [text[:64], text[64:128], text[128:]]
    body = b"".join(line + bytes([sum_of(line)]) + b"\n" for line in lines)
    reply = only(b"GD0044008800\n00P\n0B=5T\n" + body + b"\n")
    assert numbers_in(reply.data, 3).tolist() == values.tolist()
