"""What is recorded: the kinds of records, their bytes, and what a file says of its run.

A record has an instant of the host's monotonic clock, a kind, the number of its port (0 for what is
of none) and data. docs/recording.md describes each kind.
"""

import json
import struct
import zlib
from collections.abc import Mapping

from msgspec import Struct

FORM = "3"
PROFILE = "mapod"
METADATA, END = "mapod", "mapod.end"  # names of metadata: of the run, and of how the file ends
CALLS, LOGS, HEALTH = "/mapod/calls", "/log", "/health"  # topics
WIRE_SCHEMA = "mapod.Wire"
CHECK = "check"  # the key of the metadata that guards all others

HEAD = struct.Struct("<dcBI")  # on the pipe: seconds, kind, port, bytes of data
STAMP = struct.Struct("<dc")  # in a message of a file: seconds, kind; then the data

OPENED, LOST, IN, OUT = b"O", b"L", b"I", b"W"  # of a port
CHANGED = b"C"  # its state after one of the app's uses of it: STATE and the cause as text
READ_ENDED = b"N"  # a read of it in this call of the app ended here
STEP, TURN, STOP = b"S", b"T", b"X"  # calls of the app; TURN with READABLE
ASK = b"A"  # a drive request that came by no planner link: ASKED, and who asks as text
RESTORED = b"R"  # the map of `load_map` was taken over, at exactly this instant
SEEN = b"Q"  # what a frame of the depth camera told entered in this call (recording.frames)
PLANNED = b"G"  # a plan of paths over the floor entered in this call (recording.plans)
GAP = b"D"  # what follows is not all: JSON of how many records of each kind are missing by now
OF_PORTS = frozenset((OPENED, LOST, IN, OUT, CHANGED, READ_ENDED))
OF_CALLS = frozenset((STEP, TURN, STOP, ASK, RESTORED, SEEN, PLANNED, GAP))
OF_WIRES = OF_PORTS | OF_CALLS  # without any one of them a replay is another run

STATE, SCAN, HEIGHTS = b"M", b"P", b"U"  # of the app now and then (recording.packing)
LINE = b"E"  # of the log: JSON of level, event and keys
FIRST, FLIGHT, BYE = b"H", b"F", b"Z"  # to the writer: what it writes, save the last seconds, end

PORT_STATE = struct.Struct("<HBII")  # after use n (from 1) of this call: is open, opened, backlog
READABLE = struct.Struct("<H")  # bit k: port k was readable
ASKED = struct.Struct("<3d")  # m/s, rad/s, valid for so many seconds


class RecordingError(Exception):
    """The file is no recording, or it is damaged; the text says which, in one line."""


class Record(Struct, frozen=True):
    """One thing that happened."""

    t_s: float
    kind: bytes
    port: int  # its place in `Recording.ports`; of TURN, a bit for each that was readable
    data: bytes


def topic_of(port: int, name: str) -> str:
    return f"/wire/{port}/{name}"


def nanoseconds(t_s: float, utc_offset_s: float) -> int:
    """Host monotonic seconds as a time of day, as messages have it."""
    return max(0, round((t_s + utc_offset_s) * 1e9))


def with_check(metadata: Mapping[str, str]) -> dict[str, str]:
    """The same, and a sum by which a reader knows that nothing of it is damaged."""
    return {**metadata, CHECK: _sum(metadata)}


def is_whole(metadata: Mapping[str, str]) -> bool:
    rest = {key: value for key, value in metadata.items() if key != CHECK}
    return metadata.get(CHECK) == _sum(rest)


def _sum(metadata: Mapping[str, str]) -> str:
    return f"{zlib.crc32(json.dumps(dict(metadata), sort_keys=True).encode()):08x}"
