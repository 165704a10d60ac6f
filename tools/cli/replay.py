"""Recorded laser bytes through the same app, and the same picture: `python -m tools.cli.replay`.

The recording stands on a level robot that does not move: its attitude sensor and wheels are fakes.
All bytes pass the app's own ports, codecs and sessions, on a simulated clock; the planner's frames
say that the data are replayed (mode 4).
"""

import argparse
import hashlib
import json
import logging
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import structlog
from rich.console import Console
from rich.live import Live
from rich.text import Text

from app import App, Ports
from config_file import load_config, with_changes
from core.config import Config, ConfigError
from core.mapping.mapper import MapperCounts
from fakes.ax3500.device import FakeAx3500
from fakes.lms1xx.recorded import RecordedLms111
from fakes.mti.device import FakeMti
from fakes.planner_mcu.receiver import FakePlanner
from fakes.wires.wire import MemoryPort, Wire
from tools.cli.screen import factor_for, has_screen, map_text, maybe_robot, plain_legend, plain_map

ROOT = Path(__file__).resolve().parents[2]
SHIPPED_RECORDING = ROOT / "tests" / "vectors" / "lms111_session_d2h.bin"
LONGEST_START_S = 60.0  # of the session, before the first scan must have come
REST_S = 0.5  # after the last scan, for the last frames
SESSION = 1
DRAWN_HZ = 20.0


class StandingWheels:
    """Wheels that do not turn."""

    def counts(self) -> tuple[float, float]:
        """Encoder edges of channel 1 and 2."""
        return 0.0, 0.0

    def set_power(self, one: float, two: float) -> None:
        """Nobody drives a recording."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of a replay."""

    counts: MapperCounts
    link_bytes: int
    link_sha256: str
    obstacle: int
    free: int


class Replay:
    """A recorded scanner, a level attitude and standing wheels around one app."""

    def __init__(self, recording: RecordedLms111, config: Config) -> None:
        self.recording, self.config = recording, config
        scanner, ahrs_port, drive_port = MemoryPort(), MemoryPort(), MemoryPort()
        self._link = MemoryPort(datagrams=True)
        level = (np.eye(3), np.zeros(3), np.array([0.0, 0.0, 9.81]))
        ahrs = FakeMti(lambda t_s: level, 1)
        drive = FakeAx3500(StandingWheels(), 2)
        self._wires = [
            Wire(fake, port, 0)
            for fake, port in (
                (recording, scanner),
                (ahrs, ahrs_port),
                (drive, drive_port),
            )
        ]
        ports = Ports(scanner, ahrs_port, drive_port, self._link)
        self.app = App(config, ports, session=SESSION, replayed=True)
        self.planner = FakePlanner()
        self._ticks = 0
        self._rest_s = REST_S
        self._digest, self._bytes = hashlib.sha256(), 0

    @property
    def now_s(self) -> float:
        """The simulated clock."""
        return 1000.0 + self._ticks / self.config.loop.rate_hz

    @property
    def done(self) -> bool:
        """True once all scans have been sent and the frames about them as well."""
        return self._rest_s <= 0 or (
            self.now_s > 1000.0 + LONGEST_START_S and self.app.mapper.counts.scans_added == 0
        )

    def step(self) -> None:
        """One tick."""
        self._ticks += 1
        for wire in self._wires:
            wire.step(self.now_s)
        self.app.step(self.now_s)
        for datagram in self._link.take_datagrams():
            self._digest.update(datagram)
            self._bytes += len(datagram)
            self.planner.feed_datagram(self.now_s, datagram)
        for answer in self.planner.poll(self.now_s):
            self._link.give(answer)
        if self.recording.done:
            self._rest_s -= 1.0 / self.config.loop.rate_hz

    def outcome(self) -> Outcome:
        """Counters, and the digest of all bytes that went to the planner."""
        window = self.planner.window()
        return Outcome(
            self.app.mapper.counts,
            self._bytes,
            self._digest.hexdigest(),
            int((window == 2).sum()),
            int((window == 1).sum()),
        )


def config_for_recording(path: Path, rate_hz: int, step_deg: float) -> Config:
    """Settings for a recording: those of a file, at the recording's own rate and step."""
    config = load_config(path.read_text(encoding="utf-8"))
    scanner = {"scan_rate_hz": rate_hz, "angular_step_deg": step_deg}
    return with_changes(config, scanner=scanner)


def picture(replay: Replay, console: Console) -> Text:
    """The map as the planner has it, in colour."""
    planner = replay.planner
    if planner.blank:
        return Text("waiting for the first map")
    window = planner.window()
    factor = factor_for(window.shape, console.width - 1, console.height - 2)
    return map_text(window, maybe_robot(planner), factor)


def show(replay: Replay, console: Console) -> None:
    """Run to the end: live in a terminal, at once elsewhere."""
    if not has_screen(console):
        while not replay.done:
            replay.step()
        return
    with Live(console=console, screen=True, auto_refresh=False) as live:
        begun_s, drawn_s = time.monotonic(), 0.0
        zero_s = replay.now_s
        while not replay.done:
            replay.step()
            time.sleep(max(0.0, replay.now_s - zero_s - (time.monotonic() - begun_s)))
            if replay.now_s - drawn_s > 1.0 / DRAWN_HZ:
                drawn_s = replay.now_s
                live.update(picture(replay, console), refresh=True)


def main(arguments: list[str]) -> int:
    """Exit status."""
    parser = argparse.ArgumentParser(prog="python -m tools.cli.replay", description=__doc__)
    parser.add_argument(
        "recording",
        nargs="?",
        type=Path,
        default=SHIPPED_RECORDING,
        help="what an LMS1xx sent, CoLa-B; NAME_index.csv beside NAME_d2h.bin gives the times",
    )
    parser.add_argument("--config", type=Path, default=ROOT / "mapod.toml", help="the robot")
    parser.add_argument("--scan-rate-hz", type=int, default=50, help="of the recording")
    parser.add_argument("--step-deg", type=float, default=0.5, help="of the recording")
    parser.add_argument("--store", type=Path, help="write the outcome here, as tests compare it")
    options = parser.parse_args(arguments)
    try:
        config = config_for_recording(options.config, options.scan_rate_hz, options.step_deg)
        recording = RecordedLms111.from_files(options.recording)
    except (ConfigError, OSError) as error:
        print(f"mapod: {error}", file=sys.stderr)
        return 2
    console = Console()
    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(logging.ERROR))
    replay = Replay(recording, config)
    try:
        show(replay, console)
    except KeyboardInterrupt:
        print("mapod: stopped by Ctrl-C")
    planner, outcome = replay.planner, replay.outcome()
    if not planner.blank:
        print(plain_map(planner.window(), maybe_robot(planner)))
        print(plain_legend(config.map.cell_m))
    print(
        f"mapod: {outcome.counts.scans_added} scans mapped, {outcome.counts.scans_dropped} "
        f"dropped, {outcome.counts.points} points; {outcome.obstacle} cells obstacle, "
        f"{outcome.free} free"
    )
    print(f"mapod: {outcome.link_bytes} bytes to the planner, sha256 {outcome.link_sha256}")
    if options.store:
        options.store.write_text(json.dumps(asdict(outcome), indent=1) + "\n", encoding="utf-8")
    return 0 if outcome.counts.scans_added else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
