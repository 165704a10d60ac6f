"""A fake URG-04LX and a host that writes lines and looks at what came back."""

import re
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from fakes.urg04lx.device import FakeUrg04lx

F64 = npt.NDArray[np.float64]
START_S = 500.0
REPLY = re.compile(rb"(?:[^\n]+\n)+\n")


def two_metres(t_first_s: float, times_s: F64, bearings_rad: F64) -> F64:
    return np.full(len(times_s), 2.0)


def replies(stream: bytes, is_cut: bool = False) -> list[bytes]:
    """Whole ones, each with its empty line; fails on anything else, but for a cut end."""
    found = REPLY.findall(stream)
    whole = b"".join(found)
    assert stream.startswith(whole) if is_cut else stream == whole
    return found


def status(reply: bytes) -> str:
    return reply.split(b"\n")[1][:2].decode()


def number(text: bytes) -> int:
    value = 0
    for character in text:
        value = value << 6 | character - 0x30
    return value


def scan_of(reply: bytes) -> tuple[int, list[int]]:
    """Time and values of a reply whose sums are right."""
    _, _, *lines = reply[:-2].split(b"\n")
    for line in lines:
        assert (sum(line[:-1]) & 0x3F) + 0x30 == line[-1], line
    assert all(len(line) == 65 for line in lines[1:-1])
    text = b"".join(line[:-1] for line in lines[1:])
    width = 3 if reply[1:2] == b"D" else 2
    return number(lines[0][:-1]), [number(text[k : k + width]) for k in range(0, len(text), width)]


class Bench:
    """A fake that has been switched to SCIP 2.0, on a line of 500000 baud, and its host."""

    def __init__(
        self,
        truth: Callable[[float, F64, F64], F64] = two_metres,
        *,
        model: str = "URG-04LX",
        fresh: bool = False,
        **attributes: object,
    ) -> None:
        self.fake = FakeUrg04lx(truth, 3, model)
        self.now_s = START_S
        for name, value in attributes.items():
            setattr(self.fake, name, value)
        self.fake.exchange(self.now_s, b"")
        if not fresh and model == "URG-04LX":
            assert self.ask(b"SCIP2.0") == b"SCIP2.0\n0\n\n"
            assert self.ask(b"SS500000") == b"SS500000\n00P\n\n"

    def ask(self, line: bytes, wait_s: float = 0.05) -> bytes:
        """All that comes within wait_s of a line."""
        return self.fake.exchange(self.now_s, line + b"\n") + self.hear(wait_s)

    def hear(self, seconds: float, step_s: float = 0.005) -> bytes:
        sent, until_s = b"", self.now_s + seconds
        while self.now_s < until_s:
            self.now_s = min(self.now_s + step_s, until_s)
            sent += self.fake.exchange(self.now_s, b"")
        return sent

    def one(self, line: bytes, wait_s: float = 0.05) -> bytes:
        """The one reply to a line."""
        [reply] = replies(self.ask(line, wait_s))
        assert reply.startswith(line + b"\n")
        return reply

    def status(self, line: bytes) -> str:
        return status(self.one(line, 0.3))
