"""The settings of the map of objects, and of the quick look at it: sections of `mapod.toml`."""

from typing import Annotated

from msgspec import Meta, Struct


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
    def guard_m(self) -> float:
        """Beyond a surface by so much is beyond it for any pose (3 sigma)."""
        return 3.0 * self.pose_sigma_m + self.view_gap_m


class QuickCheckSettings(Struct, frozen=True, forbid_unknown_fields=True):
    """The quick look: some rays of a frame against the map, instead of the whole frame."""

    rays: Annotated[int, Meta(ge=50, le=200)]
    max_range_m: Annotated[float, Meta(gt=0, le=100)]  # nothing is expected or compared beyond
    tolerance_m: Annotated[float, Meta(gt=0, le=1)]  # a range may differ so much
    most_unknown: Annotated[float, Meta(ge=0, le=1)]  # share of rays without a measurement
    every_frames: Annotated[int, Meta(ge=1, le=1000)]  # a whole frame at least so often
