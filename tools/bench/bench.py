"""What computing costs: `python -m tools.bench.bench`. Figures to compare with another run here.

- From the last byte of a scan handed to `App.step` to the last byte of its frame at the port:
  computing alone, and with the wait for the attitude of the scan's last beam.
- Share of one core used, at 50 Hz x 541 beams with a 401 x 401 window.
- Decoding, for each device's telegrams and packets, also from damaged streams.
- An attitude sample from its bytes to the pose, part by part.
"""

import random
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from app import App, Ports
from config_file import load_config, with_changes
from core.config import Config
from fakes.mti.device import FakeMti
from fakes.urg04lx.device import FakeUrg04lx
from fakes.wires.wire import MemoryPort, Wire
from fakes.world.rig import Rig
from hw.ax3500.lines import Line, LineParser, maybe_counter
from hw.device import BadFrame
from hw.lms1xx.options import Lms1xxOptions
from hw.lms1xx.scan import ScanMaker
from hw.lms1xx.telegrams import ScanTelegram, new_parser
from hw.mti.frames import MtFrame, MtParser, encode_frame
from hw.mti.mtdata import MtDataDecoder, decode_mtdata2
from hw.urg04lx import scan as scip_scan
from hw.urg04lx.options import Urg04lxOptions
from hw.urg04lx.scip import Reply, ScipParser
from hw.urg04lx.sensor import Sensor
from tools.bench.drive import FAST, SHIPPED
from tools.bench.samples import sample_costs

VECTORS = Path(__file__).resolve().parents[2] / "tests" / "vectors"
PIECE = 1448  # bytes that arrive at once on TCP; a serial line gives fewer
LINE_PIECE = 64
ALTERED = 0.01
ROUNDS = 7  # the best counts: everything else on the machine only adds
BYTES = 200_000  # of a stream, at least
URG = Sensor("URG-04LX-UG01", 20, 5600, 1024, 44, 725, 384, 600.0)
Feed = Callable[[float, bytes], list[object]]
SETTLE_S, MEASURED_S = 6.0, 10.0


@dataclass(frozen=True, slots=True)
class Cost:
    """Of one stream."""

    name: str
    unit: str  # what one frame is
    frames: int  # of the clean stream
    clean_s: float
    altered_s: float

    def in_words(self) -> str:
        each_us = 1e6 * self.clean_s / self.frames
        return (
            f"{self.name:<40} {each_us:7.1f} us a {self.unit}; "
            f"with 1 % of bytes altered {self.altered_s / self.clean_s:.2f} times the whole"
        )


def altered(stream: bytes, rate: float, seed: int) -> bytes:
    chance = random.Random(seed)
    out = bytearray(stream)
    for at in chance.sample(range(len(out)), round(rate * len(out))):
        out[at] ^= chance.randrange(1, 256)
    return bytes(out)


def decoded(new_feed: Callable[[], Feed], stream: bytes, piece: int) -> tuple[int, float]:
    """Frames of a stream, and the seconds of computing that they took."""
    feed = new_feed()
    pieces = [stream[at : at + piece] for at in range(0, len(stream), piece)]
    frames, begun_s = 0, time.process_time()
    for number, data in enumerate(pieces):
        events = feed(0.001 * number, data)
        frames += sum(not isinstance(event, BadFrame) for event in events)
    return frames, time.process_time() - begun_s


def cost(name: str, unit: str, new_feed: Callable[[], Feed], stream: bytes, piece: int) -> Cost:
    stream *= -(-BYTES // len(stream))
    damaged = altered(stream, ALTERED, seed=1)
    clean = [decoded(new_feed, stream, piece) for _ in range(ROUNDS)]
    noisy = [decoded(new_feed, damaged, piece) for _ in range(ROUNDS)]
    return Cost(
        name,
        unit,
        clean[0][0],
        min(seconds for _, seconds in clean),
        min(seconds for _, seconds in noisy),
    )


def scans() -> Feed:
    """Scan telegrams to ranges in metres: frame codec and conversion in one."""
    telegrams = new_parser("auto")
    maker = ScanMaker(Lms1xxOptions("auto", 50, 0.5, -45.0, 225.0, "first", []))
    return lambda now_s, data: [
        maker.scan(event) if isinstance(event, ScanTelegram) else event
        for event in telegrams.feed(now_s, data)
    ]


def scip_scans() -> Feed:
    """SCIP replies to ranges in metres, of all steps."""
    replies = ScipParser()
    options = Urg04lxOptions("URG-04LX-UG01", -120.0, 120.0, 1, 0, 3, True, [0.0] * 4, [0.02, 5.6])
    maker, window = scip_scan.ScanMaker(options), scip_scan.Window.of(URG, options)
    return lambda now_s, data: [
        maker.scan(event, window) if isinstance(event, Reply) else event
        for event in replies.feed(now_s, data)
    ]


def samples() -> Feed:
    """Data messages to samples: frame codec and data codec in one."""
    frames, legacy = MtParser(115_200), MtDataDecoder(0x0006, 0x0000_0005)

    def decode(event: object) -> object:
        if not isinstance(event, MtFrame):
            return event
        return legacy.decode(event.data) if event.mid == 0x32 else decode_mtdata2(event.data)

    return lambda now_s, data: [decode(event) for event in frames.feed(now_s, data)]


def counters() -> Feed:
    """Reply lines to counters; None for an echo."""
    lines = LineParser()
    return lambda now_s, data: [
        maybe_counter(event.text) if isinstance(event, Line) else event
        for event in lines.feed(now_s, data)
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


def scip_stream() -> bytes:
    """Two seconds of full scans."""
    fake = FakeUrg04lx(lambda t_s, times_s, bearings_rad: 2.0 + 0.3 * bearings_rad, 1, URG.model)
    fake.exchange(0.0, b"")
    fake.exchange(0.1, b"MD0044072501000\n")
    stream = b"".join(fake.exchange(0.1 + 0.1 * k, b"") for k in range(1, 22))
    return stream[stream.index(b"\n\n") + 2 :]


def counter_stream() -> bytes:
    return b"".join(
        b"?Q%d\r%X\r" % (channel, 0x56CB872 + 37 * step)
        for step in range(1000)
        for channel in (0, 1)
    )


def costs() -> list[Cost]:
    session = (VECTORS / "lms111_session_d2h.bin").read_bytes()
    telegrams = session[session.index(b"sSN LMDscandata") - 8 :]
    text = (VECTORS / "tim781_1s_d2h.bin").read_bytes()
    recorded = (VECTORS / "mti_rec1.bin").read_bytes()
    return [
        cost("LMS111, CoLa-B, 541 points, recorded", "telegram", scans, telegrams, PIECE),
        cost("TiM781, CoLa-B, 811 points, recorded", "telegram", scans, text, PIECE),
        cost("URG-04LX, SCIP 2.0, 682 points", "reply", scip_scans, scip_stream(), LINE_PIECE),
        cost("MTi, MTData, 50 bytes", "packet", samples, legacy_stream(), LINE_PIECE),
        cost("MTi, MTData2, recorded", "packet", samples, recorded, LINE_PIECE),
        cost("AX3500, echo and counter", "line", counters, counter_stream(), LINE_PIECE),
    ]


class TimedPort(MemoryPort):
    """Notes when bytes are read from it and the last ones written to it, in CPU time."""

    def __init__(self, datagrams: bool = False) -> None:
        super().__init__(datagrams)
        self.read_s: float | None = None
        self.written_s = 0.0

    def read(self) -> list[bytes]:
        pieces = super().read()
        if pieces:
            self.read_s = time.thread_time()
        return pieces

    def write(self, data: bytes) -> None:
        super().write(data)
        self.written_s = time.thread_time()


@dataclass(slots=True)
class Costs:
    """Seconds: of CPU time per scan, of simulated waiting per scan, of CPU time per tick."""

    scans_s: list[float] = field(default_factory=list)
    waits_s: list[float] = field(default_factory=list)
    ticks_s: list[float] = field(default_factory=list)


def drive(config: Config) -> Costs:
    rig = Rig("corridor", 1)
    scanner, ahrs, drive = TimedPort(), MemoryPort(), MemoryPort()
    planner = TimedPort(datagrams=True)
    wires = [Wire(rig.scanner, scanner, 1), Wire(rig.ahrs, ahrs, 2), Wire(rig.drive, drive, 3)]
    app = App(config, Ports(scanner, ahrs, drive, planner), session=1)
    rate_hz = config.loop.rate_hz
    costs = Costs()
    spent_s = 0.0  # since the bytes of the newest scan were read
    read_tick = 0
    for tick in range(round((SETTLE_S + MEASURED_S) * rate_hz)):
        now_s = 1000.0 + tick / rate_hz
        rig.step(now_s)
        for wire in wires:
            wire.step(now_s)
        added = app.mapper.counts.scans_added
        scanner.read_s = None
        begun_s = time.thread_time()
        app.step(now_s)
        ended_s = time.thread_time()
        planner.take_datagrams()
        if scanner.read_s is not None:
            spent_s, read_tick = begun_s - scanner.read_s, tick
        measured = tick >= SETTLE_S * rate_hz
        if app.mapper.counts.scans_added > added and measured:
            costs.scans_s.append(spent_s + max(planner.written_s, begun_s) - begun_s)
            costs.waits_s.append((tick - read_tick) / rate_hz)
        spent_s += ended_s - begun_s
        if measured:
            costs.ticks_s.append(ended_s - begun_s)
    return costs


def report(name: str, config: Config) -> float:
    """Measure and print one configuration; the median tick with a scan in it."""
    costs = drive(config)
    computing_ms = [1000 * float(np.quantile(costs.scans_s, part)) for part in (0.5, 0.99)]
    whole_s = np.add(costs.scans_s, costs.waits_s)
    whole_ms = [1000 * float(np.quantile(whole_s, part)) for part in (0.5, 0.99)]
    print(
        f"{name:<40} computing {computing_ms[0]:.2f} ms median, {computing_ms[1]:.2f} p99; "
        f"with the wait for the attitude {whole_ms[0]:.1f}, {whole_ms[1]:.1f}; "
        f"{100 * sum(costs.ticks_s) / MEASURED_S:.1f} % of one core ({len(costs.scans_s)} scans)"
    )
    return computing_ms[0]


def main() -> int:
    print("mapod: measuring, about a minute")
    shipped = load_config(SHIPPED.read_text(encoding="utf-8"))
    report("as shipped: 25 Hz, 481 beams, 101 x 101", shipped)
    small = report("50 Hz, 541 beams, 101 x 101", with_changes(shipped, scanner=FAST))
    same = report(
        "the same, elevation map 401 x 401", with_changes(shipped, scanner=FAST, map={"cells": 401})
    )
    large = report(
        "50 Hz, 541 beams, 401 x 401",
        with_changes(
            shipped,
            scanner=FAST,
            map={"cells": 401, "cell_m": 0.05},
            obstacle={"window_cells": 401},
        ),
    )
    print(f"401 x 401 elevation cells against 101 x 101: {same / small:.2f} times")
    print(f"with 401 x 401 cells for the planner as well: {large / small:.2f} times")
    for cost in costs():
        print(cost.in_words())
    print("\n".join(sample_costs()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
