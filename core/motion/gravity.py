"""Whether the force that the attitude sensor feels stands upright, as the told orientation has it.

With R the told orientation, f what the accelerometer tells along the body's axes, and V the
sensor's velocity, the level part of a mean over any span t is

    | sum of (R f) dt |  =  | V_end - V_begin + g t tilt error |  <=  most_mps + g t SHEET_RAD

where nothing is wrong: however the robot brakes, turns, jolts or slips, it gets no faster than it
is, so that what motion can explain gets less as the span gets longer. Spans of whole BLOCK_S up to
SPAN_S that end now are looked at, each against its own bound. Beyond it the attitude is doubted,
until a span of SPAN_S that began anew holds nothing beyond any bound.
Source: MTi sheet, sections 4 and 7; docs/motion.md, section 2, "Gravity".
"""

import math

import numpy as np

from core.geometry import R_from_rpy, Vector, matrix_of
from core.motion.attitude import KEPT, AttitudeRing, in_body
from core.motion.lean import GRAVITY_MPS2
from core.records import F64
from jit import Record, Records, kernel, records

SHEET_RAD = math.radians(1.5)  # told tilt and accelerometer, five sigmas of 0.3 degrees
SWAY_MPS = 0.3  # by so much a body that nods changes the velocity of the sensor upon it
BLOCK_S, BLOCKS = 0.5, 20  # spans are made of these, so many at most:
SPAN_S = BLOCK_S * BLOCKS  # the longest
LONGEST_S = 0.15  # between two samples; after a longer gap spans begin anew
MOST_MPS2 = 250.0  # no such device feels more: 180 is the largest full scale, along each axis
WHY = "attitude and gravity contradict each other"
WHY_AGAIN = "attitude and gravity agree again"

GRAVITY = np.dtype(
    [
        ("doubted", np.bool_),
        ("ratio", np.float64),  # of what was felt over its bound, the greatest span's, at last look
        ("t_s", np.float64),  # of the newest sample that told a force: its level part, earth's axes
        ("force_mps2", np.float64, 2),
        ("sum_mps", np.float64, 2),  # of that, in the block that is not full yet,
        ("passed_s", np.float64),  # and how long that is
        ("sums_mps", np.float64, (BLOCKS, 2)),  # the same of the full ones, a ring
        ("lasted_s", np.float64, BLOCKS),
        ("blocks", np.int64),  # full ones since spans began anew
    ],
    align=True,
)


@kernel
def _look(of: Record, most_mps: float) -> None:
    """A block is full: hold each span that ends with it against its bound."""
    newest = of.blocks % BLOCKS
    of.lasted_s[newest], of.passed_s, of.ratio = of.passed_s, 0.0, 0.0
    for k in range(2):
        of.sums_mps[newest, k], of.sum_mps[k] = of.sum_mps[k], 0.0
    of.blocks += 1
    x, y, span_s = 0.0, 0.0, 0.0
    for n in range(min(of.blocks, BLOCKS)):
        place = (of.blocks - 1 - n) % BLOCKS
        x, y = x + of.sums_mps[place, 0], y + of.sums_mps[place, 1]
        span_s += of.lasted_s[place]
        bound_mps = most_mps + GRAVITY_MPS2 * SHEET_RAD * span_s
        of.ratio = max(of.ratio, math.sqrt(x * x + y * y) / bound_mps)
    if of.ratio > 1.0:
        of.doubted, of.blocks = True, 0
    elif of.blocks >= BLOCKS:
        of.doubted = False


@kernel
def _take(
    all_of: Records,
    q_earth_body: F64,
    newest: int,
    t_s: float,
    felt: Vector,
    R_body_sensor: F64,
    most_mps: float,
) -> bool:
    """One sample, whose told orientation is the ring's newest; whether the attitude is doubted."""
    of, (x, y, z) = all_of[0], felt
    if not (abs(x) <= MOST_MPS2 and abs(y) <= MOST_MPS2 and abs(z) <= MOST_MPS2):
        return bool(of.doubted)  # as if it had not been delivered
    q, (bx, by, bz) = q_earth_body[newest], in_body(felt, R_body_sensor)
    R, dt_s = matrix_of((q[0], q[1], q[2], q[3])), t_s - of.t_s
    is_next = dt_s <= LONGEST_S
    if not is_next:
        of.blocks, of.passed_s = 0, 0.0
    for k in range(2):
        level_mps2 = R[k][0] * bx + R[k][1] * by + R[k][2] * bz
        step_mps = 0.5 * dt_s * (level_mps2 + of.force_mps2[k]) if is_next else 0.0
        of.sum_mps[k] = of.sum_mps[k] + step_mps if is_next else 0.0
        of.force_mps2[k] = level_mps2
    of.passed_s += dt_s if is_next else 0.0
    of.t_s = t_s
    if of.passed_s >= BLOCK_S - 0.5 * dt_s:
        _look(of, most_mps)
    return bool(of.doubted)


class GravityCheck:
    """Compares what the attitude sensor feels with what is told of its orientation.

    Args:
        max_speed_mps: of the robot, either way.
        mount_rpy_rad: roll, pitch and yaw of the sensor on the body.
    """

    def __init__(self, max_speed_mps: float, mount_rpy_rad: tuple[float, float, float]) -> None:
        self.record = records(GRAVITY)
        self.record["t_s"] = -math.inf
        self._R_body_sensor = R_from_rpy(*mount_rpy_rad)
        self._most_mps = 2.0 * max_speed_mps + SWAY_MPS
        self.doubted = False  # the told attitude is not to be believed just now
        self.changes = 0  # how often that began or ended

    @property
    def times(self) -> int:
        """How often the attitude was doubted."""
        return (self.changes + 1) // 2

    @property
    def ratio(self) -> float:
        """Of the newest look: what was felt over its bound, the greatest of all spans."""
        return float(self.record["ratio"][0])

    def take(self, t_s: float, felt: Vector, attitudes: AttitudeRing) -> None:
        """One sample that `attitudes` has just taken.

        felt: (3,) m/s2 along the sensor's axes, with gravity: upwards at rest.
        """
        newest = (attitudes.start + attitudes.count - 1) % KEPT
        doubted = _take(
            self.record,
            attitudes.q_earth_body,
            newest,
            t_s,
            felt,
            self._R_body_sensor,
            self._most_mps,
        )
        self.changes += doubted != self.doubted
        self.doubted = doubted
