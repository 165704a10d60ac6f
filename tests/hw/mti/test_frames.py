"""MT frames: the sheet's own, damaged ones, and when they arrived."""

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from hw.device import BadFrame
from hw.mti.frames import ERRORS, MtFrame, MtParser, describe_error, encode_frame
from tests.support.cases import cut
from tests.support.devices.mti_frames import ROWS, wire

BAUD = 115200
EULER_FRAME = wire("MTData 0006 00000005")
MIDS = st.integers(0, 255)
JUNK = st.binary(max_size=20).map(lambda junk: junk.replace(b"\xfa", b""))


def frames_of(data: bytes, now_s: float = 0.0) -> list[MtFrame]:
    return [e for e in MtParser(BAUD).feed(now_s, data) if isinstance(e, MtFrame)]


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row[1]} {row[3]}")
def test_each_frame_of_the_sheet_is_read_and_written_byte_for_byte(row: list[str]) -> None:
    frame = bytes.fromhex(row[2])
    [event] = MtParser(BAUD).feed(0.0, frame)
    assert event == MtFrame(frame[2], frame[4:-1])
    assert encode_frame(frame[2], frame[4:-1]) == frame
    assert frames_of(frame)[0].wire_bytes == len(frame)


def test_the_extended_length_begins_at_255_bytes_and_bus_id_1_is_heard() -> None:
    assert encode_frame(0x36, bytes(260)).hex(" ").startswith("fa ff 36 ff 01 04")
    for size in (254, 255, 256, 1320, 2048):
        frame = encode_frame(0x91, bytes(size))
        assert frames_of(frame) == [MtFrame(0x91, bytes(size))]
        assert frames_of(frame)[0].wire_bytes == len(frame)
    assert frames_of(bytes.fromhex("FA 01 00 00 FF")) == [MtFrame(0, b"")]  # bus id 1
    with pytest.raises(ValueError, match="2048"):
        encode_frame(0x91, bytes(2049))


@pytest.mark.parametrize(
    ("junk", "reason"),
    [
        ("FA FF 31 00 D1", "bad checksum"),
        ("FA FF 42 01 04 BB", "bad checksum"),
        ("FA 02 00 00 FE", "no start of a frame"),
        ("FA FF 31 FF 08 01", "bad extended length"),
        ("00 31 00 D0", "no start of a frame"),
    ],
)
def test_what_is_no_frame_is_told_with_the_next_frame_or_later(junk: str, reason: str) -> None:
    bad, good = BadFrame(reason, bytes.fromhex(junk)), MtFrame(0x31, b"")
    assert MtParser(BAUD).feed(0.0, bad.skipped + encode_frame(0x31)) == [bad, good]
    parser = MtParser(BAUD)
    assert parser.feed(0.0, bad.skipped) == []
    assert parser.feed(0.11, b"") == [bad]


@given(
    junk=st.binary(max_size=600)
    | st.lists(st.sampled_from([b"\xfa\xff", b"\xfa", b"\x32\x04", b"\0" * 22])).map(b"".join),
    cuts=st.lists(st.integers(0, 700)),
)
@example(junk=b"\0" * 22, cuts=list(range(22)))
def test_where_junk_is_cut_makes_no_difference(junk: bytes, cuts: list[int]) -> None:
    stream = EULER_FRAME + junk + EULER_FRAME
    parser, whole = MtParser(BAUD), MtParser(BAUD)
    events = [event for piece in cut(stream, cuts) for event in parser.feed(0.0, piece)]
    assert events == whole.feed(0.0, stream)
    assert parser.feed(1.0, b"\0" * 300) == whole.feed(1.0, b"\0" * 300)


def test_a_claimed_frame_that_never_completes_is_given_up_in_time() -> None:
    parser = MtParser(BAUD)
    assert parser.feed(0.0, bytes.fromhex("FA FF 32 FE 00 00") + EULER_FRAME) == []
    assert parser.feed(0.1, b"") == []
    [bad, good] = parser.feed(0.13, b"")
    assert isinstance(bad, BadFrame)
    assert bad.reason == "frame not completed in time"
    assert good == MtFrame(0x32, EULER_FRAME[4:-1])


@given(position=st.integers(0, len(EULER_FRAME) - 1), other=st.integers(1, 255))
def test_a_frame_with_any_one_byte_altered_is_rejected(position: int, other: int) -> None:
    altered = bytearray(EULER_FRAME)
    altered[position] ^= other
    parser = MtParser(BAUD)
    events = parser.feed(0.0, bytes(altered)) + parser.feed(1.0, b"\0" * 2100)
    assert not [event for event in events if isinstance(event, MtFrame)]


@given(
    parts=st.lists(st.tuples(JUNK, MIDS, st.binary(max_size=300))),
    cuts=st.lists(st.integers(0, 2000)),
)
def test_frames_survive_junk_and_any_cutting(
    parts: list[tuple[bytes, int, bytes]], cuts: list[int]
) -> None:
    stream = b"".join(junk + encode_frame(mid, data) for junk, mid, data in parts)
    parser = MtParser(BAUD)
    events = [event for piece in cut(stream, cuts) for event in parser.feed(0.0, piece)]
    frames = [event for event in events if isinstance(event, MtFrame)]
    assert frames == [MtFrame(mid, data) for _, mid, data in parts]
    skipped = b"".join(event.skipped for event in events if isinstance(event, BadFrame))
    assert skipped == b"".join(junk for junk, _, _ in parts)


@given(junk=st.lists(st.sampled_from([b"\xfa", b"\xff", b"\x32", b"\x36", b"\x00"])).map(b"".join))
def test_any_junk_has_passed_soon_after_its_time_out(junk: bytes) -> None:
    parser = MtParser(BAUD)
    parser.feed(0.0, junk)
    parser.feed(0.5, b"\0")  # claims within claims were all heard at 0.0
    parser.feed(1.0, b"\0")
    assert parser.feed(2.0, EULER_FRAME)[-1] == MtFrame(0x32, EULER_FRAME[4:-1], 2.0)


@given(st.lists(st.tuples(st.floats(0.0, 1.0), st.binary(max_size=64))))
def test_no_bytes_make_the_parser_raise_or_keep_more_than_a_frame(
    pieces: list[tuple[float, bytes]],
) -> None:
    parser = MtParser(BAUD)
    for now_s, piece in pieces:
        parser.feed(now_s, b"\xfa\xff\x36" + piece)
        parser.feed(now_s, piece)
        assert len(parser.kept) <= 2048 + 7
        assert len(parser._arrivals) <= len(parser.kept)


def test_a_frame_that_stood_behind_a_false_claim_has_its_true_time_of_arrival() -> None:
    parser = MtParser(BAUD)
    parser.feed(1.00, bytes.fromhex("FA FF 32 FE 00 00"))
    parser.feed(1.01, EULER_FRAME)
    parser.feed(1.02, EULER_FRAME[:-1])
    events = parser.feed(1.30, EULER_FRAME[-1:])
    frames = [event for event in events if isinstance(event, MtFrame)]
    assert [frame.arrived_s for frame in frames] == [1.01, 1.30]


def test_every_error_has_its_code_and_its_meaning() -> None:
    for code in (*ERRORS, 0x77):
        text = describe_error(bytes([code]))
        assert text.startswith(f"error {code:02X}, ")
        assert (code == 0x77) == ("not listed" in text)
    assert describe_error(b"") == "an error without a code"
