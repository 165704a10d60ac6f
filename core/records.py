"""What the rooms hand to each other: SI units, host clock, no behaviour.

Structs, which C code makes: as dataclasses, those of one tick took a twentieth of its time.

Source: design, sections 2, 4 and 5.
"""

import math

import numpy as np
import numpy.typing as npt
from msgspec import Struct

F64 = npt.NDArray[np.float64]
F32 = npt.NDArray[np.float32]
U16 = npt.NDArray[np.uint16]
I8 = npt.NDArray[np.int8]
U8 = npt.NDArray[np.uint8]
I32 = npt.NDArray[np.int32]
I64 = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

OBSTACLE, UNKNOWN, FREE = 1, 0, -1  # what a cell of the obstacle map means (int8)


class Scan(Struct, frozen=True, eq=False):
    """One sweep of the laser.

    Beam i left at t_s + i * beam_dt_s, at bearing first_rad + i * step_rad, counter-clockwise from
    sensor +x (straight ahead).
    """

    t_s: float  # host monotonic clock, beam 0
    beam_dt_s: float
    first_rad: float
    step_rad: float
    ranges_m: F64  # (echoes, n); NaN: no measurement
    counter: int  # the scanner's own, 0..65535
    arrived_s: float  # host clock, when its last byte was read


class PointSweep(Struct, frozen=True, eq=False):
    """Rays of one sweep in any order of directions: several planes, a stripe, a depth image.

    Ray i left origins[i] along directions[i] at times_s[i], sensor frame. Neighbours in the arrays
    are neighbours in space.
    """

    origins: F64  # (n, 3) metres
    directions: F64  # (n, 3) unit vectors
    ranges_m: F64  # (echoes, n); NaN: no measurement
    times_s: F64  # (n,) host monotonic clock; the first is the earliest, the last the latest
    counter: int  # the sensor's own
    arrived_s: float  # host clock, when its last byte was read


class DepthCamera(Struct, frozen=True, eq=False):
    """What turns the numbers of a depth image into points: point = offset_m + number * ray.

    Sensor frame: x along the optical axis, y left, z up. A ray has the device's unit, its lens's
    distortion and its kind of depth (along the ray, or along the axis) in it.
    """

    rays: F32  # (rows, columns, 3) metres per unit of the image's numbers
    offset_m: tuple[float, float, float]


class DepthImage(Struct, frozen=True, eq=False):
    """One frame of a depth camera: a number for each pixel, row by row from the top left."""

    t_s: float  # host monotonic clock, the middle of its exposure
    numbers: U16  # (rows, columns); 0: no measurement, or one that the device itself doubts
    camera: DepthCamera  # the same object from frame to frame, until the device tells another
    counter: int  # the device's own
    arrived_s: float  # host clock, when its last byte was read


class SweepPoints(Struct, frozen=True, eq=False):
    """What one sweep met, map frame."""

    t_s: float  # host monotonic clock, of its last beam
    lens_m: tuple[float, float, float]  # where that beam began
    points_m: F64  # (k, 3), beam by beam; some of the returns where there are too many
    returns: int  # that it had


class ScannerSpec(Struct, frozen=True, eq=False):
    """What a scanner can do, as its settings have it: known before it has sent a byte."""

    period_s: float  # from one sweep to the next
    max_beams: int  # rays of a sweep, at most
    max_range_m: float
    echoes: int  # ranges of a ray, at most
    sigma_m: float  # 1 sigma of a range, near
    sigma_share: float  # and as a share of it, far: the larger of both
    is_plane: bool  # its sweeps are `Scan`s
    directions: F64  # (n, 3) unit vectors, sensor frame: where it looks
    # unit, sensor frame, of the plane across its way in which all that it meets lies, if any
    light_normal: tuple[float, float, float] | None = None


class Attitude(Struct, frozen=True, eq=False):
    """Orientation and rate of turn of the attitude sensor's case, and what it feels."""

    t_s: float  # host monotonic clock, of the sampling instant
    q_earth_sensor: tuple[float, float, float, float]  # w x y z, unit; earth frame has z up
    rate_radps: tuple[float, float, float]  # about sensor x, y, z; NaN where not delivered
    magnetic: tuple[float, float, float] | None = None  # sensor x, y, z; 1: field at calibration
    accel_mps2: tuple[float, float, float] | None = None  # sensor x, y, z, with gravity: up at rest


class WheelCounts(Struct, frozen=True, eq=False):
    """Encoder counters of both wheels at one common instant, since an arbitrary zero."""

    t_s: float  # host monotonic clock
    left: float  # counts (quadrature edges), forward positive; unwrapped, interpolated to t_s
    right: float
    restarts: int  # grows when the zero was lost: travel across such a step is not known
    unpowered_s: float = math.inf  # motors had no power before the newest since then; inf: unknown
    cut_off: bool = False  # the controller says that it gives the motors no power, told or not


class ObstacleMap(Struct, frozen=True, eq=False):
    """The obstacle map as it stands: a ring of tri-state cells, aligned with the map frame.

    World cell (i, j) covers x in [i, i + 1) * cell_m and y in [j, j + 1) * cell_m of the map frame
    and lives at cells[j % size, i % size] while corner <= (i, j) < corner + size.
    """

    cells: I8  # (size, size): OBSTACLE, UNKNOWN or FREE
    corner_i: int
    corner_j: int
    # (k,) flat indices (row * size + column) into cells, changed since the last link tick
    changed: I32
    epoch: int  # grows when the whole map was erased: nothing told before holds any more
    # False: no FREE of it may be told, for an input is stale or the pose is not known
    trusted: bool


class PoseReport(Struct, frozen=True, eq=False):
    """Pose, motion and health for the planner; frame map, SI."""

    x_m: float
    y_m: float
    yaw_rad: float  # counter-clockwise, -pi..pi
    pitch_rad: float  # nose down positive
    roll_rad: float  # right side down positive
    v_mps: float
    w_radps: float
    health: int  # bits of planner-link section 3
    age_scan_s: float  # inf: never
    age_ahrs_s: float
    age_enc_s: float
    mode: int  # 0 booting, 1 running, 2 degraded, 3 fault, 4 replayed


class DriveRequest(Struct, frozen=True):
    """What a commander wants the robot to do, and for how long that holds."""

    v_mps: float  # forward
    w_radps: float  # counter-clockwise
    valid_until_s: float  # host clock: after it the request means nothing


class ExternalPose(Struct, frozen=True):
    """Where a positioning system says that the body is, in that system's own frame."""

    t_s: float  # host monotonic clock: when it was there
    x_m: float
    y_m: float
    yaw_rad: float  # counter-clockwise; NaN: it does not tell
    var_xx_m2: float
    var_xy_m2: float
    var_yy_m2: float
    var_yaw_rad2: float  # of no meaning without a yaw
    z_m: float = math.nan  # up; NaN: it does not tell
    var_z_m2: float = 0.0  # of no meaning without a height
    pitch_rad: float = math.nan  # nose down positive; NaN: it tells neither this nor roll
    roll_rad: float = math.nan  # right side down positive
    sigma_tilt_rad: float = 0.0  # of either


class StopZoneReport(Struct, frozen=True):
    """What stands before and behind the robot, and how fast it may go."""

    free_ahead_m: float  # straight ahead until a cell that is not free; 0 when nothing is known
    obstacle_ahead_m: float  # to the nearest obstacle of that corridor; inf: none is known
    free_behind_m: float
    obstacle_behind_m: float
    contact_s: float  # until it meets what is not free, as it moves now; inf: none in sight
    allowed_ahead_mps: float
    allowed_behind_mps: float
    nearest_m: float  # from the robot's edge to the nearest obstacle anywhere; inf: none is known
    bearing_rad: float  # of that one's middle from the axle's, counter-clockwise from ahead
    # 8 of 45 degrees, ahead first, counter-clockwise: from the axle; none where nobody reads them
    sectors_m: tuple[float, ...]
    state: int  # 0 unknown, 1 clear, 2 slow, 3 stop
    causes: int  # bits: 0 obstacle, 1 unseen ground, 2 drop, 3 map or pose not to be trusted


OBJECT_STATIC, OBJECT_MOVED, OBJECT_MOVING = 1, 2, 3  # kinds: never moved, has moved, moves now
OBJECT_WALL = 4  # a piece of a wall, from door to door


class ObjectReport(Struct, frozen=True, eq=False):
    """One object of the vector map, map frame."""

    id: int  # 0 to 2^32 - 1; never that of another object in one run
    kind: int  # OBJECT_...
    outline_m: F64  # (n, 2) corners of a simple polygon, counter-clockwise, the first not repeated
    bottom_m: float  # above the floor
    top_m: float
    velocity_mps: tuple[float, float]  # along map x and y; (0, 0) unless it moves
    confidence: float  # 0 to 1: that it is there
    seen_s: float  # host monotonic clock, when it was last seen
    enlarged: bool = False  # the outline contains the object's own, which has more corners


class ObjectChanges(Struct, frozen=True, eq=False):
    """What became of the objects since an older version of their map."""

    changed: tuple[ObjectReport, ...]  # new ones, and those of which something is different
    gone: tuple[int, ...]  # ids


class StandingThing(Struct, frozen=True, eq=False):
    """One object of the map; map frame, metres."""

    outline_m: F64  # (n, 2) counter-clockwise
    seen: Flags  # (n,) side k, from corner k on, was seen along its whole length


class PassingThing(Struct, frozen=True, eq=False):
    """What no map holds yet, or moves; map frame, metres."""

    id: int  # never that of another one in one map
    outline_m: F64  # (n, 2)
    is_moving: bool  # it was seen to move; False: it is new, and may stay
    is_seen: bool  # in this frame


class FloorView(Struct, frozen=True, eq=False):
    """What one frame of a depth camera tells who plans on the floor; map frame, metres."""

    view_m: F64  # (n, 2) outline of the floor that was seen; nothing is said of what lies outside
    passing: tuple[PassingThing, ...]
    standing: tuple[StandingThing, ...] | None  # all objects of the map; None: they are as before,
    walls_m: F64  # (m, 4) and so are its walls: x1, y1, x2, y2


class PathSegment(Struct, frozen=True, eq=False):
    """A part of a path that is driven for one purpose."""

    sweeps: bool  # the tool works; else the robot only travels
    points_m: F64  # (n, 2), map frame, in the order of driving


class PathReport(Struct, frozen=True, eq=False):
    """What the robot is to drive along; no segments: there is no path."""

    version: int  # another one with each change of the segments
    segments: tuple[PathSegment, ...]
    ahead: int | None  # the point, counted through all segments, that it drives to; None: to none
