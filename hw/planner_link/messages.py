"""Frames that come from a planner: acknowledgements, questions, and what is asked of the robot.

No I/O, no clock. What is no valid frame gives `BadFrame`; nothing raises on input.
Source: planner link, sections 2, 3 and 9.
"""

import hmac
import math
import struct
import zlib
from dataclasses import dataclass, replace

from hw.device import BadFrame
from hw.planner_link import frames as planner_frames
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
ASK_GEOM, ASK_POSE, ASK_ZONE, ASK_TILE, IN_WINDOW = 1 << 0, 1 << 1, 1 << 2, 1 << 3, 1 << 7
ACK_BODY, HELLO_BODY = struct.Struct("<HIIHHBB"), struct.Struct("<IIHH")
DRIVE_BODY, ASK_BODY = struct.Struct("<IIhhHH"), struct.Struct("<HBBhhHH")
LONGEST_VALID_MS, NO_SPEED = 1000, -(2**15)
EXTERNAL_BODY = struct.Struct("<IIiihHHhHH")
NO_YAW, NO_PLACE, MOST_YAW = -(2**15), -(2**31), 31416  # 0.0001 rad
MOST_CORRELATION, OLDEST_MS = 10_000, 1000
KINDS = {ACK: "ACK", HELLO: "HELLO", DRIVE: "DRIVE", ASK: "ASK", EXTERNAL_POSE: "EXTERNAL_POSE"}


@dataclass(frozen=True, slots=True)
class Ack:
    """What a planner says of the frames that it got."""

    seq: int
    t_ms: int  # the planner's clock
    last_seq: int
    mask: int  # bit i: frame last_seq - 1 - i was accepted
    echo_t_ms: int
    hold_s: float
    bad_frames: int
    status: int
    geom_id: int


@dataclass(frozen=True, slots=True)
class Hello:
    """A planner that has just started."""

    nonce: int
    max_cells: int
    max_frame: int
    polls: bool  # nothing may be pushed at it: it asks
    seq: int = 0
    t_ms: int = 0  # the planner's clock
    signed: bool = False  # with a valid tag


@dataclass(frozen=True, slots=True)
class Ask:
    """What a planner wants to have at once."""

    id: int
    wants: int  # bits ASK_GEOM, ASK_POSE, ASK_ZONE, ASK_TILE, IN_WINDOW; one of the first four
    layer: int
    i: int  # lowest column of the rectangle, modulo 65 536
    j: int
    width: int
    height: int


@dataclass(frozen=True, slots=True)
class Drive:
    """What a commander wants the robot to do; every field lies within its range."""

    seq: int
    t_ms: int  # the commander's clock
    session: int  # of the run that it has heard
    nonce: int  # of its HELLO
    v_mps: float  # forward
    w_radps: float  # counter-clockwise
    valid_s: float  # 0: stop now


@dataclass(frozen=True, slots=True)
class External:
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


Answer = Ack | Hello | Ask | Drive | External


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
    tag = frame[end : -CRC.size]
    if secret is not None and kind != HELLO and not _is_signed(frame[:end], tag, secret):
        return BadFrame("no valid tag", frame)
    answer = _decode_body(kind, frame[HEAD.size : end], seq, t_ms)
    if isinstance(answer, Hello) and secret is not None:
        own = replace(secret, nonce=answer.nonce)
        answer = replace(answer, signed=_is_signed(frame[:end], tag, own))
    return answer or BadFrame(
        f"{KINDS[kind]} out of range" if kind in KINDS else "unknown type", frame
    )


def _is_signed(content: bytes, tag: bytes, secret: Secret) -> bool:
    """Compares in constant time; no tag is never the right one."""
    return hmac.compare_digest(secret.tag(content), tag)


def _decode_body(kind: int, body: bytes, seq: int, t_ms: int) -> Answer | None:
    match kind:
        case planner_frames.ACK if len(body) == ACK_BODY.size:
            last, mask, echo, hold, bad, status, geom_id = ACK_BODY.unpack(body)
            return Ack(seq, t_ms, last, mask, echo, hold * 1e-4, bad, status, geom_id)
        case planner_frames.HELLO if len(body) == HELLO_BODY.size:
            nonce, max_cells, max_frame, capabilities = HELLO_BODY.unpack(body)
            polls = bool(capabilities & POLL)
            return Hello(nonce, max_cells, min(max_frame, MAX_FRAME), polls, seq, t_ms)
        case planner_frames.DRIVE:
            return _maybe_drive(body, seq, t_ms)
        case planner_frames.ASK:
            return _maybe_ask(body)
        case planner_frames.EXTERNAL_POSE:
            return _maybe_external(body, seq, t_ms)
    return None


def is_kind(frame: bytes, kind: int) -> bool:
    """Whether a refused frame would have been one of that type."""
    return frame[:1] == bytes([VERSION << 4 | kind])


def _maybe_ask(body: bytes) -> Ask | None:
    """None for what asks for nothing, or for what nobody knows."""
    if len(body) != ASK_BODY.size:
        return None
    ask = Ask(*ASK_BODY.unpack(body))
    wants = ASK_GEOM | ASK_POSE | ASK_ZONE | ASK_TILE
    return ask if ask.wants & wants and not ask.wants & ~(wants | IN_WINDOW) else None


def _maybe_drive(body: bytes, seq: int, t_ms: int) -> Drive | None:
    """None unless all of it is as section 3 wants it: nothing is obeyed in part."""
    if len(body) != DRIVE_BODY.size:
        return None
    session, nonce, v_mmps, w_mradps, valid_ms, reserved = DRIVE_BODY.unpack(body)
    if NO_SPEED in (v_mmps, w_mradps) or valid_ms > LONGEST_VALID_MS or reserved or not nonce:
        return None
    return Drive(seq, t_ms, session, nonce, v_mmps / 1000, w_mradps / 1000, valid_ms / 1000)


def _maybe_external(body: bytes, seq: int, t_ms: int) -> External | None:
    """None unless all of it is as section 3 wants it: nothing is used in part."""
    if len(body) != EXTERNAL_BODY.size:
        return None
    session, nonce, x_mm, y_mm, yaw, sigma_x, sigma_y, tied, sigma_yaw, age_ms = (
        EXTERNAL_BODY.unpack(body)
    )
    has_yaw = yaw != NO_YAW
    if not nonce or NO_PLACE in (x_mm, y_mm) or not sigma_x or not sigma_y:
        return None
    if abs(tied) > MOST_CORRELATION or age_ms > OLDEST_MS:
        return None
    if has_yaw and not (-MOST_YAW <= yaw < MOST_YAW and sigma_yaw):
        return None
    return External(
        seq,
        t_ms,
        session,
        nonce,
        x_mm / 1000,
        y_mm / 1000,
        yaw / 10_000 if has_yaw else math.nan,
        sigma_x / 1000,
        sigma_y / 1000,
        tied / MOST_CORRELATION,
        sigma_yaw / 10_000,
        age_ms / 1000,
    )
