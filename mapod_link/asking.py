"""What a receiver may send, and when: bodies of HELLO, ACK, DRIVE, EXTERNAL_POSE and ASK.

Source: planner link, section 3.
"""

import math
import struct
from dataclasses import dataclass

from mapod_link.frames import MAX_FRAME, Outbox, int16

ACK_BODY = struct.Struct("<HIIHHBB")
HELLO_BODY = struct.Struct("<IIHH")
DRIVE_BODY = struct.Struct("<IIhhHH")  # session, nonce, v, w, valid_ms, reserved
EXTERNAL_BODY = struct.Struct("<IIiihHHhHH")
UPRIGHT_BODY = struct.Struct("<iHhhH")  # z, sigma_z, pitch, roll, sigma_tilt; behind that one
ASK_BODY = struct.Struct("<HBBhhHH")  # id, what, layer, i, j, width, height
POLL = 1 << 0  # capability: push nothing, I ask
ASK_GEOM, ASK_POSE, ASK_ZONE, ASK_TILE = 1 << 0, 1 << 1, 1 << 2, 1 << 3
ASK_SCAN, ASK_OBJECTS, ASK_PATH, IN_WINDOW = 1 << 4, 1 << 5, 1 << 6, 1 << 7
NEED_GEOM, NEED_FULL, STALE, SUSPECT = 1 << 0, 1 << 1, 1 << 2, 1 << 3  # of an ACK's status
PLANNER_STOPPED, DIGEST_OK, AUTH_FAILED = 1 << 4, 1 << 5, 1 << 6
LONGEST_HOLD_S, HOLD_UNIT_S = 6.5535, 0.0001
BEYOND_ALL = 1e12  # metres or radians: no number that a frame tells; NaN is not below it either
NO_YAW, MOST_YAW, MOST_CORRELATION = -(2**15), 31_416, 10_000


@dataclass(frozen=True, slots=True)
class Upright:
    """Height and tilt of a body, as a positioning system sees them, with standard deviations."""

    z_m: float  # up, in that system's own frame
    sigma_z_m: float
    # pitch (nose down) and roll (right side down), R = Rz(yaw) Ry(pitch) Rx(roll); None: not known
    tilt_rad: tuple[float, float] | None = None
    sigma_tilt_rad: float = 0.0  # of either


@dataclass(slots=True)
class Talk:
    """What this end has said, and says next by itself."""

    outbox: Outbox
    ack_every: int  # accepted frames per ACK; 0: says nothing at all
    ack_period_s: float
    max_cells: int  # of the largest window that is taken
    unacked: int = 0  # frames accepted since the newest ACK
    acked_s: float = -math.inf
    asks: int = 0
    unheard_s: float = math.inf  # since when a question is out, and no frame has come
    hello_due_s: float = -math.inf
    hello_wanted: bool = False


@dataclass(slots=True)
class Needs:
    """What is not as it should be with the map at this end; ACKs tell of it."""

    geom: bool = False  # to be asked for
    full: bool = False  # likewise; the newest DIGEST that could be compared proves the map wrong
    digest_ok: bool = False  # that DIGEST is the map's
    auth_failed: bool = False  # the newest frame had no right tag
    too_many_cells: int = 0  # of a window that cannot be held; 0: none was announced

    def status(self, blank: bool, stale: bool, suspect: bool, stopped: bool) -> int:
        """The bits of an ACK's status; `blank`: there is no geometry."""
        needs_geom = self.geom or blank
        bits = needs_geom, self.full, stale, suspect, stopped, self.digest_ok, self.auth_failed
        return sum(bit << i for i, bit in enumerate(bits))


def hello_body(nonce: int, max_cells: int, max_frame: int = MAX_FRAME, poll: bool = False) -> bytes:
    """Body of a HELLO frame; `poll`: push nothing at me."""
    return HELLO_BODY.pack(nonce, max_cells, max_frame, POLL if poll else 0)


def ack_body(
    last_seq: int, mask: int, echo_t_ms: int, hold_s: float, bad: int, status: int, geom_id: int
) -> bytes:
    """Body of an ACK frame; `hold_s` saturates at 6.5535 s, `bad` counts modulo 65 536."""
    hold = round(min(max(hold_s, 0.0), LONGEST_HOLD_S) / HOLD_UNIT_S)
    return ACK_BODY.pack(last_seq, mask, echo_t_ms, hold, bad % 0x10000, status, geom_id)


def drive_body(session: int, nonce: int, v_mps: float, w_radps: float, valid_s: float) -> bytes:
    """Body of a DRIVE frame; ValueError: a speed or a time that it cannot tell."""
    if not all(abs(number) < BEYOND_ALL for number in (v_mps, w_radps, valid_s)):
        raise ValueError(f"no DRIVE frame tells {v_mps} m/s, {w_radps} rad/s for {valid_s} s")
    v_mmps, w_mradps, valid_ms = round(v_mps * 1000), round(w_radps * 1000), round(valid_s * 1000)
    if max(abs(v_mmps), abs(w_mradps)) > 32_767 or not 0 <= valid_ms <= 1000:
        raise ValueError(f"no DRIVE frame tells {v_mps} m/s, {w_radps} rad/s for {valid_s} s")
    return DRIVE_BODY.pack(session, nonce, v_mmps, w_mradps, valid_ms, 0)


def external_body(
    session: int,
    nonce: int,
    x_m: float,
    y_m: float,
    yaw_rad: float | None,
    *,
    sigma_x_m: float,
    sigma_y_m: float,
    sigma_yaw_rad: float = 0.0,
    correlation: float = 0.0,
    age_s: float = 0.0,
    upright: Upright | None = None,
) -> bytes:
    """Body of an EXTERNAL_POSE frame: the body's origin in the positioning system's own frame.

    That is the point on the ground under the middle of the drive axle, or what a robot without
    wheels has for it.

    Args:
        yaw_rad: counter-clockwise, of any turn; None: the system does not know it.
        sigma_x_m, sigma_y_m, sigma_yaw_rad: standard deviations; told rounded up, so as not to
            promise more than there is.
        correlation: of the errors of x and y, -1 to 1.
        age_s: how long ago the robot was there, 0 to 1 s.
        upright: height and tilt; None: the system knows neither, and the frame is the short one.

    Raises:
        ValueError: a number that the frame cannot tell.
    """
    numbers = [x_m, y_m, sigma_x_m, sigma_y_m, sigma_yaw_rad, correlation, age_s]
    if not all(abs(number) < BEYOND_ALL for number in [*numbers, yaw_rad or 0.0]):
        raise ValueError("an external pose must have finite numbers, below 1e12")
    yaw = NO_YAW if yaw_rad is None else _turned(round(yaw_rad * 10_000))
    sigmas = [_rounded_up(sigma_x_m * 1000), _rounded_up(sigma_y_m * 1000)]
    sigma_yaw = 0 if yaw_rad is None else _rounded_up(sigma_yaw_rad * 10_000)
    tied, age_ms = round(correlation * MOST_CORRELATION), round(age_s * 1000)
    if not all(1 <= sigma <= 0xFFFF for sigma in (*sigmas, sigma_yaw or int(yaw_rad is None))):
        raise ValueError("standard deviations must be above 0 and at most 65.535 m or 6.5535 rad")
    if abs(tied) > MOST_CORRELATION or not 0 <= age_ms <= 1000:
        raise ValueError("correlation must be within -1..1, age_s within 0..1")
    x_mm, y_mm = round(x_m * 1000), round(y_m * 1000)
    if max(abs(x_mm), abs(y_mm)) >= 2**31:
        raise ValueError("a position must lie within 2147 km")
    body = EXTERNAL_BODY.pack(
        session, nonce, x_mm, y_mm, yaw, *sigmas, tied, sigma_yaw, age_ms
    )  # fmt: skip
    return body if upright is None else body + _upright_body(upright)


def _upright_body(told: Upright) -> bytes:
    """What the long body has behind the short one."""
    tilt_rad = told.tilt_rad
    numbers = [told.z_m, told.sigma_z_m, told.sigma_tilt_rad, *(tilt_rad or ())]
    if not all(abs(number) < BEYOND_ALL for number in numbers):
        raise ValueError("an external pose must have finite numbers, below 1e12")
    z_mm, sigma_z = round(told.z_m * 1000), _rounded_up(told.sigma_z_m * 1000)
    sigma_tilt = 0 if tilt_rad is None else _rounded_up(told.sigma_tilt_rad * 10_000)
    if not all(1 <= sigma <= 0xFFFF for sigma in (sigma_z, sigma_tilt or int(tilt_rad is None))):
        raise ValueError("sigma_z_m must be within 0.001..65.535, sigma_tilt_rad 0.0001..6.5535")
    if abs(z_mm) >= 2**31:
        raise ValueError("a height must lie within 2147 km")
    tilt = [NO_YAW, NO_YAW]
    if tilt_rad is not None:
        tilt = [_turned(round(angle * 10_000)) for angle in tilt_rad]
    return UPRIGHT_BODY.pack(z_mm, sigma_z, *tilt, sigma_tilt)


def _turned(yaw: int) -> int:
    """0.0001 rad brought to -31 416..31 415."""
    if -MOST_YAW <= yaw < MOST_YAW:
        return yaw
    yaw_rad = math.remainder(yaw / 10_000, 2 * math.pi)
    return max(-MOST_YAW, min(MOST_YAW - 1, round(yaw_rad * 10_000)))


def _rounded_up(number: float) -> int:
    return math.ceil(round(number, 6))


def ask_body(
    ask_id: int,
    what: int,
    layer: int = 0,
    place: tuple[int, int] = (0, 0),
    shape: tuple[int, int] = (0, 0),
) -> bytes:
    """Body of an ASK frame.

    Args:
        what: ASK_GEOM, ASK_POSE, ASK_ZONE, ASK_TILE, ASK_SCAN, ASK_OBJECTS, ASK_PATH and
            IN_WINDOW, added up.
        place: lowest column and row; in the endless grid, or with IN_WINDOW in the window.
        shape: (height, width) in cells.
    """
    (i, j), (height, width) = place, shape
    return ASK_BODY.pack(ask_id % 0x10000, what, layer, int16(i), int16(j), width, height)
