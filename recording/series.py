"""The files of a recording one after the other, within the room that they may take."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from recording.flight import age_of
from recording.openings import Openings
from recording.records import OF_WIRES
from recording.run_file import RunFile

OWN = "mapod-*.mcap"  # in a folder: recordings of ours, of any run
MB = 1_000_000


class Series:
    """A recording on disk. All of it may raise OSError: then it is whole up to that second.

    Args:
        openings: of the same run, for files whose first ones are gone.
    """

    def __init__(self, run: Mapping[str, Any], openings: Openings) -> None:
        self._run, given = run, str(run["path"])
        self._openings, self._next, self._taken_s = openings, 0, 0.0  # number, time
        self._is_folder = given.endswith("/")
        self.first = Path(given)
        if self._is_folder:
            self.first.mkdir(parents=True, exist_ok=True)
            self.first /= f"mapod-{name_of_time(run['metadata']['started_utc'])}.mcap"
        self._most_bytes = run["max_mb"] * MB
        self._file_bytes = min(run["file_mb"] * MB, self._most_bytes / 2)
        self._number, self._own = 1, [self.first]
        self._file = self._begun(self.first, "")

    @property
    def name(self) -> str:
        return str(self._own[-1])

    def take(self, t_s: float, kind: bytes, port: int, data: bytes, sequence: int) -> None:
        self._file.take(t_s, kind, port, data, sequence)
        self._next, self._taken_s = sequence + (kind in OF_WIRES), t_s

    def sync(self) -> None:
        """All of it is on disk; where the file has become large, the next one begins."""
        self._file.sync()
        if self._file.size >= self._file_bytes:
            self._file.finish({"cause": "the next file goes on"})
            self._number += 1
            before = self._own[-1].name
            stem = self.first.name.removesuffix(".mcap")
            self._own.append(self.first.with_name(f"{stem}.{self._number}.mcap"))
            self._file = self._begun(self._own[-1], before)
        self._make_room()

    def finish(self, end: Mapping[str, str]) -> None:
        self._file.finish(end)

    def abandon(self) -> None:
        self._file.abandon()

    def _begun(self, path: Path, before: str) -> RunFile:
        more = {"part": str(self._number), "continues": before}
        return RunFile(path, self._run, more, self._openings, self._next, self._taken_s)

    def _make_room(self) -> None:
        """The oldest go: of this run, or in a folder of any."""
        known = self.first.parent.glob(OWN) if self._is_folder else self._own
        files = sorted((path for path in known if path.exists()), key=age_of)
        total = sum(path.stat().st_size for path in files)
        for path in files:
            if total <= self._most_bytes or path == self._own[-1]:
                return
            total -= path.stat().st_size
            path.unlink()


def name_of_time(utc: str) -> str:
    """`2026-03-01T12:00:00.123456Z` as a part of a file's name, `20260301T120000Z`."""
    return utc.partition(".")[0].replace("-", "").replace(":", "") + "Z"
