"""Why the robot stood, or why a cell was what it was, at one moment of a recording.

The recording is played up to then. Told are: pose, mode, what each input was worth, what the robot
was asked and why it did not move, the cells that were in its way and the rule behind each, restarts
and refusals so far, and the log's last seconds. With a cell: its rule, the beams that met and
passed it last, and when it changed.
"""

import argparse
import json
import math
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from config_file import read_key
from core.config import ConfigError
from recording.reader import Recording
from recording.records import RecordingError
from tools.cli.export import remarks_on
from tools.cli.options import fail, parser_of, value_of
from tools.replay.instants import FORMS, InstantError
from tools.replay.player import Player
from tools.replay.showing import steps_shown
from tools.replay.sources import drive_in
from tools.replay.span import timeline_of
from tools.why.beams import Cell
from tools.why.moment import Watch, cell_facts, moment_of
from tools.why.picture import LEGEND, picture_of
from tools.why.text import lines_of

LOG_S = 10.0  # of the log before the moment
QUIET = ("ticks_counted", "device_measured")  # events of every second
MOST_CELL = 10**7


class NoMomentError(Exception):
    """There is no such moment, or no such cell; the text says why."""


def a_pair(text: str) -> tuple[float, float]:
    def pair(text: str) -> tuple[float, float]:
        first, _, second = text.partition(",")
        return float(first), float(second)

    return value_of(text, pair, lambda xy: all(map(math.isfinite, xy)), "two numbers, X,Y")


def a_cell(text: str) -> Cell:
    def cell(text: str) -> Cell:
        first, _, second = text.partition(",")
        return int(first), int(second)

    allowed = f"two whole numbers, I,J, within {MOST_CELL} either way"
    return value_of(text, cell, lambda ij: max(map(abs, ij)) <= MOST_CELL, allowed)


def with_places_joined(words: list[str]) -> list[str]:
    """`--xy -1,2` as `--xy=-1,2`: argparse takes what begins with a minus for an option."""
    joined: list[str] = []
    for word in words:
        if joined and joined[-1] in ("--cell", "--xy") and word.startswith("-") and "," in word:
            joined[-1] += f"={word}"
        else:
            joined.append(word)
    return joined


def clock(t_s: float, utc_offset_s: float) -> str:
    return datetime.fromtimestamp(t_s + utc_offset_s, UTC).strftime("%H:%M:%S.%f")[:-3]


def cell_of(options: argparse.Namespace, cell_m: float) -> Cell | None:
    if options.xy is not None:
        x_m, y_m = options.xy
        if max(abs(x_m), abs(y_m)) > MOST_CELL * cell_m:
            raise NoMomentError(f"--xy {x_m:g},{y_m:g} lies beyond any map")
        return math.floor(x_m / cell_m), math.floor(y_m / cell_m)
    cell: Cell | None = options.cell
    return cell


def log_before(recording: Recording, t_s: float) -> list[dict[str, Any]]:
    """The log's lines of the last seconds before a moment."""
    return [
        {"t_s": line.t_s, "level": line.level, "event": line.event, "keys": line.keys}
        for line in recording.logs()
        if t_s - LOG_S <= line.t_s <= t_s and line.event not in QUIET
    ]


def story_of(recording: Recording, watch: Watch) -> dict[str, Any]:
    """What is to be told of the moment up to which it was played. Raises NoMomentError."""
    player, offset_s = watch.player, recording.utc_offset_s
    told_cell = None
    if watch.cell is not None:
        i, j = watch.cell.cell
        grid = watch.app.mapper.maps.window.grid
        if not (0 <= i - grid.corner_i < grid.size and 0 <= j - grid.corner_j < grid.size):
            reach = f"{grid.corner_i},{grid.corner_j} to "
            reach += f"{grid.corner_i + grid.size - 1},{grid.corner_j + grid.size - 1}"
            raise NoMomentError(f"cell {i},{j} is outside of the map, which is {reach} then")
        told_cell = (cell_facts(watch.app, watch.cell.cell) or {}) | watch.cell.facts()
    return {
        "t_s": player.now_s,
        "begin_s": player.begin_s,
        "utc": clock(player.now_s, offset_s),
        "moment": moment_of(watch),
        "log": log_before(recording, player.now_s),
        "cell": told_cell,
        "remarks": remarks_on(player, recording),
    }


def why(options: argparse.Namespace) -> int:
    """Raises OSError, RecordingError, ConfigError, InstantError, NoMomentError."""
    recording = drive_in(options.recording)
    key = read_key(options.key_file)
    player = Player(recording, key=key)
    if recording.metadata.get("has_key") == "true" and key is None:
        player.remarks.append("the link had a key: without --key-file no planner's frame counts")
    timeline = timeline_of(recording, player.begin_s)
    at_s = timeline.instant("--at", options.at)
    asked = cell_of(options, player.config.map.cell_m)
    watch = Watch(player, asked)
    for _ in steps_shown(watch.steps_until(at_s), recording.parts[0].name, timeline, at_s):
        pass
    story = story_of(recording, watch)
    if options.out is not None:
        options.out.write_bytes(picture_of(player.app, player.now_s, story["moment"], asked))
    if options.json:
        print(json.dumps(story, indent=1, allow_nan=False))
        return 0
    for line in lines_of(story):
        print(line)
    for remark in story["remarks"]:
        print(f"mapod why: {remark}")
    if options.out is not None:
        print(f"{options.out}: {LEGEND}")
    return 0


def main(arguments: list[str] | None = None) -> int:
    """Exit status: 0 told, 1 there is no such moment or the recording is damaged, 2 wrong use."""
    parser = parser_of(
        "why",
        __doc__,
        "mapod why drive.mcap --at 12:03:05",
        "mapod why drive.mcap --at 83.5 --xy 2.1,-0.4 --out map.png",
    )
    add = parser.add_argument
    add("recording", type=Path, help="the file, or the folder of its files")
    add("--at", metavar="T", required=True, help=FORMS)
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--cell", type=a_cell, metavar="I,J", help="a cell, by its numbers")
    which.add_argument(
        "--xy", type=a_pair, metavar="X,Y", help="a cell, by its place in the map, m"
    )
    parser.add_out("a file for the picture of the map, PNG")
    parser.add_key()
    add("--json", action="store_true", help="all of it as JSON")
    options = parser.parse_args(
        with_places_joined(sys.argv[1:] if arguments is None else arguments)
    )
    try:
        return why(options)
    except (OSError, ConfigError, InstantError) as error:
        return fail("why", error)
    except (RecordingError, NoMomentError) as error:
        return fail("why", error, 1)
