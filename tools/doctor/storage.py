"""The folders of recordings and flights: room, rights, how fast the disk keeps what it is given."""

import os
import shutil
import statistics
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from core.config import Config
from tools.doctor.finding import Finding

BLOCK = bytes(4096)
TRIES = 9
SLOW_S = 0.25  # a recording is kept once a second
FLIGHT_MB = 100  # a flight at most, roughly


def find_storage(config: Config, base: Path) -> Iterator[Finding]:
    """`base`: the folder that mapod is started in, from which the settings' paths lead."""
    record = config.record
    if record.path:
        path = base / record.path
        folder = path if record.path.endswith("/") else path.parent
        yield of_folder("recordings", folder, record.max_mb)
        yield of_fsync(folder)
    else:
        yield Finding("OK", "recordings", "off: [record] path is empty")
    if record.flight:
        yield of_folder("flights", base / record.flight, FLIGHT_MB)
    else:
        advice = 'Nothing tells why a robot stopped: [record] flight = "flight"'
        yield Finding("warning", "flights", "off: [record] flight is empty", advice)


def of_folder(about: str, folder: Path, wants_mb: float) -> Finding:
    """What lies there, and whether the next one has room and may be written."""
    place = existing(folder)
    if not os.access(place, os.W_OK | os.X_OK):
        advice = (
            f"sudo chown {os.environ.get('USER', 'USER')} {place}, or another folder in [record]"
        )
        return Finding("warning", about, f"{place} can't be written", advice)
    sizes = [path.stat().st_size for path in folder.glob("*.mcap") if path.is_file()]
    kept_mb, free_mb = sum(sizes) / 1e6, shutil.disk_usage(place).free / 1e6
    says = f"{len(sizes)} of {kept_mb:.0f} MB in all in {folder}, {free_mb:.0f} MB free"
    if (lacks_mb := wants_mb - kept_mb - free_mb) > 0:
        advice = f"Up to {wants_mb:.0f} MB are to be kept: free {lacks_mb:.0f} MB, or keep less"
        return Finding("warning", about, says, advice)
    return Finding("OK", about, says)


def of_fsync(folder: Path) -> Finding:
    """How long the disk takes to keep a block for good."""
    try:
        took_s = fsync_s(existing(folder))
    except OSError as error:
        return Finding("warning", "fsync", f"{folder}: {error.strerror}", "Look at the disk")
    says = f"{1000 * took_s:.1f} ms for 4 KiB in {existing(folder)}"
    if took_s > SLOW_S:
        advice = "A recording may have gaps: another disk or card"
        return Finding("warning", "fsync", says, advice)
    return Finding("OK", "fsync", says)


def fsync_s(folder: Path) -> float:
    """The median of a few."""
    spans_s = []
    with tempfile.TemporaryFile(dir=folder) as file:
        for _ in range(TRIES):
            began_s = time.monotonic()
            file.write(BLOCK)
            file.flush()
            os.fsync(file.fileno())
            spans_s.append(time.monotonic() - began_s)
    return statistics.median(spans_s)


def existing(folder: Path) -> Path:
    """The folder, or the nearest above it that there is."""
    return next(place for place in (folder, *folder.absolute().parents) if place.is_dir())
