"""A recording as files for other programs: tables, point clouds, pictures, a map for ROS.

The recording is played through the app, and what the app hears and works out is written down.
csv and parquet: pose, health, scans (a row for each range), wheel counts and attitude. pcd: the
returns in the map's frame, of the whole drive or of the newest sweep at --at. png: a layer of the
map at --at, with a world file in metres. ros: map.pgm and map.yaml, as map_server reads them.
"""

import argparse
import importlib.util
import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from core.config import ConfigError
from core.mapping.layers import UNITS
from core.records import F64
from recording.reader import Recording
from recording.records import RecordingError
from tools.cli.options import fail, parser_of
from tools.export.collect import collect_points, collect_tables, trusted_layer
from tools.export.pcd import points_from, write_pcd
from tools.export.raster import write_png, write_ros
from tools.export.tables import Tables
from tools.replay.instants import FORMS, InstantError, Timeline
from tools.replay.player import Player
from tools.replay.showing import steps_shown
from tools.replay.sources import drive_in
from tools.replay.span import timeline_of

KINDS = ("csv", "parquet", "pcd", "png", "ros")
NO_PARQUET = "--to parquet needs the extra export: pip install '/path/to/mapod[export]'"


@dataclass(frozen=True, slots=True)
class Job:
    """A recording that is about to be played, and what is wanted of it."""

    player: Player
    line: Timeline
    until_s: float  # host clock of the recording; inf: all of it
    options: argparse.Namespace

    def steps(self) -> Iterator[float]:
        """Its calls, each once it is played, and a bar."""
        steps = self.player.steps_until(self.until_s)
        return steps_shown(steps, self.options.recording.name, self.line, self.until_s)


class NothingToExportError(Exception):
    """There is no such thing in the recording; the text says why."""


def export_tables(job: Job) -> list[Path]:
    tables = Tables(job.options.out, job.options.to)
    try:
        collect_tables(job.player, job.steps(), tables, job.line.utc_offset_s)
    finally:
        tables.close()
    print(", ".join(f"{name} {count}" for name, count in tables.rows.items()), "rows")
    return list(tables.paths.values())


def export_points(job: Job) -> list[Path]:
    """All returns; with --at those of the newest sweep then."""
    sweeps: list[tuple[float, F64]] = []
    only_newest = job.until_s < math.inf

    def take(t_s: float, places: F64) -> None:
        if only_newest:
            sweeps.clear()
        sweeps.append((t_s - job.player.begin_s, places))

    collect_points(job.player, job.steps(), take)
    if not sweeps:
        raise NothingToExportError("no sweep was mapped until then")
    points = np.concatenate([points_from(places, t_s) for t_s, places in sweeps])
    path: Path = job.options.out / "points.pcd"
    write_pcd(path, points, job.options.ascii)
    print(f"{len(points)} points of {len(sweeps)} sweeps")
    return [path]


def export_map(job: Job) -> list[Path]:
    """A layer as a picture, or the map for ROS."""
    player, options = job.player, job.options
    for _ in job.steps():
        pass
    if not player.app.mapper.counts.scans_added:
        raise NothingToExportError("no sweep was mapped until then")
    name = options.layer or "state"
    view = trusted_layer(player, name)
    if view is None:
        method = player.config.map.method
        raise NothingToExportError(f"the method {method!r} has no layer {name!r}")
    return (write_ros if options.to == "ros" else write_png)(options.out, view)


def export(options: argparse.Namespace) -> int:
    """Raises OSError, RecordingError, ConfigError, InstantError, NothingToExportError."""
    recording = drive_in(options.recording)
    player = Player(recording)
    line = timeline_of(recording, player.begin_s)
    until_s = math.inf if options.at is None else line.instant("--at", options.at)
    options.out.mkdir(parents=True, exist_ok=True)
    how = {"csv": export_tables, "parquet": export_tables, "pcd": export_points}
    job = Job(player, line, until_s, options)
    for path in how.get(options.to, export_map)(job):
        print(path)
    for remark in remarks_on(player, recording):
        print(f"mapod export: {remark}", file=sys.stderr)
    return 0


def remarks_on(player: Player, recording: Recording) -> list[str]:
    """What a reader of the files should know of the recording and its replay."""
    remarks = list(player.remarks)
    if recording.is_cut:
        remarks.append("the recording was cut off: this is all that it holds")
    if recording.gap:
        remarks.append(recording.gap)
    is_open = recording.metadata.get("has_key") != "true"  # no recording keeps a key
    if recording.from_start and is_open and player.done:
        remarks += [check.describe() for check in player.checks if not check.is_identical]
    return remarks


def main(arguments: list[str] | None = None) -> int:
    """Exit status: 0 done, 1 there was nothing of it or the recording is damaged, 2 wrong use."""
    parser = parser_of(
        "export",
        __doc__,
        "mapod export drive.mcap --to csv --out tables",
        "mapod export drive.mcap --to png --layer height --at 12:03:05 --out pictures",
    )
    add = parser.add_argument
    add("recording", type=Path, help="the file, or the folder of its files")
    add("--to", choices=KINDS, required=True, help="what to write")
    add("--out", type=Path, default=Path("export"), help="the folder for it (default: export)")
    add("--at", metavar="T", help=f"up to then: {FORMS}")
    add("--layer", choices=tuple(UNITS), help="of png (default: state)")
    add("--ascii", action="store_true", help="pcd as text")
    options = parser.parse_args(arguments)
    for option, given, kind in (
        ("--layer", options.layer, "png"),
        ("--ascii", options.ascii, "pcd"),
    ):
        if given and options.to != kind:
            parser.error(f"{option} is of --to {kind}, not of {options.to}")
    if options.to == "parquet" and importlib.util.find_spec("pyarrow") is None:
        return fail("export", NO_PARQUET)
    try:
        return export(options)
    except OSError as error:
        return fail("export", f"{error.filename or options.recording}: {error.strerror or error}")
    except (ConfigError, InstantError) as error:
        return fail("export", error)
    except (RecordingError, NothingToExportError) as error:
        return fail("export", error, 1)
