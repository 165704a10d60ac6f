"""RTU frames out of a stream: cut anywhere, after noise, between what other slaves say; and
requests of any bytes whatever, none of which may make a server raise."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hw.modbus.client import Request
from hw.modbus.image import RegisterImage, View
from hw.modbus.layout import MOST_READ
from hw.modbus.network import datagram_requests, take_requests
from hw.modbus.pdu import Access, answer
from hw.modbus.rtu import KEPT, RtuReceiver, crc16
from tests.support.cases import cut, examples
from tests.support.machine.modbus_rig import START_S, new_image

OURS = frozenset({1, 2})
READ = bytes.fromhex("01 03 00 00 00 0A C5 CD")
WORDS = st.integers(0, 0xFFFF).map(lambda word: word.to_bytes(2, "big"))
OTHERS = st.integers(3, 255)
OTHER_TALK = [  # question and answer; of some functions both have the same length
    (b"\x07", b"\x07\x01"),
    (b"\x11", b"\x11\x02\x01\xff"),
    (bytes.fromhex("16 00 04 00 F2 00 25"),) * 2,
    (bytes.fromhex("08 00 00 12 34"),) * 2,
]


def framed(unit: int, pdu: bytes) -> bytes:
    frame = bytes((unit,)) + pdu
    return frame + crc16(frame).to_bytes(2, "little")


def access_to(image: RegisterImage, view: View | None = None) -> Access:
    """As a client of this machine has it."""
    return Access(image, view, "me", True, START_S, START_S, 0.0)


@st.composite
def requests(draw: st.DrawFn) -> bytes:
    """A well-formed request: function code and data."""
    code = draw(st.sampled_from([1, 2, 3, 4, 5, 6, 15, 16, 22, 23, 43]))
    if code == 43:
        return bytes((43, 14, draw(st.integers(0, 255)), draw(st.integers(0, 255))))
    pdu = bytes((code,)) + draw(WORDS) + draw(WORDS)
    if code == 22:
        return pdu + draw(WORDS)
    data = draw(st.binary(max_size=40))
    if code in (15, 16):
        return pdu + bytes((len(data),)) + data
    if code == 23:
        return pdu + draw(WORDS) + draw(WORDS) + bytes((len(data),)) + data
    return pdu


@st.composite
def spoken_by_others(draw: st.DrawFn) -> bytes:
    """What another unit is asked, and its answer, in which there may be a request for us."""
    unit, code = draw(OTHERS), draw(st.sampled_from([3, 4]))
    if draw(st.booleans()):
        ask, reply = draw(st.sampled_from(OTHER_TALK))
        return framed(unit, ask) + framed(unit, reply)
    inside = draw(st.sampled_from([b"", READ, READ * 2])) + draw(st.binary(max_size=10))
    inside += b"\0" * (len(inside) % 2)
    ask = framed(unit, bytes((code, 0, 0, 0, len(inside) // 2)))
    how = draw(st.sampled_from(["answers", "refuses", "is not there"]))
    if how == "refuses":
        return ask + framed(unit, bytes((code | 0x80, 2)))
    return ask + (framed(unit, bytes((code, len(inside))) + inside) if how == "answers" else b"")


CUTS = st.lists(st.integers(0, 300), max_size=6)


@given(
    parts=st.lists(
        st.one_of(requests().map(lambda pdu: framed(1, pdu)), spoken_by_others()), max_size=6
    ),
    cuts=CUTS,
    pauses=st.sets(st.integers(0, 6)),
)
def test_requests_for_us_are_found_among_what_others_say_wherever_it_is_cut_or_pauses(
    parts: list[bytes], cuts: list[int], pauses: set[int]
) -> None:
    receiver = RtuReceiver(OURS)
    found: list[Request] = []
    for number, piece in enumerate(cut(b"".join(parts), cuts)):
        found += receiver.feed(piece)
        if number in pauses:  # an adapter that holds bytes back for a while
            found += receiver.silence(long=False)
    assert [framed(*one[:2]) for one in found] == [part for part in parts if part[0] == 1]
    assert receiver.rejected == 0
    assert not receiver._buffer


@given(noise=st.binary(max_size=60), pdu=requests(), cuts=CUTS)
def test_the_last_request_is_found_after_any_noise_at_the_latest_after_a_long_silence(
    noise: bytes, pdu: bytes, cuts: list[int]
) -> None:
    receiver = RtuReceiver(OURS)
    found: list[Request] = []
    for piece in cut(noise + framed(1, pdu), cuts):
        found += receiver.feed(piece)
    found += receiver.silence(long=False)
    found += receiver.silence(long=True)
    assert (1, pdu) in [one[:2] for one in found]
    assert not receiver._buffer
    assert receiver.feed(framed(2, pdu)) == [Request(2, pdu)]


@given(st.lists(st.one_of(st.binary(max_size=300), st.booleans()), max_size=20))
def test_no_bytes_make_the_receiver_raise_or_keep_much(pieces: list[bytes | bool]) -> None:
    receiver = RtuReceiver(OURS)
    for piece in pieces:
        if isinstance(piece, bool):
            receiver.silence(long=piece)
        else:
            receiver.feed(piece)
        assert len(receiver._buffer) <= KEPT


def test_a_frame_of_an_unknown_function_ends_with_silence() -> None:
    receiver = RtuReceiver(OURS)
    assert receiver.feed(framed(1, b"\x63\x01\x02")) == []
    assert receiver.silence(long=False) == [Request(1, b"\x63\x01\x02")]
    assert receiver.feed(framed(1, b"\x83\x02")) == []  # an answer: our own, come back
    assert receiver.feed(framed(9, b"\x63\x01\x02")) + receiver.silence(long=False) == []
    assert not receiver._buffer


def test_while_another_slave_answers_a_pause_makes_no_request_of_its_bytes() -> None:
    receiver = RtuReceiver(OURS)
    reply = framed(17, bytes((3, 20)) + b"\0\0" + READ + b"\0" * 10)
    assert receiver.feed(framed(17, bytes.fromhex("03 00 00 00 0A"))) == []
    assert receiver.silence(long=True) == []  # a slow slave
    assert receiver.feed(reply[:13]) == []
    assert receiver.silence(long=False) == []
    assert receiver.feed(reply[13:]) == []
    assert not receiver._buffer
    assert receiver.rejected == 0


@given(st.binary(max_size=600))
def test_no_bytes_make_the_network_frames_raise(data: bytes) -> None:
    stream = bytearray(data)
    found, reason = take_requests(stream)
    assert datagram_requests(data) == ([] if stream or reason else found)
    assert all(one.pdu for one in found)


@settings(max_examples=examples(30))
@given(st.lists(st.one_of(requests(), st.binary(min_size=1, max_size=30)), max_size=20))
def test_every_request_has_one_answer_that_is_no_longer_than_allowed(pdus: list[bytes]) -> None:
    image = new_image(ask=lambda *_: "")
    for view in (None, image.new_view()):
        access = access_to(image, view)
        for pdu in pdus:
            told = answer(pdu, access)
            assert told[0] & 0x7F == pdu[0] & 0x7F
            assert len(told) == 2 if told[0] & 0x80 else 2 <= len(told) <= 2 + 2 * MOST_READ


@pytest.mark.parametrize(
    ("request_", "told"),
    [
        ("01 00 00 00 10", "01 02 50 4D"),  # bits are those of the registers
        ("02 01 51 00 04", "02 01 0F"),
        ("02 0A AF 00 01", "02 01 00"),
        ("02 0A B0 00 01", "82 02"),
        ("17 00 5A 00 01 00 5A 00 01 02 00 01", "17 02 00 01"),  # it writes first
        ("16 00 5A 00 00 00 01", "16 00 5A 00 00 00 01"),
    ],
)
def test_single_bits_and_writing_with_reading(request_: str, told: str) -> None:
    image = new_image()
    access = access_to(image, image.new_view())
    assert answer(bytes.fromhex(request_), access) == bytes.fromhex(told)
