"""What the sender's frames say: geometry, pose, stop zone, digest, cell operations.

A body of the wrong length, or that contradicts itself, gives None; nothing raises.
Source: planner link, section 3.
"""

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from mapod_link.frames import DIGEST, GEOM, MAP, OBJECTS, PATH, POSE, SCAN, STOP_ZONE, TILE, Frame
from mapod_link.objects import ObjectsPiece, maybe_objects_piece
from mapod_link.paths import PathPiece, maybe_path_piece
from mapod_link.scans import ScanPiece, maybe_scan_piece
from mapod_link.tiles import TilePiece, maybe_tile_piece

UNKNOWN, FREE, OBSTACLE, KEEP = 0, 1, 2, 3  # of a cell; KEEP only in an operation
GEOM_BODY = struct.Struct("<BxHHHIHH")
POSE_BODY = struct.Struct("<iihhhhhHBBBB")
MAP_HEAD = struct.Struct("<hhHB3s")  # ox, oy, repaired, geom_id, start
DIGEST_BODY = struct.Struct("<BxxxI")
ZONE_BODY = struct.Struct("<8HhBB")
NONE_KNOWN, OLDEST = 0xFFFF, 255  # of a distance or time; of an age
AGE_UNIT_S = 0.004
Run = tuple[int, int, int]  # state, first cell, cell after the last
POSE_VALID, MAP_VALID, DROP_OFF = 1 << 4, 1 << 5, 1 << 7  # bits of POSE's health
ATTITUDE_OUT, OPERATOR_STOP = 1 << 9, 1 << 15
RUNNING = (1, 2)  # modes in which a robot may move
ZONE_STALE_S = 0.35
JUDGED = (1, 2, 3)  # states of a stop zone that speak of what is known


@dataclass(frozen=True, slots=True)
class Geometry:
    """What the sender says of its window."""

    geom_id: int  # epoch: another one means that all cells were forgotten
    width: int  # cells along map x
    height: int  # cells along map y
    cell_m: float
    session: int  # of this run of the sender
    tick_s: float  # nominal period of MAP frames
    stale_s: float  # silence after which nothing that was told may be used

    @property
    def layout(self) -> tuple[int, int, int, float]:
        return self.geom_id, self.width, self.height, self.cell_m

    def cell_of(self, x_m: float, y_m: float) -> tuple[int, int]:
        """World cell (column, row) of a place in the map frame."""
        return math.floor(x_m / self.cell_m), math.floor(y_m / self.cell_m)

    def corner_around(self, pose: "Pose") -> tuple[int, int]:
        """About where a window lies with the robot in its middle; MAP tells it modulo 65 536."""
        i, j = self.cell_of(pose.x_m, pose.y_m)
        return i - self.width // 2, j - self.height // 2


def maybe_geometry(body: bytes) -> Geometry | None:
    if len(body) != GEOM_BODY.size:
        return None
    geom_id, width, height, cell_mm, session, tick_ms, stale_ms = GEOM_BODY.unpack(body)
    if not (width and height and cell_mm):
        return None
    return Geometry(
        geom_id, width, height, cell_mm / 1000, session, tick_ms / 1000, stale_ms / 1000
    )


@dataclass(frozen=True, slots=True)
class Pose:
    """Where the robot is and how well it is, as told by one POSE frame."""

    t_ms: int  # sender's clock
    arrived_s: float  # receiver's clock
    x_m: float  # map frame
    y_m: float
    yaw_rad: float  # counter-clockwise
    pitch_rad: float  # nose down positive
    roll_rad: float
    v_mps: float  # forward
    w_radps: float  # counter-clockwise
    health: int  # bits of section 3
    age_scan_s: float  # inf: 1.02 s or more
    age_ahrs_s: float
    age_enc_s: float
    mode: int  # 0 booting, 1 running, 2 degraded, 3 fault, 4 replayed or simulated data

    def stop_reason(self) -> str:
        """Why section 5 stops a planner that hears this, the strictest first; "" for nothing."""
        reasons = {
            f"mode {self.mode}": self.mode not in RUNNING,
            "pose not valid": not self.health & POSE_VALID,
            "map not valid": not self.health & MAP_VALID,
            "attitude out of range": self.health & ATTITUDE_OUT,
            "drop-off ahead": self.health & DROP_OFF,
            "operator stop": self.health & OPERATOR_STOP,
        }
        return next((why for why, holds in reasons.items() if holds), "")


def maybe_pose(body: bytes, t_ms: int, arrived_s: float) -> Pose | None:
    if len(body) != POSE_BODY.size:
        return None
    x_mm, y_mm, yaw, pitch, roll, v, w, health, *ages, mode = POSE_BODY.unpack(body)
    scan_s, ahrs_s, enc_s = (math.inf if age == OLDEST else age * AGE_UNIT_S for age in ages)
    return Pose(
        t_ms, arrived_s,
        x_mm / 1000, y_mm / 1000, yaw / 10_000, pitch / 10_000, roll / 10_000, v / 1000, w / 1000,
        health, scan_s, ahrs_s, enc_s, mode,
    )  # fmt: skip


ZONE_STATES = ("unknown", "clear", "slow", "stop")
ZONE_CAUSES = ("an obstacle", "ground not seen", "a drop", "map or pose not to be trusted")


@dataclass(frozen=True, slots=True)
class StopZone:
    """What the sender makes of its map before and behind the robot, as told by one frame."""

    t_ms: int  # sender's clock
    arrived_s: float  # receiver's clock
    free_ahead_m: float  # straight on, until a cell that is not free
    obstacle_ahead_m: float  # to the nearest obstacle of the corridor; inf: none known
    free_behind_m: float
    obstacle_behind_m: float
    contact_s: float  # as it moves now, until what is not free; inf: none in sight
    allowed_ahead_mps: float
    allowed_behind_mps: float
    nearest_m: float  # from the robot's edge to the nearest obstacle anywhere; inf: none known
    bearing_rad: float  # of it, counter-clockwise from ahead
    state: int  # 0 unknown, 1 clear, 2 slow, 3 stop; others: not of this version
    causes: int  # bits: 0 obstacle, 1 ground not seen, 2 drop, 3 not to be trusted

    def allowed_mps(self, now_s: float) -> tuple[float, float]:
        """How fast the robot may go straight ahead and straight back, by the sender's judgement.

        Nothing is allowed by a stop zone older than 0.35 s, or where it says unknown.
        """
        if now_s - self.arrived_s > ZONE_STALE_S or self.state not in JUDGED:
            return 0.0, 0.0
        return self.allowed_ahead_mps, self.allowed_behind_mps

    def describe(self) -> str:
        """State and causes, to be read.

        >>> StopZone(0, 0, 0.2, 0.3, 2, 9, 9, 0, 0.8, 0.3, 0, state=3, causes=0b11).describe()
        'stop: an obstacle, ground not seen'
        """
        state = ZONE_STATES[self.state] if self.state < len(ZONE_STATES) else "unknown"
        causes = [name for bit, name in enumerate(ZONE_CAUSES) if self.causes >> bit & 1]
        return f"{state}: {', '.join(causes)}" if causes else state


def maybe_stop_zone(body: bytes, t_ms: int, arrived_s: float) -> StopZone | None:
    if len(body) != ZONE_BODY.size:
        return None
    *numbers, bearing, state, causes = ZONE_BODY.unpack(body)
    free_ahead, ahead, free_behind, behind, contact, fast_ahead, fast_behind, nearest = numbers
    return StopZone(
        t_ms, arrived_s,
        free_ahead / 1000, _thousandth(ahead), free_behind / 1000, _thousandth(behind),
        _thousandth(contact), fast_ahead / 1000, fast_behind / 1000, _thousandth(nearest),
        bearing / 10_000, state, causes,
    )  # fmt: skip


def _thousandth(number: int) -> float:
    return math.inf if number == NONE_KNOWN else number / 1000


class MapUpdate(NamedTuple):
    """A MAP frame; its operations have been walked and fit."""

    ox: int  # lowest column in the endless cell grid, modulo 65 536
    oy: int  # lowest row
    repaired: int
    runs: list[Run]


def maybe_map_geometry(body: bytes) -> int | None:
    """The `geom_id` that a MAP frame is of; None if it is too short to have one."""
    return body[6] if len(body) >= MAP_HEAD.size else None


def maybe_map_update(body: bytes, cells: int) -> MapUpdate | None:
    """Of a window of so many cells; None if the frame is to be rejected whole."""
    if len(body) < MAP_HEAD.size:
        return None
    ox, oy, repaired, _, start = MAP_HEAD.unpack_from(body)
    runs = maybe_runs(body[MAP_HEAD.size :], int.from_bytes(start, "little"), cells)
    return None if runs is None else MapUpdate(ox, oy, repaired, runs)


def maybe_runs(ops: bytes, start: int, cells: int) -> list[Run] | None:
    """(state, first cell, cell after the last) of each operation; None if they do not fit.

    >>> maybe_runs(bytes.fromhex("82 ff 22 7f 06"), 6100, 10_201)
    [(2, 6100, 6103), (3, 6103, 6201), (1, 6201, 6271)]
    """
    runs: list[Run] = []
    at, cursor, end = 0, start, len(ops)
    while at < end:
        op = ops[at]
        at += 1
        length = (op & 63) + 1
        if length == 64:
            number, size = 0, 0
            while size == 0 or ops[at - 1] & 0x80:
                if at == end or size == 3:
                    return None
                number |= (ops[at] & 0x7F) << 7 * size
                at, size = at + 1, size + 1
            length += number
        before, cursor = cursor, cursor + length
        if cursor > cells:
            return None
        runs.append((op >> 6, before, cursor))
    return runs


class Digest(NamedTuple):
    """What the window should look like now."""

    geom_id: int
    crc: int


def maybe_digest(body: bytes) -> Digest | None:
    return Digest(*DIGEST_BODY.unpack(body)) if len(body) == DIGEST_BODY.size else None


Told = Geometry | Pose | StopZone | MapUpdate | Digest
Body = Told | TilePiece | ScanPiece | ObjectsPiece | PathPiece


def maybe_body(frame: Frame, arrived_s: float, cells: int) -> Body | None:
    """What a frame says of a window of so many cells; None: of no type, or not to be read."""
    if frame.type == MAP:
        return maybe_map_update(frame.body, cells)
    if frame.type == POSE:
        return maybe_pose(frame.body, frame.t_ms, arrived_s)
    if frame.type == STOP_ZONE:
        return maybe_stop_zone(frame.body, frame.t_ms, arrived_s)
    if frame.type == OBJECTS:
        return maybe_objects_piece(frame.body, frame.t_ms)
    readers: dict[int, Callable[[bytes], Body | None]] = {
        GEOM: maybe_geometry,
        DIGEST: maybe_digest,
        TILE: maybe_tile_piece,
        SCAN: maybe_scan_piece,
        PATH: maybe_path_piece,
    }
    return readers[frame.type](frame.body) if frame.type in readers else None
