"""Captured network packets (pcap, pcapng) to TCP segments; nothing above TCP.

Takes what Wireshark, tcpdump and dumpcap write: both byte orders, microseconds and nanoseconds,
several interfaces and sections, Ethernet (with VLAN tags), Linux cooked (1 and 2), raw IP and
loopback; IPv4 and IPv6. A file that ends within a packet is read up to the packet before. It leaves
out packets that are no TCP, and fragments of IP.
Source: IETF drafts pcap and pcapng; tcpdump.org, link-layer header types; RFC 791, 8200, 9293.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

PCAP = {  # first bytes: byte order, ticks of a second
    b"\xd4\xc3\xb2\xa1": ("<", 10**6),
    b"\xa1\xb2\xc3\xd4": (">", 10**6),
    b"\x4d\x3c\xb2\xa1": ("<", 10**9),
    b"\xa1\xb2\x3c\x4d": (">", 10**9),
}
INTERFACE, OLD_PACKET, SIMPLE_PACKET, PACKET = 1, 2, 3, 6  # of pcapng
BYTE_ORDERS = {b"\x4d\x3c\x2b\x1a": "<", b"\x1a\x2b\x3c\x4d": ">"}
END_OF_OPTIONS, RESOLUTION, OFFSET = 0, 9, 14
MARKS = {*PCAP, b"\x0a\x0d\x0d\x0a"}
MOST_BYTES = 16 << 20  # of a block
NULL, ETHERNET, RAW, LOOP, COOKED, IPV4, IPV6, COOKED_2 = 0, 1, 101, 108, 113, 228, 229, 276
RAWS = {RAW, IPV4, IPV6, 12, 14}
VLANS = {0x8100, 0x88A8, 0x9100}
IP_TYPES = {0x0800, 0x86DD}
TCP = 6
SKIPPED_HEADERS = {0, 43, 60}  # of IPv6: hop-by-hop, routing, destination
SYN = 2

Endpoint = tuple[bytes, int]  # address, port


class CaptureError(Exception):
    """The file is no capture that can be read; the text says why."""


@dataclass(frozen=True, slots=True)
class Segment:
    """One TCP segment as it was captured."""

    t_s: float  # capture clock, seconds since 1970
    source: Endpoint
    target: Endpoint
    seq: int  # of its first byte, modulo 2^32
    flags: int
    payload: bytes


@dataclass(slots=True)
class Interface:
    """What a pcapng section says of one."""

    link: int
    snap_bytes: int  # 0: no limit
    ticks: int = 10**6  # of a second
    offset_s: int = 0


class Capture:
    """A capture on disk. Raises CaptureError, OSError.

    Attributes:
        is_cut: known after reading: it ends within a packet.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.is_cut = path, False
        with path.open("rb") as file:
            self._mark = file.read(4)
        if self._mark not in MARKS:
            raise CaptureError(f"{path} is neither pcap nor pcapng")

    def segments(self) -> Iterator[Segment]:
        """Every TCP segment, in the order of the file. Raises CaptureError: it is damaged."""
        self.is_cut = False
        with self.path.open("rb") as file:
            for t_s, link, packet in self._packets(file):
                segment = maybe_segment(t_s, link, packet)
                if segment is not None:
                    yield segment

    def _packets(self, file: BinaryIO) -> Iterator[tuple[float, int, bytes]]:
        """Time, link type and bytes of each."""
        try:
            if self._mark in PCAP:
                yield from self._of_pcap(file)
            else:
                yield from self._of_pcapng(file)
        except (struct.error, IndexError):
            raise self._damaged(file) from None

    def _of_pcap(self, file: BinaryIO) -> Iterator[tuple[float, int, bytes]]:
        order, ticks = PCAP[self._mark]
        head = struct.Struct(order + "4I")
        link = struct.unpack(order + "I", file.read(24)[20:])[0] & 0xFFFF
        while start := file.read(head.size):
            if len(start) < head.size:
                self.is_cut = True
                return
            seconds, parts, length, _ = head.unpack(start)
            if length > MOST_BYTES or parts >= ticks:
                raise self._damaged(file)
            packet = file.read(length)
            if len(packet) < length:
                self.is_cut = True
                return
            yield seconds + parts / ticks, link, packet

    def _of_pcapng(self, file: BinaryIO) -> Iterator[tuple[float, int, bytes]]:
        order, interfaces = "<", list[Interface]()
        while start := file.read(12):
            if len(start) < 12:
                self.is_cut = True
                return
            if start[:4] == b"\x0a\x0d\x0d\x0a":
                if start[8:12] not in BYTE_ORDERS:
                    raise self._damaged(file)
                order, interfaces = BYTE_ORDERS[start[8:12]], []
            kind, length = struct.unpack(order + "II", start[:8])
            if length < 12 or length % 4 or length > MOST_BYTES:
                raise self._damaged(file)
            body = start[8:] + file.read(length - 12)
            if len(body) < length - 8:
                self.is_cut = True
                return
            if kind == INTERFACE:
                interfaces.append(interface_from_body(order, body))
            elif kind in (PACKET, OLD_PACKET, SIMPLE_PACKET):
                yield packet_from_body(order, kind, body, interfaces)

    def _damaged(self, file: BinaryIO) -> CaptureError:
        return CaptureError(f"{self.path} is damaged before byte {file.tell()}")


def interface_from_body(order: str, body: bytes) -> Interface:
    link, _, snap_bytes = struct.unpack_from(order + "HHI", body)
    found, at = Interface(link, snap_bytes), 8
    while at + 4 <= len(body) - 4:
        code, length = struct.unpack_from(order + "HH", body, at)
        value = body[at + 4 : at + 4 + length]
        at += 4 + length + -length % 4
        if code == END_OF_OPTIONS:
            break
        if code == RESOLUTION and length == 1:
            found.ticks = 2 ** (value[0] & 0x7F) if value[0] & 0x80 else 10 ** value[0]
        elif code == OFFSET and length == 8:
            (found.offset_s,) = struct.unpack(order + "q", value)
    return found


def packet_from_body(
    order: str, kind: int, body: bytes, interfaces: list[Interface]
) -> tuple[float, int, bytes]:
    """Raises struct.error, IndexError: it is none."""
    if kind == SIMPLE_PACKET:  # which has no time
        (length,) = struct.unpack_from(order + "I", body)
        most = interfaces[0].snap_bytes or length
        return 0.0, interfaces[0].link, body[4 : 4 + min(length, most)]
    if kind == PACKET:
        number, high, low, length, _ = struct.unpack_from(order + "5I", body)
    else:
        number, _, high, low, length, _ = struct.unpack_from(order + "HH4I", body)
    if 20 + length > len(body) - 4:
        raise IndexError
    interface = interfaces[number]
    t_s = interface.offset_s + (high << 32 | low) / interface.ticks
    return t_s, interface.link, body[20 : 20 + length]


def maybe_segment(t_s: float, link: int, packet: bytes) -> Segment | None:
    """The TCP segment in a packet; None: there is none, or it is cut off before its payload."""
    try:
        at = _start_of_ip(link, packet)
        if at is None:
            return None
        source, target, start, end = _addresses_and_content(packet, at)
        if start < 0:
            return None
        ports = struct.unpack_from(">HH", packet, start)
        (seq,) = struct.unpack_from(">I", packet, start + 4)
        words, flags = packet[start + 12] >> 4, packet[start + 13]
    except (struct.error, IndexError):
        return None
    payload = packet[start + 4 * max(words, 5) : end]
    return Segment(t_s, (source, ports[0]), (target, ports[1]), seq, flags, payload)


def _start_of_ip(link: int, packet: bytes) -> int | None:
    """Where the IP header begins; None: another protocol, or a link that is not known."""
    if link == ETHERNET:
        at = 12
        while (kind := int.from_bytes(packet[at : at + 2], "big")) in VLANS:
            at += 4
        return at + 2 if kind in IP_TYPES else None
    if link == COOKED:
        return 16 if int.from_bytes(packet[14:16], "big") in IP_TYPES else None
    if link == COOKED_2:
        return 20 if int.from_bytes(packet[:2], "big") in IP_TYPES else None
    if link in RAWS:
        return 0
    return 4 if link in (NULL, LOOP) else None


def _addresses_and_content(packet: bytes, at: int) -> tuple[bytes, bytes, int, int]:
    """Source and target, where TCP begins (-1: it is none) and ends. Raises as indexing does."""
    if packet[at] >> 4 == 4:
        (whole,) = struct.unpack_from(">H", packet, at + 2)
        (fragment,) = struct.unpack_from(">H", packet, at + 6)
        end = at + whole if whole else len(packet)  # 0: the network card was to fill it in
        is_tcp = packet[at + 9] == TCP and not fragment & 0x3FFF
        start = at + 4 * (packet[at] & 15) if is_tcp else -1
        return packet[at + 12 : at + 16], packet[at + 16 : at + 20], start, end
    if packet[at] >> 4 != 6:
        return b"", b"", -1, 0
    (length,) = struct.unpack_from(">H", packet, at + 4)
    following, start = packet[at + 6], at + 40
    end = start + length if length else len(packet)
    while following in SKIPPED_HEADERS:
        following, start = packet[start], start + 8 + 8 * packet[start + 1]
    start = start if following == TCP else -1
    return packet[at + 8 : at + 24], packet[at + 24 : at + 40], start, end
