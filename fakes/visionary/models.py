"""The cameras that the fake can be. Source: visionary sheet, sections 1, 4 and 5."""

from typing import Literal, NamedTuple

Model = Literal["t_mini", "s", "t"]


class Kind(NamedTuple):
    """What one model is and how it sends."""

    ident: str
    version: str
    is_cola_2: bool  # else it speaks CoLa-B
    control_port: int
    size_px: tuple[int, int]  # columns, rows
    focal_px: tuple[float, float]
    centre_px: tuple[float, float]
    distortion: tuple[float, float]  # K1, K2
    away_mm: float  # of its front before its lens
    root: str  # of the depth set
    is_planar: bool  # depths along the axis
    unit_mm: float
    exponent: int  # that it tells of its depths
    colour_bytes: int  # of a pixel of the second map
    has_states: bool  # the third map: 0 is good; else the higher the better
    has_period: bool  # it can be set


KINDS: dict[str, Kind] = {
    "t_mini": Kind(
        ident="Visionary-T Mini CX V3S105-1x",
        version="3.0.0.2334",
        is_cola_2=True,
        control_port=2122,
        size_px=(512, 424),
        focal_px=(-366.964999, -367.057999),
        centre_px=(252.118999, 205.213999),
        distortion=(-0.07605, 0.217518),
        away_mm=10.0,
        root="DataSetDepthMap",
        is_planar=False,
        unit_mm=0.25,
        exponent=0,
        colour_bytes=2,
        has_states=True,
        has_period=True,
    ),
    "s": Kind(
        ident="Visionary-S CX V3S102-1x",
        version="5.1.0.2271",
        is_cola_2=False,
        control_port=2112,
        size_px=(640, 512),
        focal_px=(-455.0, -455.0),
        centre_px=(319.5, 255.5),
        distortion=(0.0, 0.0),
        away_mm=15.0,
        root="DataSetStereo",
        is_planar=True,
        unit_mm=0.1,
        exponent=-1,
        colour_bytes=4,
        has_states=True,
        has_period=False,
    ),
    "t": Kind(
        ident="Visionary-T CX V3S100-1x",
        version="1.4.0",
        is_cola_2=False,
        control_port=2112,
        size_px=(176, 144),
        focal_px=(146.5, 146.5),
        centre_px=(84.3, 71.3),
        distortion=(-0.1, 0.05),
        away_mm=0.0,
        root="DataSetDepthMap",
        is_planar=False,
        unit_mm=1.0,
        exponent=0,
        colour_bytes=2,
        has_states=False,
        has_period=False,
    ),
}
STREAM_PORT = 2114
BEST_US, LONGEST_US = 33_333, 1_000_000
