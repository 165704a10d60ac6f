"""What tells where the body is, whatever its source: the face that mapping and driving see."""

from typing import Protocol

from msgspec import Struct

from core.motion.path import Place
from core.motion.shift import Shift
from core.pose_fix import PoseFix
from core.records import F64, ExternalPose, WheelCounts


class Pose(Struct, frozen=True):
    """The body in the map frame at one instant."""

    t_s: float
    x_m: float
    y_m: float
    yaw_rad: float
    pitch_rad: float
    roll_rad: float


class Track(Protocol):
    """Pose at a time, or none. Where `breaks` grows, earlier places have no relation to later."""

    yaw_start_rad: float  # of the body in the earth frame where the map's x axis points
    v_mps: float  # ahead
    w_radps: float  # counter-clockwise
    breaks: int
    broken_by: str  # why it broke last, in words
    maybe_shift: Shift | None  # how far it is off since the newest break; None: nobody knows
    corrected_m: F64  # (2,) sum of the corrections that went into the place, map frame

    @property
    def started(self) -> bool:
        """Whether there has been a place."""

    @property
    def newest_s(self) -> float:
        """Time of the newest position that is measured; -inf when there is none."""

    @property
    def covariance(self) -> F64:
        """Of the newest x (m), y (m), yaw (rad), map frame: (3, 3), since the newest break."""

    @property
    def outliers(self) -> int:
        """External poses that did not fit."""

    @property
    def travel_m(self) -> float:
        """Signed way along the body's x axis since the start."""

    @property
    def waits(self) -> bool:
        """Whether measurements wait for their attitudes."""

    def start_at(self, xyz_m: F64, yaw_rad: float, travel_m: float) -> None:
        """Before anything has come: where (3,) the body stands in a map frame that goes on."""

    def add(self, counts: WheelCounts) -> None:
        """Take one pair of counts."""

    def add_external(self, pose: ExternalPose) -> bool:
        """Take a pose of a positioning system; False if it can't be true, or is no newer one."""

    def correct_slip(self, along: tuple[float, float], slipped_m: float) -> None:
        """The scans say that the place has newly run so far ahead, along a unit vector, map."""

    @property
    def owed(self) -> F64:
        """By what (3,) the told x, y (m) and yaw (rad) are still to be corrected, map frame."""

    def correct_by(self, fix: PoseFix, at_s: float) -> bool:
        """What stands says how far the told pose of an instant is off; whether it is believed."""

    def settle(self) -> None:
        """Use what has come, as far as attitudes have arrived for it."""

    def break_off(self, why: str) -> None:
        """What was mapped up to now is not believed any more: go on from the same place."""

    def covers(self, from_s: float, to_s: float) -> bool:
        """True if the position is known, or well continued, from..to."""

    def xy_at(self, at_s: float) -> F64:
        """Position (2,) in the map frame at a covered instant."""

    def place_at(self, at_s: float) -> Place:
        """Position (map frame) and travel at a covered instant."""

    def maybe_pose(self, at_s: float) -> Pose | None:
        """Position at `at_s`, attitude the newest there is before it; None where not known."""
