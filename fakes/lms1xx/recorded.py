"""A recorded LMS1xx stream as a device: answers as the recording did, then streams its scans.

Takes what a real device sent (CoLa-B), cut nowhere, and when it sent each scan. A command that the
recording holds no answer to gets "unknown" (sFA 2 or 3). After the last scan it is silent.
Source: lms111 sheet, sections 2, 4 and 5.
"""

import csv
from collections import defaultdict, deque
from collections.abc import Sequence
from itertools import accumulate
from pathlib import Path

from fakes.lms1xx import cola

MAX_PAYLOAD = 65_536
SCAN, SUBSCRIBE = b"sSN LMDscandata", b"sEN LMDscandata"
REQUEST_OF = {b"sRA": b"sRN", b"sWA": b"sWN", b"sAN": b"sMN", b"sEA": b"sEN"}
FREQUENCY_AT = slice(44, 48)  # of a scan's payload, 1/100 Hz


def head(payload: bytes) -> bytes:
    """Type and name of a telegram, without its values: b"sWN LMDscandatacfg"."""
    return b" ".join(payload.split(b" ", 2)[:2])


class RecordedLms111:
    """One device that says what the recorded one said, at the pace at which it said it.

    Args:
        d2h: the device's bytes.
        scan_times_s: of each scan, from any zero; where they are not as many, by the frequency
            that each scan tells.
    """

    def __init__(self, d2h: bytes, scan_times_s: Sequence[float] = ()) -> None:
        self._answers: dict[bytes, deque[bytes]] = defaultdict(deque)
        self._scans: list[bytes] = []
        for payload in cola.CommandReader(MAX_PAYLOAD).feed(0.0, d2h):
            kind, _, name = head(payload).partition(b" ")
            if head(payload) == SCAN:
                self._scans.append(payload)
            elif kind in REQUEST_OF:
                self._answers[REQUEST_OF[kind] + b" " + name].append(payload)
        is_timed = len(scan_times_s) == len(self._scans)
        self._times_s = scan_times_s if is_timed else self._nominal_times_s()
        self._reader = cola.CommandReader()
        self._zero_s: float | None = None
        self._sent = 0
        self.unknown: list[bytes] = []  # commands that the recording holds no answer to

    @classmethod
    def from_files(cls, d2h_path: Path) -> "RecordedLms111":
        """NAME_d2h.bin, with its times where NAME_index.csv lies beside it."""
        index_path = d2h_path.with_name(d2h_path.name.replace("_d2h.bin", "_index.csv"))
        times_s: list[float] = []
        if index_path != d2h_path and index_path.exists():
            with index_path.open(encoding="utf-8", newline="") as file:
                rows = [row for row in csv.DictReader(file) if row["name"] == SCAN.decode()]
            times_s = [float(row["t_s"]) for row in rows]
        return cls(d2h_path.read_bytes(), times_s)

    def _nominal_times_s(self) -> list[float]:
        periods_s = [
            100.0 / max(1, int.from_bytes(scan[FREQUENCY_AT], "big")) for scan in self._scans
        ]
        return list(accumulate(periods_s))

    @property
    def scans(self) -> int:
        return len(self._scans)

    @property
    def done(self) -> bool:
        return self._sent == len(self._scans)

    def exchange(self, now_s: float, received: bytes) -> bytes:
        sent = bytearray()
        for payload in self._reader.feed(now_s, received):
            sent += cola.frame(self._answer(now_s, payload))
        while self._zero_s is not None and not self.done:
            if self._times_s[self._sent] - self._times_s[0] > now_s - self._zero_s:
                break
            sent += cola.frame(self._scans[self._sent])
            self._sent += 1
        return bytes(sent)

    def _answer(self, now_s: float, payload: bytes) -> bytes:
        answers = self._answers.get(head(payload))
        if not answers:
            self.unknown.append(payload)
            code = cola.UNKNOWN_METHOD if payload.startswith(b"sMN") else cola.UNKNOWN_VARIABLE
            return cola.refusal(code)
        if head(payload) == SUBSCRIBE and self._zero_s is None and self._scans:
            self._zero_s = now_s + 0.07  # the first scan came 72 ms after the subscription
        return answers.popleft() if len(answers) > 1 else answers[0]
