"""Play a recording through the app, and hold what it tells the planner against what it told then.

A recording is a file of `mapod record` or a folder of them. A capture of a scanner's network
traffic (pcap, pcapng) and what a LMS1xx alone has sent (NAME_d2h.bin, its times in NAME_index.csv)
are played as well: then the robot is level and does not move. Nothing is sent anywhere.
"""

import argparse
import importlib.util
import json
import math
import signal
from dataclasses import asdict
from pathlib import Path

from rich.console import Console

from config_file import read_key, with_changes
from core.config import Config, ConfigError
from recording.mcap_stream import MAGIC
from recording.reader import OLDER
from recording.records import RecordingError
from tools.cli.options import (
    ROOT,
    SHIPPED_CONFIG,
    Parser,
    cannot_be_written,
    configured,
    fail,
    lacks_simulation,
    number_in,
    parser_of,
    settings_text,
    value_of,
    whole_in,
)
from tools.replay.capture import MARKS, CaptureError
from tools.replay.changes import changed
from tools.replay.instants import FORMS, InstantError
from tools.replay.moment import moment_of
from tools.replay.outcome import why_nothing_was_mapped
from tools.replay.playing import Playing
from tools.replay.showing import BAR_S, picture, robot_of, shown
from tools.replay.sources import OfCapture, OfRecording, OfScanner, Source
from tools.terminal.screen import plain_legend, plain_map
from version import version as app_version

SHIPPED_RECORDING = ROOT / "tests" / "vectors" / "lms111_session_d2h.bin"
WHAT_IS_NEEDED = "needs {}: pip install 'mapod[video]'"


class NoReplayError(Exception):
    """There is nothing to play; the text says why."""


def a_speed(text: str) -> float:
    if text == "max":
        return math.inf
    allowed = "max, or from 0.01 to 1000"
    return value_of(text, float, lambda value: 0.01 <= value <= 1000, allowed)


def config_for_recording(config: Config, rate_hz: int, step_deg: float) -> Config:
    scanner = {"scan_rate_hz": rate_hz, "angular_step_deg": step_deg}
    return with_changes(config, scanner=scanner)


def source_of(options: argparse.Namespace) -> Source:
    """Raises NoReplayError, RecordingError, CaptureError, ConfigError, OSError."""
    path: Path | None = options.recording
    if path is None:
        raise NoReplayError("name a recording: there is none here to show")
    first = b"" if path.is_dir() else _first_bytes(path)
    if path.is_dir() or first.startswith(MAGIC) or OLDER.match(first):
        if options.stream is not None:
            raise NoReplayError(f"--stream is of a capture; {path} is a recording of mapod")
        given = settings_text(options.config) if options.config else None
        key = read_key(options.key_file)
        return OfRecording(path, given, options.set, key, app_version())
    settings = configured(options.config or SHIPPED_CONFIG)
    if first[:4] in MARKS:
        config = changed(settings, options.set)
        return OfCapture(path, config, options.stream)
    if why := lacks_simulation():
        raise NoReplayError(
            f"{path} is neither a recording of mapod nor a capture; a scanner's bytes alone: {why}"
        )
    config = config_for_recording(settings, options.scan_rate_hz, options.step_deg)
    source = OfScanner(path, changed(config, options.set))
    if why := source.replay.lacks:
        raise NoReplayError(f"{path} is neither a recording of mapod nor a capture: {why}")
    return source


def _first_bytes(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(64)


def play(source: Source, playing: Playing, options: argparse.Namespace, console: Console) -> None:
    """Up to --to, or to its end. Raises InstantError, RecordingError, OSError."""
    line, asked = source.timeline, {"--from": options.begin, "--to": options.end}
    asked |= {"--at": options.at}
    at = {option: line.instant(option, text) for option, text in asked.items() if text is not None}
    begin_s, end_s = at.get("--from", line.begin_s), at.get("--to", math.inf)
    if begin_s > end_s:
        raise InstantError(f"--from {options.begin} is behind --to {options.end}")
    picture_s = at.get("--at", end_s)
    if picture_s > end_s:
        raise InstantError(f"--at {options.at} is behind --to {options.end}")
    with shown(source, options.speed, options.video, console) as show:
        for until_s in sorted({begin_s, min(picture_s, end_s), end_s}):
            if until_s <= begin_s:
                playing.play_to(until_s, math.inf, show.tell, BAR_S)
            else:
                playing.play_to(until_s, show.pace, show.look, show.every_s)
            if options.picture and until_s == picture_s:
                picture(source, playing).save(options.picture)


def tell(source: Source, playing: Playing, out: Path | None) -> int:
    """What came of it; the exit status."""
    replay = source.replay
    outcome = playing.tally.outcome(replay.app, replay.now_s)
    moment = moment_of(replay.app, replay.now_s)
    if outcome.counts.scans_added:
        print(plain_map(moment.states, robot_of(moment)))
        print(plain_legend(moment.cell_m))
    print(
        f"mapod: {outcome.counts.scans_added} scans mapped, {outcome.counts.scans_dropped} "
        f"dropped, {outcome.counts.points} points; {outcome.obstacle} cells obstacle, "
        f"{outcome.free} free"
    )
    print(f"mapod: {outcome.link_bytes} bytes to the planner, sha256 {outcome.link_sha256}")
    played_s = replay.now_s - replay.begin_s
    pace = f", {played_s / playing.took_s:.0f} times real time" if playing.took_s > 0 else ""
    print(f"mapod: {played_s:.1f} s played in {playing.took_s:.1f} s of one core{pace}")
    for line in source.verdict():
        print(f"mapod: {line}")
    if out:
        out.write_text(json.dumps(asdict(outcome), indent=1) + "\n", encoding="utf-8")
    if not outcome.counts.scans_added:
        return fail("replay", f"no scan was mapped: {why_nothing_was_mapped(replay)}", 1)
    return 0 if source.is_as_recorded else 1


def lacks_libraries(options: argparse.Namespace) -> str:
    """Why no picture or film can be made here, as a message; "" where none is wanted."""
    for wanted, module, name in (
        (options.picture or options.video, "PIL", "Pillow"),
        (options.video, "av", "PyAV"),
    ):
        if wanted and importlib.util.find_spec(module) is None:
            option = "--video" if options.video else "--picture"
            return f"{option} {WHAT_IS_NEEDED.format(name)}"
    return ""


def parser() -> Parser:
    own = parser_of(
        "replay",
        __doc__,
        "mapod replay drive.mcap",
        "mapod replay drive.mcap --from 12:03:05 --speed 1",
        "mapod replay drive.mcap --set obstacle.h_pos_m=0.2 --picture higher.png",
        "mapod replay scanner.pcapng --stream 0",
    )
    shipped = SHIPPED_RECORDING if SHIPPED_RECORDING.exists() else None
    add = own.add_argument
    add("recording", nargs="?", type=Path, default=shipped, help="the file or folder")
    add("--config", type=Path, help="other settings (default: the recorded ones, or as shipped)")
    about = "one setting changed, say map.cell_m=0.1; repeatable: what if?"
    add("--set", action="append", default=[], metavar="KEY=VALUE", help=about)
    own.add_key()
    add("--speed", type=a_speed, default=math.inf, help="1 as it was, 4, ..., or max (max)")
    add("--from", dest="begin", metavar="TIME", help=f"as fast as it goes up to there; {FORMS}")
    add("--to", dest="end", metavar="TIME", help="no further")
    add("--picture", type=Path, metavar="FILE.png", help="the map as a picture, at the end")
    add("--at", metavar="TIME", help="the moment of --picture")
    add("--video", type=Path, metavar="FILE.mp4", help="a film of the drive, at --speed")
    add(
        "--stream",
        type=whole_in(0, 1_000_000),
        help="of a capture with several: number as in tcp.stream",
    )
    add("--scan-rate-hz", type=whole_in(1, 1000), default=50, help="of a scanner's bytes (50)")
    add("--step-deg", type=number_in(0.01, 10), default=0.5, help="of a scanner's bytes (0.5)")
    own.add_out("a file for the outcome, as tests compare it")
    return own


def main(arguments: list[str] | None = None) -> int:
    """Exit status: 0 mapped, and as recorded where judged; 1 not; 2 wrong use; 130 Ctrl-C."""
    options = parser().parse_args(arguments)
    if options.at is not None and not options.picture:
        return fail("replay", "--at says when --picture is taken: name one")
    written = (
        ("--picture", options.picture, ".png"),
        ("--video", options.video, ".mp4"),
        ("--out", options.out, ""),
    )
    if why := cannot_be_written(*written) or lacks_libraries(options):
        return fail("replay", why)
    try:
        source = source_of(options)
        playing = Playing(source.replay)
        is_stopped = False
        try:
            for line in source.about():
                print(f"mapod: {line}")
            play(source, playing, options, Console())
        except KeyboardInterrupt:
            is_stopped = True
        status = tell(source, playing, options.out)
        if is_stopped:
            played_s = source.replay.now_s - source.replay.begin_s
            told = f"stopped by Ctrl-C after {played_s:.1f} s: the rest was not played"
            return fail("replay", told, 128 + signal.SIGINT)
        return status
    except (NoReplayError, RecordingError, CaptureError, InstantError, ConfigError) as error:
        return fail("replay", error)
    except OSError as error:
        return fail("replay", error)
