"""What the steps from a depth image to objects take from the settings: ranges, limits, sizes."""

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
