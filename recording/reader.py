"""A recording as it is read: what the run was, and every record of it in its order.

A recording may lie in several files, each of which goes on where the one before ends: given the
first of them, or the folder, all are read. A file that was cut off is read up to its newest `sync`.
"""

import base64
import re
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TypedDict

import msgspec

from recording.mcap_stream import (
    HEADER,
    METADATA,
    McapStream,
    metadata_of,
)
from recording.records import (
    ASK,
    ASKED,
    CALLS,
    CHANGED,
    FORM,
    GAP,
    HEALTH,
    LOGS,
    OF_WIRES,
    PORT_STATE,
    READABLE,
    STAMP,
    TURN,
    Record,
    RecordingError,
    is_whole,
)
from recording.records import METADATA as OF_THE_RUN

OLDER = re.compile(rb'\{"mapod_recording": (\d+)')
SHORTEST = dict.fromkeys(OF_WIRES, 0)  # data of each kind that there is
SHORTEST |= {TURN: READABLE.size, ASK: ASKED.size, CHANGED: PORT_STATE.size}
SHOWN = "version", "message"  # what people read of a run
LATEST_S = 1e11  # later no calendar goes
MOST_OPENING = 2**32  # records: they are numbered modulo this
NUMBERED = re.compile(r"(.*?)(?:\.(\d+))?\.mcap")


@dataclass(frozen=True, slots=True)
class LogLine:
    """One line of the app's log; no text of it steers a terminal."""

    t_s: float
    level: str
    event: str
    keys: dict[str, Any]


class Place(NamedTuple):
    """Where the robot was at an instant, by the names of the topic of health."""

    t_s: float
    x_m: float
    y_m: float
    yaw_rad: float


def shown(value: Any) -> Any:
    """A text as a terminal may get it, with nothing in it that steers one; all else as it is."""
    if not isinstance(value, str) or value.isprintable():
        return value
    return "".join(letter if letter.isprintable() else " " for letter in value)


class Wire(TypedDict):
    """What a wire of the run was like."""

    datagrams: bool
    silence_s: float | None  # None: it is never opened anew


class Line(msgspec.Struct, frozen=True):
    """A message of the log, as it is checked."""

    of: LogLine


class Health(msgspec.Struct, frozen=True):
    """What is read of a message of health."""

    t_s: float
    x_m: float | None = None  # None: the pose was not known
    y_m: float = 0.0
    yaw_rad: float = 0.0


Session = Annotated[int, msgspec.Meta(ge=0, lt=2**32)]
Offset = Annotated[float, msgspec.Meta(ge=-LATEST_S, le=LATEST_S)]
UNREADABLE = msgspec.DecodeError, RecursionError  # of JSON


def first_metadata(path: Path) -> dict[str, str]:
    """What a file says of its run. Raises OSError, RecordingError: it says nothing of any."""
    with path.open("rb") as file:
        if older := OLDER.match(file.read(64)):
            raise RecordingError(f"{path}: a recording of form {older[1].decode()}, not {FORM}")
    for opcode, content in McapStream(path).records():
        if opcode == METADATA:
            try:
                name, entries = metadata_of(content)
            except (struct.error, UnicodeDecodeError):
                raise RecordingError(f"{path} is damaged in what it says of the run") from None
            if name == OF_THE_RUN:
                return _checked(path, entries)
        elif opcode != HEADER:
            break
    raise RecordingError(f"{path} is not a recording of mapod")


def _checked(path: Path, entries: dict[str, str]) -> dict[str, str]:
    if entries.get("form") != FORM:
        raise RecordingError(f"{path}: a recording of form {entries.get('form')}, not {FORM}")
    if not is_whole(entries):
        raise RecordingError(f"{path} is damaged in what it says of the run")
    return {**entries, **{key: shown(entries[key]) for key in SHOWN if key in entries}}


class Recording:
    """A recording. Raises OSError, RecordingError: it can't be read; it is none."""

    def __init__(self, path: Path) -> None:
        self.path, self.parts = path, parts_of(path)
        self.metadata = first_metadata(self.parts[0])
        try:
            self.version, self.config = self.metadata["version"], self.metadata["config"]
            self.ports = msgspec.json.decode(self.metadata["ports"], type=list[str])
            self.wires = msgspec.json.decode(self.metadata["wires"], type=list[Wire])
            self.session = msgspec.json.decode(self.metadata["session"], type=Session)
            self.utc_offset_s = msgspec.json.decode(self.metadata["utc_offset_s"], type=Offset)
            self.from_start = self.metadata["from_start"] == "true"
            self._openings = {part: opening_of(first_metadata(part)) for part in self.parts}
        except (KeyError, ValueError, *UNREADABLE):
            raise RecordingError(f"{self.parts[0]} is not a recording of mapod") from None
        self.is_cut = False  # known after reading: the newest file has no end
        self.gap = ""  # known after reading: what is missing from there on, as a message

    @cached_property
    def loaded_map(self) -> bytes | None:
        """The file of the map that the run went on from."""
        text = self.metadata.get("load_map", "")
        try:
            return base64.b64decode(text, validate=True) if text else None
        except ValueError:
            raise RecordingError(f"{self.parts[0]} is damaged in its map") from None

    def records(self) -> Iterator[Record]:
        """What moved the app and what it wrote, in order, up to the first gap.

        Raises:
            RecordingError: the recording is damaged there. OSError.
        """
        for record in islice(self._wires(), self._openings[self.parts[0]], None):
            if record.kind == GAP:
                missing = shown(record.data.decode(errors="replace"))
                self.gap = f"the disk was too slow: {missing} are missing"
                return
            yield record

    def opening(self) -> list[Record]:
        """Of a file that begins in the middle of a run: how its ports were opened before.

        Raises:
            RecordingError: the recording is damaged there. OSError.
        """
        return list(islice(self._wires(), self._openings[self.parts[0]]))

    def _wires(self) -> Iterator[Record]:
        places = {f"/wire/{k}/{name}": k for k, name in enumerate(self.ports)} | {CALLS: 0}
        further = self._openings | {self.parts[0]: 0}
        expected: int | None = None  # the records of all files are numbered through
        for stream in self._streams():
            for topic, sequence, content in stream.messages(places):
                if further[stream.path] > 0:  # it repeats how the ports were opened
                    further[stream.path] -= 1
                    continue
                if expected not in (None, sequence):
                    raise RecordingError(
                        f"{stream.path}: records are missing before number {sequence}"
                    )
                expected = (sequence + 1) % 2**32
                record = maybe_record(places[topic], content)
                if record is None:
                    raise RecordingError(
                        f"{stream.path}: a record of no known kind, number {sequence}"
                    )
                yield record

    def logs(self) -> Iterator[LogLine]:
        """The app's log. Raises RecordingError, OSError."""
        for stream in self._streams():
            for _, _, content in stream.messages((LOGS,)):
                try:
                    line = msgspec.json.decode(content, type=Line).of
                except UNREADABLE:
                    raise RecordingError(f"{stream.path}: a log line can't be read") from None
                keys = {shown(key): shown(value) for key, value in line.keys.items()}
                yield LogLine(line.t_s, shown(line.level), shown(line.event), keys)

    def places(self) -> Iterator[Place]:
        """Where the robot was, now and then. Raises RecordingError, OSError."""
        for stream in self._streams():
            for _, _, content in stream.messages((HEALTH,)):
                try:
                    told = msgspec.json.decode(content, type=Health)
                except UNREADABLE:
                    raise RecordingError(f"{stream.path}: a state can't be read") from None
                if told.x_m is not None:
                    yield Place(told.t_s, told.x_m, told.y_m, told.yaw_rad)

    def _streams(self) -> Iterator[McapStream]:
        """All files, each to be read to its end."""
        for path in self.parts:
            stream = McapStream(path)
            yield stream
            self.is_cut = stream.is_cut


def maybe_record(port: int, content: bytes) -> Record | None:
    """What a message of a wire holds; None: nothing that is known."""
    if len(content) < STAMP.size:
        return None
    t_s, kind = STAMP.unpack_from(content)
    data, shortest = content[STAMP.size :], SHORTEST.get(kind)
    if shortest is None or len(data) < shortest:
        return None
    if not abs(t_s) < LATEST_S:
        return None
    if kind == TURN:
        (port,) = READABLE.unpack_from(data)
    return Record(t_s, kind, port, data)


def parts_of(path: Path) -> list[Path]:
    """The files of a recording: of a folder's only one, or those that go on from this file."""
    if path.is_dir():
        runs: dict[str, list[Path]] = {}
        for file in sorted(path.glob("*.mcap")):
            runs.setdefault(first_metadata(file)["recording"], []).append(file)
        if len(runs) != 1:
            found = ", ".join(files[0].name for files in runs.values()) or "none"
            raise RecordingError(f"{path} holds {len(runs)} recordings, name one: {found}")
        [files] = runs.values()
        return sorted(files, key=number_of)
    files, run = [path], first_metadata(path).get("recording")
    stem, number = NUMBERED.fullmatch(path.name), number_of(path)
    while stem is not None:
        number += 1
        following = path.with_name(f"{stem[1]}.{number}.mcap")
        if not following.exists() or first_metadata(following).get("recording") != run:
            break
        files.append(following)
    return files


def opening_of(metadata: Mapping[str, str]) -> int:
    """How many records at a file's begin tell of what was before it. Raises ValueError."""
    return max(0, min(MOST_OPENING, int(metadata.get("opening", "0"))))


def number_of(path: Path) -> int:
    """Which of the recording's files it is, by its name."""
    found = NUMBERED.fullmatch(path.name)
    return int(found[2] or 1) if found else 1
