"""Captured packets become the bytes that were sent: however they were cut, doubled and turned."""

import struct
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests import ROOT
from tools.replay.capture import Capture, CaptureError, Segment, maybe_segment
from tools.replay.streams import SequenceLine, chosen, conversations, stream_of

VECTORS = ROOT / "tests" / "vectors"
SCANNER, HOST = (bytes([10, 0, 0, 1]), 2112), (bytes([10, 0, 0, 2]), 50000)


def tcp(seq: int, payload: bytes, flags: int = 0x10) -> bytes:
    return struct.pack(">HHIIBBHHH", SCANNER[1], HOST[1], seq, 0, 0x50, flags, 0, 0, 0) + payload


def ipv4(content: bytes) -> bytes:
    head = struct.pack(">BBHHHBBH", 0x45, 0, 20 + len(content), 0, 0, 64, 6, 0)
    return head + SCANNER[0] + HOST[0] + content


def ipv6(content: bytes) -> bytes:
    """With a hop-by-hop header in between."""
    head = struct.pack(">IHBB", 0x60000000, 8 + len(content), 0, 64)
    return head + bytes(15) + b"\1" + bytes(15) + b"\2" + struct.pack(">BB6x", 6, 0) + content


LINKS: dict[int, Callable[[bytes], bytes]] = {
    1: lambda packet: bytes(12) + b"\x81\x00\x00\x05\x08\x00" + packet + bytes(9),  # VLAN, padded
    113: lambda packet: bytes(14) + b"\x08\x00" + packet,
    276: lambda packet: b"\x08\x00" + bytes(18) + packet,
    101: lambda packet: packet,
    0: lambda packet: b"\x02\x00\x00\x00" + packet,
}


@pytest.mark.parametrize("link", LINKS)
def test_every_kind_of_link_leads_to_the_same_segment(link: int) -> None:
    segment = maybe_segment(1.5, link, LINKS[link](ipv4(tcp(7, b"abc"))))
    assert segment == Segment(1.5, SCANNER, HOST, 7, 0x10, b"abc")


def test_ipv6_with_further_headers_and_what_is_no_tcp() -> None:
    segment = maybe_segment(0.0, 101, ipv6(tcp(9, b"xyz")))
    assert segment is not None
    assert (segment.seq, segment.payload, segment.source[1]) == (9, b"xyz", 2112)
    assert maybe_segment(0.0, 1, bytes(12) + b"\x08\x06" + bytes(30)) is None  # ARP
    fragment = bytearray(ipv4(tcp(7, b"abc")))
    fragment[6] = 0x20
    assert maybe_segment(0.0, 101, bytes(fragment)) is None


@given(st.binary(max_size=80), st.sampled_from([*LINKS, 228, 229, 500]))
def test_no_packet_makes_it_raise(packet: bytes, link: int) -> None:
    maybe_segment(0.0, link, packet)


@given(
    st.binary(min_size=1, max_size=200),
    st.lists(st.tuples(st.integers(0, 199), st.integers(1, 60)), max_size=30),
    st.integers(0, 2**32 - 1),
    st.randoms(use_true_random=False),
)
def test_bytes_come_in_order_however_they_were_sent(
    data: bytes, again: list[tuple[int, int]], first: int, random: object
) -> None:
    """All of it in pieces of 20, some again with other borders, turned within a window."""
    spans = [(at, at + 20) for at in range(0, len(data), 20)]
    spans += [(at, at + size) for at, size in again if at < len(data)]
    getattr(random, "shuffle")(spans)  # noqa: B009
    line = SequenceLine()
    line.take(Segment(0.0, SCANNER, HOST, (first - 1) % 2**32, 2, b""))  # its SYN
    for k, (start, end) in enumerate(spans):
        seq = (first + start) % 2**32
        line.take(Segment(float(k), SCANNER, HOST, seq, 0x10, data[start:end]))
    stream = line.stream()
    assert b"".join(piece for _, piece in stream.pieces) == data
    assert stream.missing == 0
    times = [t_s for t_s, _ in stream.pieces]
    assert times == sorted(times)


def test_what_was_never_captured_is_left_out_and_holds_nothing_up() -> None:
    line = SequenceLine()
    for t_s, seq, data in ((0.0, 100, b"abc"), (1.0, 110, b"xyz"), (2.0, 113, b"!")):
        line.take(Segment(t_s, SCANNER, HOST, seq, 0x10, data))
    stream = line.stream()
    assert stream.pieces == [(0.0, b"abc"), (1.0, b"xyz"), (2.0, b"!")]
    assert stream.missing == 7


def test_a_real_capture_gives_the_bytes_of_its_scanner() -> None:
    capture = Capture(VECTORS / "tim781_1s.pcapng")
    wanted = chosen(capture, None)
    assert wanted.scanner == 0
    stream = stream_of(capture, wanted, 0)
    assert (
        b"".join(data for _, data in stream.pieces) == (VECTORS / "tim781_1s_d2h.bin").read_bytes()
    )
    assert not capture.is_cut


def pcap(packets: list[bytes], order: str = "<") -> bytes:
    head = struct.pack(order + "IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 101)
    return head + b"".join(
        struct.pack(order + "IIII", 5, k, len(packet), len(packet)) + packet
        for k, packet in enumerate(packets)
    )


@pytest.mark.parametrize("order", "<>")
def test_a_pcap_that_was_cut_off_is_read_up_to_its_last_whole_packet(
    order: str, tmp_path: Path
) -> None:
    path = tmp_path / "a.pcap"
    path.write_bytes(pcap([ipv4(tcp(7, b"ab")), ipv4(tcp(9, b"cd"))], order)[:-1])
    capture = Capture(path)
    assert [segment.payload for segment in capture.segments()] == [b"ab"]
    assert capture.is_cut


def test_several_scanners_are_to_be_chosen_from(tmp_path: Path) -> None:
    """The same ends with a SYN of another number are another conversation."""
    path = tmp_path / "a.pcap"
    path.write_bytes(
        pcap(
            [
                ipv4(tcp(7, b"", 2)),
                ipv4(tcp(8, b"ab")),
                ipv4(tcp(99, b"", 2)),
                ipv4(tcp(100, b"cd")),
            ]
        )
    )
    capture = Capture(path)
    assert [one.sent_bytes for one in conversations(capture)] == [[2, 0], [2, 0]]
    with pytest.raises(CaptureError, match=r"--stream one of 0: 10\.0\.0\.1:2112 2 bytes"):
        chosen(capture, None)
    second = stream_of(capture, chosen(capture, 1), 0)
    assert b"".join(data for _, data in second.pieces) == b"cd"
