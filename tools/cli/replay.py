"""Play a recording through the app, and show the same picture.

A recording is a file of `mapod record`, or what a LMS1xx alone has sent (CoLa-B; the times are in
NAME_index.csv beside NAME_d2h.bin): then the robot is level and does not move, and --scan-rate-hz
and --step-deg say how the scanner was set. Nothing is sent anywhere.
"""

import argparse
import json
import time
from dataclasses import asdict
from pathlib import Path

from rich.console import Console
from rich.live import Live
from rich.text import Text

from config_file import load_config, with_changes
from core.config import Config, ConfigError
from recording.mcap_stream import MAGIC
from recording.reader import OLDER, Recording
from recording.records import RecordingError
from tools.cli.options import ROOT, SHIPPED_CONFIG, fail, lacks_simulation, parser_of
from tools.played import RecordingReplay, Replay, why_nothing_was_mapped
from tools.terminal.screen import (
    factor_for,
    has_screen,
    map_text,
    maybe_robot,
    plain_legend,
    plain_map,
)

SHIPPED_RECORDING = ROOT / "tests" / "vectors" / "lms111_session_d2h.bin"
DRAWN_HZ = 20.0


class NoReplayError(Exception):
    """There is nothing to play; the text says why."""


def config_for_recording(path: Path, rate_hz: int, step_deg: float) -> Config:
    config = load_config(path.read_text(encoding="utf-8"))
    scanner = {"scan_rate_hz": rate_hz, "angular_step_deg": step_deg}
    return with_changes(config, scanner=scanner)


def replay_of(options: argparse.Namespace) -> Replay:
    """Raises NoReplayError, RecordingError, ConfigError, OSError: it can't be played."""
    path: Path | None = options.recording
    if path is None:
        raise NoReplayError("name a recording: there is none here to show")
    if path.is_dir():
        is_whole = True
    else:
        with path.open("rb") as file:
            first = file.read(64)
        is_whole = first.startswith(MAGIC) or OLDER.match(first) is not None
    if is_whole:
        config = load_config(options.config.read_text("utf-8")) if options.config else None
        return RecordingReplay(Recording(path), config)
    if why := lacks_simulation():
        raise NoReplayError(f"{path} is no file of `mapod record`; a scanner's bytes alone: {why}")
    from tools.laser_replay import LaserReplay

    given = options.config or SHIPPED_CONFIG
    config = config_for_recording(given, options.scan_rate_hz, options.step_deg)
    return LaserReplay(path, config)


def picture(replay: Replay, console: Console) -> Text:
    planner = replay.view.planner
    if planner.blank:
        return Text("waiting for the first map")
    window = planner.window()
    factor = factor_for(window.shape, console.width - 1, console.height - 2)
    return map_text(window, maybe_robot(planner), factor)


def show(replay: Replay, console: Console) -> None:
    if not has_screen(console):
        while not replay.done:
            replay.step()
        return
    with Live(console=console, screen=True, auto_refresh=False) as live:
        begun_s, drawn_s = time.monotonic(), 0.0
        replay.step()
        zero_s = replay.now_s
        while not replay.done:
            replay.step()
            time.sleep(max(0.0, replay.now_s - zero_s - (time.monotonic() - begun_s)))
            if replay.now_s - drawn_s > 1.0 / DRAWN_HZ:
                drawn_s = replay.now_s
                live.update(picture(replay, console), refresh=True)


def tell(replay: Replay, out: Path | None) -> int:
    planner, outcome = replay.view.planner, replay.view.outcome(replay.app)
    if not planner.blank:
        print(plain_map(planner.window(), maybe_robot(planner)))
        print(plain_legend(replay.config.map.cell_m))
    print(
        f"mapod: {outcome.counts.scans_added} scans mapped, {outcome.counts.scans_dropped} "
        f"dropped, {outcome.counts.points} points; {outcome.obstacle} cells obstacle, "
        f"{outcome.free} free"
    )
    print(f"mapod: {outcome.link_bytes} bytes to the planner, sha256 {outcome.link_sha256}")
    if out:
        out.write_text(json.dumps(asdict(outcome), indent=1) + "\n", encoding="utf-8")
    if outcome.counts.scans_added:
        return 0
    return fail("replay", f"no scan was mapped: {why_nothing_was_mapped(replay)}", 1)


def main(arguments: list[str] | None = None) -> int:
    """Exit status: 0 something was mapped, 1 nothing was, 2 wrong use."""
    parser = parser_of("replay", __doc__, "mapod replay mapod.mcap", "mapod replay lms111_d2h.bin")
    shipped = SHIPPED_RECORDING if SHIPPED_RECORDING.exists() else None
    add = parser.add_argument
    add("recording", nargs="?", type=Path, default=shipped, help="the file")
    add("--config", type=Path, help="the robot's settings (default: recorded ones, or as shipped)")
    add("--scan-rate-hz", type=int, default=50, help="of a scanner's bytes (50)")
    add("--step-deg", type=float, default=0.5, help="of a scanner's bytes (0.5)")
    parser.add_out("a file for the outcome, as tests compare it")
    options = parser.parse_args(arguments)
    try:
        replay = replay_of(options)
        try:
            show(replay, Console())
        except KeyboardInterrupt:
            print("mapod: stopped by Ctrl-C")
        return tell(replay, options.out)
    except (NoReplayError, RecordingError, ConfigError, UnicodeDecodeError, OSError) as error:
        return fail("replay", error)
