"""The settings of a depth camera's objects and of their map: sections of `mapod.toml`.

They stand apart from `core.objects`, which a robot without such a camera does not load.
"""

from typing import Annotated

from msgspec import Meta, Struct

Length = Annotated[float, Meta(ge=0.002, le=1)]


class FrameSettings(Struct, frozen=True, forbid_unknown_fields=True):
    """Of all steps of a frame. Sigmas are one standard deviation of one pixel's range.

    That of a range r is noise_m + noise_per_m2 * r^2. Heights are above the floor.
    """

    min_range_m: Annotated[float, Meta(ge=0, le=5)]
    max_range_m: Annotated[float, Meta(ge=0.5, le=20)]
    noise_m: Annotated[float, Meta(gt=0, le=0.1)]
    noise_per_m2: Annotated[float, Meta(ge=0, le=0.05)]
    top_m: Annotated[float, Meta(ge=0.05, le=10)]  # what is higher does not meet the robot
    floor_m: Length  # a pixel this high at least is no floor, however small its noise
    low_m: Length  # so much a patch of floor must rise to be told: carpets, sills
    pit_m: Length  # so far below the floor, floor is missing
    flying_deg: Annotated[float, Meta(ge=0, le=20)]  # less than this to the ray: a flying pixel
    voxel_m: Annotated[float, Meta(ge=0.005, le=0.2)]
    cluster_m: Annotated[float, Meta(ge=0.01, le=0.5)]  # nearer points are one object
    least_m: Length  # edge of the smallest square that counts as an object
    hull_m: Annotated[float, Meta(ge=0.002, le=0.2)]  # how far points may lie outside a polygon
    wall_m: Length  # how far points of a wall may lie off it
    wall_length_m: Annotated[float, Meta(ge=0.2, le=20)]  # upright planes this long are walls
    wall_height_m: Annotated[float, Meta(ge=0.1, le=5)]  # and so much of their height is seen
    summit_m: Length  # two summits, parted by a valley so deep, are two upright things


class ObjectMapSettings(Struct, frozen=True, forbid_unknown_fields=True):
    """What the map of objects believes of a frame, and for how long."""

    cell_m: Annotated[float, Meta(ge=0.005, le=0.1)]  # of an object's distance field
    band_m: Annotated[float, Meta(ge=0.02, le=0.5)]  # distances of the field end there
    confirm_frames: Annotated[int, Meta(ge=2, le=100)]  # seen so often: in the map
    gone_frames: Annotated[int, Meta(ge=2, le=300)]  # seen through so often: out of it
    memory_frames: Annotated[int, Meta(ge=2, le=1000)]  # a mean is over so many
    pose_sigma_m: Annotated[float, Meta(gt=0, le=0.5)]  # 1 sigma of a frame's x and of its y
    pose_sigma_deg: Annotated[float, Meta(gt=0, le=20)]  # and of its yaw
    hull_sigma_m: Annotated[float, Meta(gt=0, le=0.2)]  # 1 sigma of a hull's side
    view_gap_m: Annotated[float, Meta(ge=0, le=0.3)]  # the view may end so far before a surface
    least_size_m: Annotated[float, Meta(gt=0, le=1)]  # what is smaller never enters the map
    through_share: Annotated[float, Meta(gt=0, lt=1)]  # more of it seen through: it has moved
    person_height_m: Annotated[float, Meta(gt=0, le=3)]  # at least so tall
    person_width_m: Annotated[float, Meta(gt=0, le=3)]  # and at most so wide: may be a person
    person_wait_s: Annotated[float, Meta(ge=0, le=100_000)]  # stands still so long: a thing
    coast_s: Annotated[float, Meta(ge=0, le=60)]  # a moving obstacle is told so long unseen
    track_sigma_m: Annotated[float, Meta(gt=0, le=1)]  # 1 sigma of where a moving hull's middle is
    acceleration_mps2: Annotated[float, Meta(gt=0, le=50)]  # 1 sigma of what moves
    speed_sigma_mps: Annotated[float, Meta(gt=0, le=10)]  # a velocity is told when it is so good
    wall_cell_m: Annotated[float, Meta(ge=0.01, le=0.5)]  # a wall is judged in pieces so long
    wall_angle_deg: Annotated[float, Meta(gt=0, le=45)]  # segments are of one wall up to there
    publish_m: Annotated[float, Meta(ge=0, le=0.5)]  # smaller changes of a shape are not told
    active_objects: Annotated[int, Meta(ge=1, le=100_000)]  # so many keep their distance field

    @property
    def drain(self) -> float:
        """Frames that one contradiction takes from a settled cell: none is left after gone_frames.

        Left are fewer than confirm, which count for nothing.
        """
        return max(1.0, (self.memory_frames - self.confirm_frames) / self.gone_frames)

    @property
    def contradiction_m(self) -> float:
        """A side that is off by more than this is none of the same place (2 sigma)."""
        return min(self.band_m, 2.0 * self.pose_sigma_m)

    @property
    def guard_m(self) -> float:
        """Beyond a surface by so much is beyond it for any pose (3 sigma)."""
        return 3.0 * self.pose_sigma_m + self.view_gap_m
