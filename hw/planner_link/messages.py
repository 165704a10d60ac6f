"""Frames that come from a planner: acknowledgements, questions, and what is asked of the robot.

No I/O, no clock. What is no valid frame gives `BadFrame`; nothing raises on input.
Source: planner link, sections 2, 3 and 9.
"""

import dataclasses
import hmac
import math
import struct
import zlib
from collections.abc import Callable

from msgspec import Struct
from msgspec.structs import replace

from hw.device import BadFrame
from hw.planner_link.frames import (
    ACK,
    ASK,
    AUTH,
    CRC,
    CRC_START,
    DRIVE,
    EXTERNAL_POSE,
    HEAD,
    HELLO,
    KNOWN_FLAGS,
    MAX_FRAME,
    TAG_BYTES,
    VERSION,
    Secret,
)

NEED_GEOM, NEED_FULL, PLANNER_STOPPED = 1 << 0, 1 << 1, 1 << 4
POLL = 1 << 0  # of a HELLO's capabilities
ASK_GEOM, ASK_POSE, ASK_ZONE, ASK_TILE = 1 << 0, 1 << 1, 1 << 2, 1 << 3
ASK_SCAN, ASK_OBJECTS, ASK_PATH, IN_WINDOW = 1 << 4, 1 << 5, 1 << 6, 1 << 7
LONGEST_VALID_MS, NO_SPEED = 1000, -(2**15)
NO_YAW, NO_PLACE, MOST_YAW = -(2**15), -(2**31), 31416  # 0.0001 rad
MOST_CORRELATION, OLDEST_MS = 10_000, 1000


class Ack(Struct, frozen=True):
    """What a planner says of the frames that it got."""

    seq: int
    t_ms: int  # the planner's clock
    last_seq: int
    mask: int  # bit i: frame last_seq - 1 - i was accepted
    echo_t_ms: int
    status: int
    geom_id: int


class Hello(Struct, frozen=True):
    """A planner that has just started."""

    seq: int
    t_ms: int  # the planner's clock
    nonce: int
    max_cells: int
    max_frame: int
    polls: bool  # nothing may be pushed at it: it asks
    signed: bool = False  # with a valid tag


class Ask(Struct, frozen=True):
    """What a planner wants to have at once."""

    seq: int
    t_ms: int  # the planner's clock
    id: int
    wants: int  # bits ASK_..., one at least, and IN_WINDOW
    layer: int
    i: int  # lowest column of the rectangle, modulo 65 536
    j: int
    width: int
    height: int


class Drive(Struct, frozen=True):
    """What a commander wants the robot to do; every field lies within its range."""

    seq: int
    t_ms: int  # the commander's clock
    session: int  # of the run that it has heard
    nonce: int  # of its HELLO
    v_mps: float  # forward
    w_radps: float  # counter-clockwise
    valid_s: float  # 0: stop now


class External(Struct, frozen=True):
    """Where a positioning system saw the robot; every field lies within its range."""

    seq: int
    t_ms: int  # the sender's clock
    session: int  # of the run that it has heard
    nonce: int  # of its HELLO
    x_m: float  # in the positioning system's frame
    y_m: float
    yaw_rad: float  # NaN: it does not tell
    sigma_x_m: float  # standard deviations
    sigma_y_m: float
    correlation: float  # of x and y, -1..1
    sigma_yaw_rad: float
    age_s: float  # how long before `t_ms` the robot was there
    z_m: float = math.nan  # NaN: it does not tell
    sigma_z_m: float = 0.0
    pitch_rad: float = math.nan  # NaN: it tells neither this nor roll
    roll_rad: float = math.nan
    sigma_tilt_rad: float = 0.0


Answer = Ack | Hello | Ask | Drive | External


def apart(frame: Answer, t_ms: int, seq: int) -> tuple[int, int]:
    """How much newer a frame is than another, by clock (ms) and then by number; both wrap."""
    after_ms = (frame.t_ms - t_ms + 2**31) % 2**32 - 2**31
    return after_ms, (frame.seq - seq + 2**15) % 2**16 - 2**15


def decode_answer(frame: bytes, secret: Secret | None = None) -> Answer | BadFrame:
    """A frame that comes to the sender; with a secret, only one with the right tag.

    A HELLO needs none, for who sends it may know no session yet; it says whether it has the right
    one, with the nonce that it tells itself.
    """
    if not HEAD.size + CRC.size <= len(frame) <= MAX_FRAME:
        return BadFrame("bad length", frame)
    if CRC.unpack(frame[-4:])[0] != zlib.crc32(frame[:-4], CRC_START):
        return BadFrame("bad checksum", frame)
    first, flags, seq, t_ms = HEAD.unpack_from(frame)
    if first >> 4 != VERSION or flags & ~KNOWN_FLAGS:
        return BadFrame("unknown version or flag", frame)
    kind, end = first & 0x0F, len(frame) - CRC.size - (TAG_BYTES if flags & AUTH else 0)
    if end < HEAD.size:
        return BadFrame("bad length", frame)
    content, tag = frame[:end], frame[end : -CRC.size]
    if secret is not None and kind != HELLO and not _is_signed(content, tag, secret):
        return BadFrame("no valid tag", frame)
    if kind not in BODIES:
        return BadFrame("unknown type", frame)
    name, layouts, decode = BODIES[kind]
    body = content[HEAD.size :]
    layout = next((one for one in layouts if one.size == len(body)), None)
    answer = decode(seq, t_ms, *layout.unpack(body)) if layout is not None else None
    if isinstance(answer, Hello) and secret is not None:
        own = dataclasses.replace(secret, nonce=answer.nonce)
        answer = replace(answer, signed=_is_signed(content, tag, own))
    return answer or BadFrame(f"{name} out of range", frame)


def _is_signed(content: bytes, tag: bytes, secret: Secret) -> bool:
    """Compares in constant time; no tag is never the right one."""
    return hmac.compare_digest(secret.tag(content), tag)


def is_kind(frame: bytes, kind: int) -> bool:
    """Whether a refused frame would have been one of that type."""
    return frame[:1] == bytes([VERSION << 4 | kind])


# Bodies as their fields; None unless all of it is as section 3 wants it: nothing counts in part


def _hello(seq: int, t_ms: int, *fields: int) -> Hello:
    nonce, max_cells, max_frame, capabilities = fields
    polls = bool(capabilities & POLL)
    return Hello(seq, t_ms, nonce, max_cells, min(max_frame, MAX_FRAME), polls)


def _maybe_ask(seq: int, t_ms: int, *fields: int) -> Ask | None:
    ask = Ask(seq, t_ms, *fields)  # each bit means something, IN_WINDOW nothing alone
    return ask if ask.wants & ~IN_WINDOW else None


def _maybe_drive(seq: int, t_ms: int, *fields: int) -> Drive | None:
    session, nonce, v_mmps, w_mradps, valid_ms, reserved = fields
    if NO_SPEED in (v_mmps, w_mradps) or valid_ms > LONGEST_VALID_MS or reserved or not nonce:
        return None
    return Drive(seq, t_ms, session, nonce, v_mmps / 1000, w_mradps / 1000, valid_ms / 1000)


def _maybe_external(seq: int, t_ms: int, *fields: int) -> External | None:
    session, nonce, x_mm, y_mm, yaw, sigma_x, sigma_y, tied, sigma_yaw, age_ms = fields[:10]
    has_yaw = yaw != NO_YAW
    if not nonce or NO_PLACE in (x_mm, y_mm) or not sigma_x or not sigma_y:
        return None
    if abs(tied) > MOST_CORRELATION or age_ms > OLDEST_MS:
        return None
    if has_yaw and not (-MOST_YAW <= yaw < MOST_YAW and sigma_yaw):
        return None
    upright = _maybe_upright(*fields[10:]) if fields[10:] else ()
    if upright is None:
        return None
    return External(
        *(seq, t_ms, session, nonce, x_mm / 1000, y_mm / 1000),
        yaw / 10_000 if has_yaw else math.nan,
        *(sigma_x / 1000, sigma_y / 1000, tied / MOST_CORRELATION),
        *(sigma_yaw / 10_000, age_ms / 1000),
        *upright,
    )


def _maybe_upright(
    z_mm: int, sigma_z: int, pitch: int, roll: int, sigma_tilt: int
) -> tuple[float, ...] | None:
    """Height and tilt, of a long EXTERNAL_POSE."""
    has_tilt = (pitch, roll) != (NO_YAW, NO_YAW)
    if z_mm == NO_PLACE or not sigma_z:
        return None
    if has_tilt and not (all(-MOST_YAW <= a < MOST_YAW for a in (pitch, roll)) and sigma_tilt):
        return None
    tilt = (pitch / 10_000, roll / 10_000) if has_tilt else (math.nan, math.nan)
    return z_mm / 1000, sigma_z / 1000, *tilt, sigma_tilt / 10_000


Layouts = tuple[struct.Struct, ...]  # of which a body's length picks one
BODIES: dict[int, tuple[str, Layouts, Callable[..., Answer | None]]] = {
    ACK: ("ACK", (struct.Struct("<HII4xBB"),), Ack),  # 4x: hold, bad_frames
    HELLO: ("HELLO", (struct.Struct("<IIHH"),), _hello),
    DRIVE: ("DRIVE", (struct.Struct("<IIhhHH"),), _maybe_drive),
    ASK: ("ASK", (struct.Struct("<HBBhhHH"),), _maybe_ask),
    EXTERNAL_POSE: (
        "EXTERNAL_POSE",
        (struct.Struct("<IIiihHHhHH"), struct.Struct("<IIiihHHhHHiHhhH")),
        _maybe_external,
    ),
}
