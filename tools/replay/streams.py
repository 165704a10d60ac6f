"""The conversations in a capture, and the bytes of one of them in order.

Bytes are put in order by their sequence numbers: what was sent again counts once. Bytes that had
to wait for an earlier one are given when that had come, as a host's system does. What was never
captured is left out and counted; parsers find their way back.
"""

import heapq
import ipaddress
from dataclasses import dataclass, field
from itertools import pairwise

from tools.replay.capture import SYN, Capture, CaptureError, Endpoint, Segment

SCANNER_PORTS = (2111, 2112)  # of SICK's scanners
SCAN = b"LMDscandata"
WRAP = 2**32
Piece = tuple[float, bytes]  # seconds since 1970, bytes


@dataclass(slots=True)
class Conversation:
    """One TCP connection: its ends, and what each has sent."""

    number: int  # in the order of the file, as Wireshark counts tcp.stream
    begin_s: float
    ends: tuple[Endpoint, Endpoint]
    sent_bytes: list[int] = field(default_factory=lambda: [0, 0])
    scans: list[int] = field(default_factory=lambda: [0, 0])  # payloads that tell of scan data
    syns: list[int | None] = field(default_factory=lambda: [None, None])

    @property
    def scanner(self) -> int | None:
        """Which end is the scanner; None: neither looks like one."""
        if max(self.scans) > 1:
            return self.scans.index(max(self.scans))
        return next((k for k in (0, 1) if self.ends[k][1] in SCANNER_PORTS), None)

    def describe(self) -> str:
        one, other = (describe_end(end) for end in self.ends)
        return f"{self.number}: {one} {self.sent_bytes[0]} bytes, {other} {self.sent_bytes[1]}"


def describe_end(end: Endpoint) -> str:
    """`192.168.0.1:2112`"""
    address = ipaddress.ip_address(end[0])
    return f"[{address}]:{end[1]}" if address.version == 6 else f"{address}:{end[1]}"


class Sorter:
    """Which conversation a segment belongs to; a new one where the same ends begin anew."""

    def __init__(self) -> None:
        self.found: list[Conversation] = []
        self._newest: dict[frozenset[Endpoint], Conversation] = {}

    def conversation(self, segment: Segment) -> tuple[Conversation, int]:
        """The conversation, and which of its ends has sent this."""
        ends = frozenset((segment.source, segment.target))
        known = self._newest.get(ends)
        if known is None or self._begins_anew(known, segment):
            known = Conversation(len(self.found), segment.t_s, (segment.source, segment.target))
            self.found.append(known)
            self._newest[ends] = known
        end = known.ends.index(segment.source)
        if segment.flags & SYN:
            known.syns[end] = segment.seq
        return known, end

    def _begins_anew(self, known: Conversation, segment: Segment) -> bool:
        """A SYN of a number that this end has not begun with, and something was sent before."""
        if not segment.flags & SYN:
            return False
        syn = known.syns[known.ends.index(segment.source)]
        return syn != segment.seq and (syn is not None or any(known.sent_bytes))


def conversations(capture: Capture) -> list[Conversation]:
    """All of them, with how much each end has sent. Raises CaptureError."""
    sorter = Sorter()
    for segment in capture.segments():
        known, end = sorter.conversation(segment)
        known.sent_bytes[end] += len(segment.payload)
        known.scans[end] += SCAN in segment.payload
    return sorter.found


def chosen(capture: Capture, number: int | None) -> Conversation:
    """The scanner's conversation. Raises CaptureError: there is none, or more than one."""
    found = conversations(capture)
    if number is not None:
        if not 0 <= number < len(found):
            there = f"0 to {len(found) - 1}" if found else "none"
            raise CaptureError(f"--stream {number}: {capture.path} has {there}")
        return found[number]
    likely = [one for one in found if max(one.scans) > 1]
    likely = likely or [one for one in found if one.scanner is not None and any(one.sent_bytes)]
    if not likely:
        raise CaptureError(
            f"{capture.path} holds no conversation with a scanner (scan data, or port "
            f"{' or '.join(map(str, SCANNER_PORTS))}) among {len(found)} TCP streams"
        )
    if len(likely) > 1:
        several = "; ".join(one.describe() for one in likely)
        raise CaptureError(f"{capture.path}: choose by --stream one of {several}")
    return likely[0]


@dataclass(frozen=True, slots=True)
class Stream:
    """What one end has sent."""

    pieces: list[Piece]  # in order of bytes and of time
    missing: int  # bytes within it that were not captured


def stream_of(capture: Capture, wanted: Conversation, end: int) -> Stream:
    """Raises CaptureError."""
    sorter, line = Sorter(), SequenceLine()
    for segment in capture.segments():
        known, source = sorter.conversation(segment)
        if known.number == wanted.number and source == end:
            line.take(segment)
    return line.stream()


class SequenceLine:
    """Segments of one end, laid out by their sequence numbers."""

    def __init__(self) -> None:
        self._segments: list[tuple[int, int, float, bytes]] = []  # position, number, s, bytes
        self._newest = 0  # highest position so far
        self._first: int | None = None  # sequence number of position 0

    def take(self, segment: Segment) -> None:
        seq = segment.seq + (1 if segment.flags & SYN else 0)
        if self._first is None:
            self._first = seq
        apart = (seq - self._first - self._newest) % WRAP
        position = self._newest + (apart - WRAP if apart >= WRAP // 2 else apart)
        self._newest = max(self._newest, position + len(segment.payload))
        if segment.payload:
            entry = position, len(self._segments), segment.t_s, segment.payload
            self._segments.append(entry)

    def stream(self) -> Stream:
        """In order; a byte that was captured several times counts when it came first."""
        spans = covered([(start, start + len(data)) for start, _, _, data in self._segments])
        follows = {end: start for (_, end), (start, _) in pairwise(spans)}  # behind what is missing
        at = spans[0][0] if spans else 0
        pieces: list[Piece] = []
        waiting: list[tuple[int, int, bytes]] = []
        for start, number, t_s, payload in self._segments:
            heapq.heappush(waiting, (start, number, payload))
            while waiting and waiting[0][0] <= at:
                start, _, payload = heapq.heappop(waiting)
                if fresh := payload[at - start :]:
                    pieces.append((t_s, fresh))
                    at += len(fresh)
                at = follows.get(at, at)
        return Stream(pieces, sum(start - end for end, start in follows.items()))


def covered(spans: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """The same stretches in order, those that meet or overlap as one."""
    found: list[tuple[int, int]] = []
    for start, end in sorted(spans):
        if found and start <= found[-1][1]:
            found[-1] = found[-1][0], max(end, found[-1][1])
        else:
            found.append((start, end))
    return found
