"""The settings of the maps, and of a method that has some of its own: sections of `mapod.toml`."""

from typing import Annotated, Literal

from msgspec import Meta, Struct

Method = Literal["surface", "reference_plane", "certainty"]


class Map(Struct, frozen=True, forbid_unknown_fields=True):
    """The elevation map."""

    method: Method
    cells: Annotated[int, Meta(ge=3, le=2001)]
    cell_m: Annotated[float, Meta(ge=0.005, le=1)]
    filter_heights: bool


class Certainty(Struct, frozen=True, forbid_unknown_fields=True):
    """What only method `certainty` uses: files that name another method may go without it."""

    lift_mps: Annotated[float, Meta(ge=0, le=5)]
    pitch_degps: Annotated[float, Meta(ge=0, le=360)]
    roll_degps: Annotated[float, Meta(ge=0, le=360)]
    gain: Annotated[int, Meta(ge=1, le=1000)]
    most: Annotated[int, Meta(ge=1, le=1_000_000)]
    free_from: Annotated[int, Meta(ge=1, le=1_000_000)]
    min_group: Annotated[int, Meta(ge=1, le=1000)]
    group_gap_m: Annotated[float, Meta(gt=0, le=10)]
    three_scans: bool
    three_scans_m: Annotated[float, Meta(gt=0, le=10)]
    cas: bool
    cas_certainty: Annotated[int, Meta(ge=1, le=1_000_000)]
    cas_height_m: Annotated[float, Meta(gt=0, le=2)]
    fill: bool


class ShadowFilter(Struct, frozen=True, forbid_unknown_fields=True):
    """Before which methods returns right behind an edge are taken out, and which those are."""

    methods: list[Method]
    angle_deg: Annotated[float, Meta(gt=0, lt=90)]
    beams: Annotated[int, Meta(ge=1, le=100)]


class Obstacle(Struct, frozen=True, forbid_unknown_fields=True):
    """What height makes an obstacle, and how much of the map is sent."""

    h_pos_m: Annotated[float, Meta(gt=0, le=2)]
    h_neg_m: Annotated[float, Meta(ge=-2, lt=0)]
    window_cells: Annotated[int, Meta(ge=3, le=401)]
    soft_free_below_m: Annotated[float, Meta(ge=0, le=2)]
    free_max_age_s: Annotated[float, Meta(ge=1, le=1_000_000)]


class Ground(Struct, frozen=True, forbid_unknown_fields=True):
    """When the ground itself is taken to have changed (epsilon and eta of the paper)."""

    total_pitch_deg: Annotated[float, Meta(gt=0, le=45)]
    step_pitch_deg: Annotated[float, Meta(gt=0, le=45)]
