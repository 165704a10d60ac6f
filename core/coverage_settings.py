"""The settings of a machine that sweeps floors: a section of `mapod.toml`.

They stand apart from `core.paths`, which a robot that sweeps nothing does not load.
"""

import math
from typing import Annotated

from msgspec import Meta, Struct

from core.run_settings import Robot

Place = Annotated[float, Meta(ge=-1000, le=1000)]


class CoverageSettings(Struct, frozen=True, forbid_unknown_fields=True):
    """What is planned, and for which machine: a disc that turns on the spot, with a tool."""

    plan: bool  # False: nothing is planned
    radius_m: Annotated[float, Meta(gt=0, le=5)]  # of the circle round all of it, about its axle
    clearance_m: Annotated[float, Meta(ge=0, le=1)]  # kept from what stands, besides
    width_m: Annotated[float, Meta(ge=0.05, le=10)]  # of the band that the tool sweeps
    overlap_m: Annotated[float, Meta(ge=0, le=5)]  # of neighbouring bands
    dock_x_m: Place  # map frame: from there it sets out, and there it ends
    dock_y_m: Place
    dock_yaw_deg: Annotated[float, Meta(ge=-180, le=180)]
    cell_m: Annotated[float, Meta(ge=0.01, le=0.2)]  # of seen and of clean floor
    size_m: Annotated[float, Meta(ge=2, le=100)]  # edge of the square around the dock, at most
    seen_frames: Annotated[int, Meta(ge=1, le=12)]  # so often floor must be seen to be free
    guard_m: Annotated[float, Meta(ge=0, le=0.5)]  # kept from the outlines of things
    explained_m: Annotated[float, Meta(ge=0, le=2)]  # unseen floor so near to a thing is let be
    sliver_m: Annotated[float, Meta(ge=0, le=1)]  # what is left unswept and narrower gets no lane
    enough: Annotated[float, Meta(ge=0, le=0.5)]  # share of the floor that may be left at the end
    enough_lively: Annotated[float, Meta(ge=0, le=0.5)]  # the same where people are about
    rounds: Annotated[int, Meta(ge=1, le=100)]  # plans for what is left, at most
    tries: Annotated[int, Meta(ge=1, le=1000)]  # plans in a row that win no floor, then it gives up
    wait_s: Annotated[float, Meta(ge=0.5, le=60)]  # barred for so long: a plan anew

    def __post_init__(self) -> None:
        if self.overlap_m > 0.8 * self.width_m:
            raise ValueError(
                f"overlap_m: must be at most 0.8 of width_m = {self.width_m:g}, "
                f"is {self.overlap_m:g}"
            )


def fault_of(coverage: CoverageSettings | None, robot: Robot, has_camera: bool) -> str:
    """Why nothing can be planned for such a robot, the key first; "": it can, or need not."""
    if coverage is None or not coverage.plan:
        return ""
    if not has_camera:
        return "plan: must be false without a depth camera ([depth]), which sees the floor; is true"
    corner_m = math.hypot(max(robot.front_m, robot.rear_m), robot.width_m / 2)
    if coverage.radius_m < corner_m:
        return (
            f"radius_m: must be at least {corner_m:.4f}, to the farthest corner of the footprint "
            f"(robot.front_m, rear_m, width_m), is {coverage.radius_m}"
        )
    return ""
