"""A recorded LMS1xx session as a device: answers as the recording did, then streams its scans.

Takes the byte streams of both directions and an index (seconds, direction, offset, length, name) as
they lie in tests/vectors. What the recorded host never asked gets "unknown" (sFA 2 or 3).
Source: lms111 sheet, sections 2 and 4.
"""

import csv
from collections import defaultdict
from pathlib import Path

START = b"\x02\x02\x02\x02"
SCANS = b"sEN LMDscandata"
UNKNOWN_METHOD, UNKNOWN_VARIABLE = 2, 3


def _frame(payload: bytes) -> bytes:
    check = 0
    for byte in payload:
        check ^= byte
    return START + len(payload).to_bytes(4, "big") + payload + bytes([check])


def _command(payload: bytes) -> bytes:
    """Type and name of a command, without its arguments: b"sWN LMDscandatacfg"."""
    return b" ".join(payload.split(b" ", 2)[:2])


class RecordedLms111:
    """One device that says what the recorded one said, at the pace at which it said it."""

    def __init__(self, h2d: bytes, d2h: bytes, index: list[tuple[float, str, int, int]]) -> None:
        self._answers: dict[bytes, list[bytes]] = defaultdict(list)
        self._scans: list[tuple[float, bytes]] = []  # seconds since the subscription, telegram
        asked, asked_s, subscribed_s = b"", 0.0, 0.0
        for t_s, direction, offset, length in index:
            stream = h2d if direction == "h2d" else d2h
            telegram = stream[offset : offset + length]
            payload = telegram[8:-1]
            if direction == "h2d":
                asked = _command(payload)
                asked_s = t_s
            elif payload.startswith(b"sSN LMDscandata"):
                self._scans.append((t_s - subscribed_s, telegram))
            elif not payload.startswith(b"sSN"):
                self._answers[asked].append(telegram)
                subscribed_s = asked_s if asked == SCANS else subscribed_s
        self._inbox = b""
        self._begun_s: float | None = None
        self._sent = 0
        self.refused: list[bytes] = []  # commands that the recording does not know

    @classmethod
    def from_files(cls, folder: Path, name: str) -> "RecordedLms111":
        """The session whose files begin with `name` in a folder."""
        with (folder / f"{name}_index.csv").open(encoding="utf-8") as file:
            index = [
                (float(row["t_s"]), row["dir"], int(row["offset"]), int(row["length"]))
                for row in csv.DictReader(file)
            ]
        h2d = (folder / f"{name}_h2d.bin").read_bytes()
        return cls(h2d, (folder / f"{name}_d2h.bin").read_bytes(), index)

    @property
    def done(self) -> bool:
        """True once the last recorded scan has been sent."""
        return self._sent == len(self._scans)

    def exchange(self, now_s: float, received: bytes) -> bytes:
        """Take what the host wrote; give all that the device has sent up to now_s."""
        self._inbox += received
        sent = bytearray()
        while len(self._inbox) >= 8:
            end = 9 + int.from_bytes(self._inbox[4:8], "big")
            if not self._inbox.startswith(START) or end > 4096:
                self._inbox = self._inbox[1:]
                continue
            if len(self._inbox) < end:
                break
            sent += self._answer(now_s, self._inbox[8 : end - 1])
            self._inbox = self._inbox[end:]
        if self._begun_s is not None:
            while not self.done and self._scans[self._sent][0] <= now_s - self._begun_s:
                sent += self._scans[self._sent][1]
                self._sent += 1
        return bytes(sent)

    def _answer(self, now_s: float, payload: bytes) -> bytes:
        command = _command(payload)
        answers = self._answers.get(command)
        if not answers:
            self.refused.append(payload)
            code = UNKNOWN_METHOD if command.startswith(b"sMN") else UNKNOWN_VARIABLE
            return _frame(b"sFA" + code.to_bytes(2, "big"))
        if command == SCANS and self._begun_s is None:
            self._begun_s = now_s
        return answers.pop(0) if len(answers) > 1 else answers[0]
