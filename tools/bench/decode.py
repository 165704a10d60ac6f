"""What decoding costs: each codec on a clean stream, and on one with 1 % of its bytes altered.

The streams are recordings where there are any (tests/vectors), else bytes of the fakes.
"""

import random
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fakes.mti.device import FakeMti
from hw.ax3500.lines import Line, LineParser, maybe_counter
from hw.device import BadFrame, Parser
from hw.lms1xx.options import Lms1xxOptions
from hw.lms1xx.scan import ScanMaker
from hw.lms1xx.telegrams import ScanTelegram, new_parser
from hw.mti.frames import MtFrame, MtParser, encode_frame
from hw.mti.mtdata import MtDataDecoder, decode_mtdata2

VECTORS = Path(__file__).resolve().parents[2] / "tests" / "vectors"
PIECE = 1448  # bytes that arrive at once on TCP; a serial line gives fewer
LINE_PIECE = 64
ALTERED = 0.01
ROUNDS = 7  # the best counts: everything else on the machine only adds
BYTES = 200_000  # of a stream, at least


@dataclass(frozen=True, slots=True)
class Cost:
    """Of one stream."""

    name: str
    unit: str  # what one frame is
    frames: int  # of the clean stream
    clean_s: float
    altered_s: float

    @property
    def ratio(self) -> float:
        """Of the altered stream to the clean one."""
        return self.altered_s / self.clean_s

    def in_words(self) -> str:
        """One line."""
        each_us = 1e6 * self.clean_s / self.frames
        return (
            f"{self.name:<40} {each_us:7.1f} us a {self.unit}; "
            f"with 1 % of bytes altered {self.ratio:.2f} times the whole"
        )


def altered(stream: bytes, rate: float, seed: int) -> bytes:
    """The stream with that share of its bytes changed."""
    chance = random.Random(seed)
    out = bytearray(stream)
    for at in chance.sample(range(len(out)), round(rate * len(out))):
        out[at] ^= chance.randrange(1, 256)
    return bytes(out)


def decoded(new_parser: Callable[[], Parser], stream: bytes, piece: int) -> tuple[int, float]:
    """Frames of a stream, and the seconds of computing that they took."""
    parser = new_parser()
    pieces = [stream[at : at + piece] for at in range(0, len(stream), piece)]
    frames, begun_s = 0, time.process_time()
    for number, data in enumerate(pieces):
        events = parser.feed(0.001 * number, data)
        frames += sum(not isinstance(event, BadFrame) for event in events)
    return frames, time.process_time() - begun_s


def cost(name: str, unit: str, new_parser: Callable[[], Parser], stream: bytes, piece: int) -> Cost:
    """Both streams by turns, the best of several rounds."""
    stream *= -(-BYTES // len(stream))
    damaged = altered(stream, ALTERED, seed=1)
    clean = [decoded(new_parser, stream, piece) for _ in range(ROUNDS)]
    noisy = [decoded(new_parser, damaged, piece) for _ in range(ROUNDS)]
    return Cost(
        name,
        unit,
        clean[0][0],
        min(seconds for _, seconds in clean),
        min(seconds for _, seconds in noisy),
    )


class _Scans:
    """Scan telegrams to ranges in metres: frame codec and conversion in one."""

    def __init__(self) -> None:
        self._telegrams = new_parser("auto")
        self._maker = ScanMaker(Lms1xxOptions("auto", 50, 0.5, -45.0, 225.0, "first", []))

    def feed(self, now_s: float, data: bytes) -> list[object]:
        """Scans, answers and bad frames."""
        return [
            self._maker.scan(event) if isinstance(event, ScanTelegram) else event
            for event in self._telegrams.feed(now_s, data)
        ]


class _Samples:
    """Data messages to samples: frame codec and data codec in one."""

    def __init__(self) -> None:
        self._frames = MtParser(115_200)
        self._legacy = MtDataDecoder(0x0006, 0x0000_0005)

    def feed(self, now_s: float, data: bytes) -> list[object]:
        """Samples and bad frames."""
        return [self._decoded(event) for event in self._frames.feed(now_s, data)]

    def _decoded(self, event: object) -> object:
        if not isinstance(event, MtFrame):
            return event
        return self._legacy.decode(event.data) if event.mid == 0x32 else decode_mtdata2(event.data)


class _Counters:
    """Reply lines to counters."""

    def __init__(self) -> None:
        self._lines = LineParser()

    def feed(self, now_s: float, data: bytes) -> list[object]:
        """Counters (None for an echo) and bad frames."""
        return [
            maybe_counter(event.text) if isinstance(event, Line) else event
            for event in self._lines.feed(now_s, data)
        ]


def legacy_stream() -> bytes:
    """A second of MTData: Euler angles, calibrated data, counter."""
    level = np.eye(3), np.zeros(3), np.array([0.0, 0.0, 9.81])
    sensor = FakeMti(lambda t_s: level, 1)
    sensor.exchange(0.0, b"")
    for now_s, request in enumerate(
        (
            encode_frame(0x30),
            encode_frame(0xD0, b"\x00\x06"),
            encode_frame(0xD2, b"\x00\x00\x00\x05"),
            encode_frame(0x10),
        ),
        start=1,
    ):
        sensor.exchange(0.1 * now_s, request)
    sensor.exchange(0.5, b"")
    return b"".join(sensor.exchange(0.5 + 0.01 * k, b"") for k in range(1, 101))


def counter_stream() -> bytes:
    """Replies of both counters, each after its echo."""
    return b"".join(
        b"?Q%d\r%X\r" % (channel, 0x56CB872 + 37 * step)
        for step in range(1000)
        for channel in (0, 1)
    )


def costs() -> list[Cost]:
    """Of every codec."""
    session = (VECTORS / "lms111_session_d2h.bin").read_bytes()
    scans = session[session.index(b"sSN LMDscandata") - 8 :]
    text = (VECTORS / "tim781_1s_d2h.bin").read_bytes()
    recorded = (VECTORS / "mti_rec1.bin").read_bytes()
    return [
        cost("LMS111, CoLa-B, 541 points, recorded", "telegram", _Scans, scans, PIECE),
        cost("TiM781, CoLa-B, 811 points, recorded", "telegram", _Scans, text, PIECE),
        cost("MTi, MTData, 50 bytes", "packet", _Samples, legacy_stream(), LINE_PIECE),
        cost("MTi, MTData2, recorded", "packet", _Samples, recorded, LINE_PIECE),
        cost("AX3500, echo and counter", "line", _Counters, counter_stream(), LINE_PIECE),
    ]
