"""Which register means what, and how SI numbers become what a register holds.

The image and docs/protocols/modbus.md are made from these tables. Registers hold 16 bits; what
needs two has its high word first. Numbers are scaled, rounded and kept within their range; an age
or an obstacle's distance that is not a number becomes the worst value of its register.
Source: own layout, with the link's cell codes, health bits and modes.
"""

import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum

LAYOUT_VERSION = 0x0100  # high byte: incompatible; low byte: additions
WORD_ORDER_TEST = 0x12345678
MOST_READ = 125  # registers a request, set by the protocol
CELLS_PER_REGISTER = 8  # 2 bits each, lowest column in the lowest bits
COARSE_CELLS = 21

STATUS, LATCH, COARSE, DRIVE, WINDOW = 0, 90, 100, 200, 1000  # first registers of the blocks
WINDOW_CELLS = WINDOW + 10
NOT_KNOWN = 0xFFFF  # of an age, a distance or a time that there is none of

FORMATS = {"u16": "H", "i16": "h", "u32": "I", "i32": "i"}
Value = int | bytes


class Refusal(IntEnum):
    """Why a request is not served; NONE: it is."""

    NONE = 0
    FUNCTION = 1  # unknown, or not allowed to this client
    ADDRESS = 2  # no such register, or it can't be written
    VALUE = 3  # a count or a value that can't be, or only part of what belongs together
    BUSY = 6  # what this unit had frozen is too old: freeze anew
    NO_UNIT = 0x0B  # nobody with this unit id lives here


Answer = bytes | Refusal


@dataclass(frozen=True, slots=True)
class Entry:
    """Registers that belong together: one number, a text, or cells."""

    name: str
    address: int
    kind: str  # u16, i16, u32, i32; ascii and cells: `count` registers of bytes
    unit: str
    meaning: str
    count: int = 1  # registers; of u32 and i32 always 2

    @property
    def registers(self) -> int:
        return 2 if self.kind in ("u32", "i32") else self.count

    @property
    def format(self) -> str:
        return FORMATS.get(self.kind, f"{2 * self.count}s")


class Block:
    """Entries in the order of their addresses; what lies between them reads 0."""

    def __init__(self, first: int, size: int, entries: list[Entry]) -> None:
        self.first, self.size, self.entries = first, size, entries
        parts, at = [">"], first
        for entry in entries:
            assert at <= entry.address, f"{entry.name} begins in the entry before it"
            parts.append(f"{2 * (entry.address - at)}x{entry.format}")
            at = entry.address + entry.registers
        assert at <= first + size, f"no room for {entries[-1].name}"
        parts.append(f"{2 * (first + size - at)}x")
        self._struct = struct.Struct("".join(parts))
        self._places = {entry.name: entry for entry in entries}

    def pack(self, values: Mapping[str, Value]) -> bytes:
        """All registers of the block as they go over the wire; each entry needs its value."""
        return self._struct.pack(*(values[entry.name] for entry in self.entries))

    def put(self, into: bytearray | memoryview, name: str, value: Value) -> None:
        """Replace one entry in what `pack` gave."""
        entry = self._places[name]
        struct.pack_into(f">{entry.format}", into, 2 * (entry.address - self.first), value)


_HEALTH = (
    "bit 0 scanner, 1 attitude sensor, 2 encoders or poses deliver in time; 3 the pose is valid, "
    "4 the map is; 5 a planner has answered; 6 settings are right; 15 something is wrong"
)
_ZONE = "0 unknown, 1 clear, 2 slow, 3 stop; with 0 and 3 a vehicle must not go on"
_CAUSES = "bit 0 an obstacle, 1 ground that was not seen, 2 a drop, 3 map or pose not to be trusted"
_AGE = "65535: never, or 65.5 s and more"
_NONE = "65535: none is known"
_GENERATION = "of registers 21 to 78; skips 0; 0: nothing published yet, or too long ago"

STATUS_BLOCK = Block(
    STATUS,
    80,
    [
        Entry("magic", 0, "u16", "", 'always 4D50h, "MP"'),
        Entry("layout", 1, "u16", "", "version of this table; a new high byte: not compatible"),
        Entry("version_major_minor", 2, "u16", "", "of mapod, major * 256 + minor"),
        Entry("version_patch", 3, "u16", "", "of mapod"),
        Entry("instance", 4, "u32", "", "drawn anew at each start of mapod"),
        Entry("name", 6, "ascii", "", "16 characters, first in the high byte, zero filled", 8),
        Entry("uptime", 14, "u32", "s", "since the start"),
        Entry("word_order_test", 16, "u32", "", "always 12345678h: 1234h in register 16"),
        Entry("utc", 18, "u32", "s", "since 1970; 0: not set"),
        Entry("generation", 20, "u16", "", _GENERATION),
        Entry("health", 21, "u16", "", _HEALTH),
        Entry("heartbeat", 22, "u16", "", "grows once a second while mapod works"),
        Entry("age_scan", 23, "u16", "ms", f"of the newest scan in the map; {_AGE}"),
        Entry("age_attitude", 24, "u16", "ms", f"of the newest attitude; {_AGE}"),
        Entry(
            "age_encoders",
            25,
            "u16",
            "ms",
            f"of the newest encoder counts, or external pose; {_AGE}",
        ),
        Entry("age_window", 26, "u16", "ms", f"of the obstacle window; {_AGE}"),
        Entry("age_pose", 27, "u16", "ms", f"of the pose; {_AGE}"),
        Entry("x", 28, "i32", "mm", "position in the map frame: the robot's at the start"),
        Entry("y", 30, "i32", "mm", "likewise"),
        Entry("heading", 32, "u16", "0.01 deg", "0 to 35999, counter-clockwise from x"),
        Entry("quality", 33, "u16", "%", "of the pose: 100 valid, 50 degraded, 0 not valid"),
        Entry("sigma_position", 34, "u16", "mm", f"standard deviation; {_NONE}"),
        Entry("sigma_heading", 35, "u16", "0.01 deg", f"standard deviation; {_NONE}"),
        Entry("speed", 36, "i16", "mm/s", "forward, measured"),
        Entry("turn", 37, "i16", "0.01 deg/s", "counter-clockwise, measured"),
        Entry("stop_zone", 38, "u16", "", _ZONE),
        Entry("nearest", 39, "u16", "mm", f"from the robot's edge to the next obstacle; {_NONE}"),
        Entry("bearing", 40, "i16", "0.01 deg", "of that one, counter-clockwise from ahead"),
        *(
            Entry(f"sector_{k}", 41 + k, "u16", "mm", f"from the axle, at {45 * k} deg; {_NONE}")
            for k in range(8)
        ),
        Entry("cell", 49, "u16", "mm", "edge of a cell of the window"),
        Entry("window_cells", 50, "u16", "", "N: cells along an edge of the window"),
        Entry("window_stride", 51, "u16", "", "S: registers of one row"),
        Entry("window_x", 52, "i32", "mm", "middle of the window's cell (0, 0), map frame"),
        Entry("window_y", 54, "i32", "mm", "likewise"),
        Entry("window_first", 56, "u16", "", "first register of the window block"),
        Entry("window_registers", 57, "u32", "", "N * S: registers of its cells"),
        Entry("coarse_cell", 59, "u16", "mm", "edge of a cell of the coarse map"),
        Entry("coarse_cells", 60, "u16", "", "cells along an edge of the coarse map"),
        Entry("faults", 61, "u16", "", "how many things are wrong now; 0 in good health"),
        Entry("window_generation", 62, "u16", "", "of the newest window and coarse map"),
        Entry("generation_again", 63, "u16", "", "as register 20"),
        Entry("link_health", 64, "u16", "", "the health word of the planner link, bit by bit"),
        Entry("mode", 65, "u16", "", "0 booting, 1 running, 2 degraded, 3 fault, 4 replayed data"),
        Entry("zone_causes", 66, "u16", "", _CAUSES),
        Entry("free_ahead", 67, "u16", "mm", "straight ahead, until a cell that is not free"),
        Entry("obstacle_ahead", 68, "u16", "mm", f"to the nearest obstacle there; {_NONE}"),
        Entry("free_behind", 69, "u16", "mm", "straight back, likewise"),
        Entry("obstacle_behind", 70, "u16", "mm", f"to the nearest obstacle there; {_NONE}"),
        Entry("contact", 71, "u16", "ms", "until it meets what is not free; 65535: not in sight"),
        Entry("allowed_ahead", 72, "u16", "mm/s", "from which it can stop within the free way"),
        Entry("allowed_behind", 73, "u16", "mm/s", "likewise"),
        Entry("pitch", 74, "i16", "0.01 deg", "nose down positive"),
        Entry("roll", 75, "i16", "0.01 deg", "right side down positive"),
        Entry("generation_end", 79, "u16", "", "as register 20"),
    ],
)

_LATCH = (
    "generation that this unit shows in its window; written (any value): the newest is frozen for "
    "this unit"
)
LATCH_BLOCK = Block(LATCH, 1, [Entry("latch", LATCH, "u16", "", _LATCH)])

_COARSE_ROW = -(-COARSE_CELLS // CELLS_PER_REGISTER)
_COARSE_COUNT = COARSE_CELLS * _COARSE_ROW
_COARSE_ROWS = f"{COARSE_CELLS} rows of {_COARSE_ROW} registers"
COARSE_REGISTERS = 7 + _COARSE_COUNT + 1
COARSE_BLOCK = Block(
    COARSE,
    COARSE_REGISTERS,
    [
        Entry("coarse_generation", COARSE, "u16", "", "0: no map"),
        Entry("coarse_age", COARSE + 1, "u16", "ms", _AGE),
        Entry("coarse_x", COARSE + 2, "i32", "mm", "middle of cell (0, 0), map frame"),
        Entry("coarse_y", COARSE + 4, "i32", "mm", "likewise"),
        Entry("coarse_cell", COARSE + 6, "u16", "mm", "edge of a cell"),
        Entry("coarse_cells", COARSE + 7, "cells", "", _COARSE_ROWS, _COARSE_COUNT),
        Entry("coarse_generation_again", COARSE + COARSE_REGISTERS - 1, "u16", "", "likewise"),
    ],
)
LOW_END = COARSE + COARSE_REGISTERS  # registers 0 up to here can be read across blocks

DRIVE_REQUEST = 4  # registers, written together
DRIVE_BLOCK = Block(
    DRIVE,
    10,
    [
        Entry("drive_v", DRIVE, "i16", "mm/s", "asked for, forward"),
        Entry("drive_w", DRIVE + 1, "i16", "mrad/s", "asked for, counter-clockwise"),
        Entry("drive_valid", DRIVE + 2, "u16", "ms", "how long it holds, 1 to 1000; 0: stop now"),
        Entry("drive_sequence", DRIVE + 3, "u16", "", "the commander's own count of requests"),
        Entry("ack_sequence", DRIVE + 4, "u16", "", "of the newest request"),
        Entry("ack_result", DRIVE + 5, "u16", "", "0 taken; else why not, see below"),
        Entry("ack_taken", DRIVE + 6, "u16", "", "sequence of the newest request that was taken"),
        Entry("ack_left", DRIVE + 7, "u16", "ms", "for which that one still holds"),
        Entry("driven_v", DRIVE + 8, "i16", "mm/s", "what the motors are commanded to now"),
        Entry("driven_w", DRIVE + 9, "i16", "mrad/s", "likewise"),
    ],
)


def stride_of(cells: int) -> int:
    """Registers of one row: each row begins in a new one.

    >>> stride_of(21), stride_of(101), stride_of(401)
    (3, 13, 51)
    """
    return -(-cells // CELLS_PER_REGISTER)


def window_block(cells: int) -> Block:
    count = cells * stride_of(cells)
    end = WINDOW_CELLS + count
    entries = [
        Entry("generation", WINDOW, "u16", "", "skips 0; 0: no map"),
        Entry("age", WINDOW + 1, "u16", "ms", _AGE),
        Entry("x", WINDOW + 2, "i32", "mm", "middle of cell (0, 0), map frame"),
        Entry("y", WINDOW + 4, "i32", "mm", "likewise"),
        Entry("cell", WINDOW + 6, "u16", "mm", "edge of a cell"),
        Entry("cells_edge", WINDOW + 7, "u16", "", "N: cells along an edge"),
        Entry("stride", WINDOW + 8, "u16", "", "S: registers of one row"),
        Entry("flags", WINDOW + 9, "u16", "", "bit 0: the map is trusted; 0: no cell says free"),
        Entry("cells", WINDOW_CELLS, "cells", "", "N rows of S registers", count),
        Entry("generation_again", end, "u16", "", "as register 1000"),
        Entry("pose_x", end + 1, "i32", "mm", "of the robot when this map was taken"),
        Entry("pose_y", end + 3, "i32", "mm", "likewise"),
        Entry("pose_heading", end + 5, "u16", "0.01 deg", "0 to 35999, likewise"),
    ]
    return Block(WINDOW, 10 + count + 7, entries)


def bounded(value: float, lowest: int, highest: int) -> int:
    """Rounded, within the range; 0 for what is no number.

    >>> bounded(1.6, 0, 10), bounded(-3.0, 0, 10), bounded(math.inf, 0, 10), bounded(math.nan, 0, 1)
    (2, 0, 10, 0)
    """
    return 0 if math.isnan(value) else round(max(lowest, min(highest, value)))


def mm_signed(metres: float) -> int:
    """A coordinate, int32 mm."""
    return bounded(metres * 1000.0, -(2**31), 2**31 - 1)


def thousandths_signed(value: float) -> int:
    """A speed in mm/s or a rate in mrad/s, int16."""
    return bounded(value * 1000.0, -32768, 32767)


def cdeg_signed(radians: float) -> int:
    """An angle or a rate of turn, int16 hundredths of a degree."""
    return bounded(math.degrees(radians) * 100.0, -32768, 32767)


def heading_cdeg(yaw_rad: float) -> int:
    """0 to 35999, counter-clockwise from x.

    >>> heading_cdeg(-math.pi / 2), heading_cdeg(-1e-9), heading_cdeg(math.nan)
    (27000, 0, 0)
    """
    return round(math.degrees(yaw_rad) * 100.0) % 36000 if math.isfinite(yaw_rad) else 0


def way(metres: float) -> int:
    """A free way or an allowed speed in thousandths, rounded down, at most 65534.

    >>> way(1.9999), way(math.nan), way(math.inf)
    (1999, 0, 65534)
    """
    return 0 if math.isnan(metres) else int(max(0.0, min(65534.0, metres * 1000.0)))


def distance_mm(metres: float) -> int:
    """To an obstacle, rounded down; inf is "none is known", no number is 0: right here.

    >>> distance_mm(0.3), distance_mm(math.inf), distance_mm(100.0), distance_mm(math.nan)
    (300, 65535, 65534, 0)
    """
    return NOT_KNOWN if metres == math.inf else way(metres)


def or_worst(value: float) -> int:
    """What is better when small; the highest value where it is not known, or too great.

    >>> or_worst(12.4), or_worst(math.inf), or_worst(math.nan), or_worst(-1.0)
    (12, 65535, 65535, 0)
    """
    return NOT_KNOWN if math.isnan(value) else bounded(value, 0, NOT_KNOWN)


def age_ms(seconds: float) -> int:
    """65535 when there is none, or it is 65.5 s and more."""
    return or_worst(seconds * 1000.0)
