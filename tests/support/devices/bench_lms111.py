"""A fake LMS111 and a host that writes frames and looks at what came back; frames of the sheet."""

import re
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from fakes.lms1xx.device import FakeLms111
from hw.lms1xx.telegrams import ScanTelegram, new_parser
from tests.support.devices.lms111_vectors import FRAMES, framed, texted

F64 = npt.NDArray[np.float64]
START_S = 500.0


def payloads(stream: bytes) -> list[bytes]:
    """Of whole telegrams; fails on anything else."""
    found = []
    while stream:
        assert stream[:4] == b"\x02" * 4
        end = 9 + int.from_bytes(stream[4:8], "big")
        found.append(stream[8 : end - 1])
        assert framed(found[-1]) == stream[:end]
        stream = stream[end:]
    return found


def scans_of(stream: bytes) -> list[ScanTelegram]:
    """The scans among telegrams, as mapod's own parser reads them."""
    found = new_parser("auto").feed(0.0, stream)
    return [scan for scan in found if isinstance(scan, ScanTelegram)]


def raw_of(scan: ScanTelegram, content: str = "DIST1") -> list[int]:
    return [int(raw) for raw in scan.channels[content].raw]


def counters(scans: list[ScanTelegram]) -> list[int]:
    return [scan.scan_counter for scan in scans]


def five_metres(t_first_s: float, times_s: F64, bearings_rad: F64) -> F64:
    return np.full(len(times_s), 5.0)


class Bench:
    """A fake and a host that writes frames and looks at what came back."""

    def __init__(
        self,
        truth: Callable[[float, F64, F64], F64] = five_metres,
        *,
        model: str = "LMS111",
        **attributes: object,
    ) -> None:
        self.fake = FakeLms111(truth, seed=3, model=model)
        for name, value in attributes.items():
            setattr(self.fake, name, value)
        self.now_s = START_S
        self.fake.exchange(self.now_s, b"")

    def ask(self, command: bytes, wait_s: float = 0.02) -> bytes:
        """The raw answer of a command, with all else that came within wait_s."""
        sent = self.fake.exchange(self.now_s, command)
        self.now_s += wait_s
        return sent + self.fake.exchange(self.now_s, b"")

    def say(self, text: str, wait_s: float = 0.02) -> str:
        """The text of the answer to a command in CoLa-A, which must be one whole telegram."""
        answer = self.ask(texted(text), wait_s)
        assert re.fullmatch(rb"\x02[^\x02\x03]*\x03", answer), answer
        return answer[1:-1].decode()

    def hear(self, seconds: float) -> bytes:
        sent, until_s = b"", self.now_s + seconds
        while self.now_s < until_s:
            self.now_s += 0.005
            sent += self.fake.exchange(self.now_s, b"")
        return sent

    def listen(self, seconds: float) -> list[bytes]:
        return payloads(self.hear(seconds))

    def scans(self, seconds: float) -> list[ScanTelegram]:
        return scans_of(self.hear(seconds))

    def start(self, *settings: bytes) -> None:
        """The order of a session, up to streaming; nothing is lost on the way."""
        for command in (FRAMES["login"], *settings, FRAMES["start"], FRAMES["run"]):
            assert b"sFA" not in self.ask(command)
        self.now_s += self.fake.spin_up_s - 0.04  # since its start
        self.ask(FRAMES["subscribe"], 0.002)
