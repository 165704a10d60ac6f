"""What a coverage plan is made for, and what it consists of. Metres, radians."""

from dataclasses import dataclass
from typing import Literal

from shapely import MultiPolygon

from core.records import F64

Kind = Literal["sweep", "travel"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Machine:
    """A round machine that turns on the spot, with a tool in its middle."""

    radius_m: float  # of the circle round all of it, about the point it turns about
    clearance_m: float  # kept from walls and obstacles, besides
    width_m: float  # of the band that the tool sweeps
    overlap_m: float  # of neighbouring bands

    def __post_init__(self) -> None:
        """Raises ValueError: what was given, and what is allowed."""
        for name in ("radius_m", "clearance_m", "overlap_m"):
            value = getattr(self, name)
            if not 0 <= value < 100:
                raise ValueError(f"{name}: must be from 0 to 100, is {value:g}")
        if not 0.01 <= self.width_m <= 100:
            raise ValueError(f"width_m: must be from 0.01 to 100, is {self.width_m:g}")
        if self.overlap_m > 0.8 * self.width_m:
            raise ValueError(
                f"overlap_m: must be at most 0.8 of width_m {self.width_m:g}, is {self.overlap_m:g}"
            )

    @property
    def spacing_m(self) -> float:
        """From lane to lane."""
        return self.width_m - self.overlap_m

    @property
    def margin_m(self) -> float:
        """From the machine's centre to walls, at least."""
        return self.radius_m + self.clearance_m


@dataclass(frozen=True, slots=True, eq=False)
class Segment:
    """A stretch of the path that is driven in one mode."""

    kind: Kind  # sweep: the tool works; travel: it need not
    points: F64  # (n, 2), n at least 2


@dataclass(frozen=True, slots=True, eq=False)
class CoveragePlan:
    """A path that sweeps a floor. Each segment begins where the one before ends."""

    segments: tuple[Segment, ...]
    space: MultiPolygon  # where the machine's centre may be, of the part that it can get to
    reachable: MultiPolygon  # floor that the tool can get to
    covered: MultiPolygon  # of it: what the tool sweeps, or what was clean before
    uncovered: MultiPolygon  # reachable and not swept
    unreachable: MultiPolygon  # floor that the tool cannot get to
    angle_rad: float  # of the lanes
