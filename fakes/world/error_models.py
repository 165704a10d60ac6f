"""Errors of the sensors in a scene: light, wide beams, dust, rain, errors as the sheets say.

All is off unless it is asked for, and all of it is drawn from seeds: the same world errs the same
beams. Angles lie in the map frame.
"""

import math
from dataclasses import dataclass, fields, replace

BEAM_DEG = 0.86  # 15 mrad: how an LMS111's beam widens, recalled; its sheet here does not say
EXIT_M = 0.008  # how wide it leaves the window, recalled as well


@dataclass(frozen=True, slots=True)
class ErrorModels:
    """Which errors, and how large. Rates are shares of beams, 0..1.

    Args:
        sunlight_rate: of beams that look into the sun, which come back dazzled, with nothing, or
            from too near; of all others a twentieth of it.
        sun_azimuth_rad: where the sun stands, from the map's x, counter-clockwise.
        sun_half_rad: how far beside it beams still look into the sun.
        beam_rad, beam_exit_m: how a beam widens, full angle, and how wide it leaves the lens.
        mixed_pixels: two surfaces under one wide beam that lie less than half a metre behind
            each other come back as one echo between both; else the nearer one counts.
        dust_per_m: grains that return a beam, a metre, right before the lens; fewer farther away.
        rain_per_m: drops that do, a metre, wherever.
        range_offset_m: the scanner's systematic error is drawn from -this to this, once.
        ahrs_sheet_errors: the attitude sensor errs as much as its sheet says.
        slip_bursts_per_min: how often a wheel or both spin for a moment.
    """

    sunlight_rate: float = 0.0
    sun_azimuth_rad: float = 0.0
    sun_half_rad: float = math.radians(15.0)
    beam_rad: float = 0.0
    beam_exit_m: float = 0.0
    mixed_pixels: bool = False
    dust_per_m: float = 0.0
    rain_per_m: float = 0.0
    range_offset_m: float = 0.0
    ahrs_sheet_errors: bool = False
    slip_bursts_per_min: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not isinstance(value, bool) and not math.isfinite(value):
                raise ValueError(f"{field.name}: must be finite, is {value}")
            if not field.name.startswith("sun_az") and value < 0:
                raise ValueError(f"{field.name}: must not be below 0, is {value}")
        if self.sunlight_rate > 1.0 or self.beam_rad > 0.1:
            raise ValueError("sunlight_rate goes up to 1, beam_rad up to 0.1")


NONE = ErrorModels()


def as_the_sheets_say(more: ErrorModels = NONE) -> ErrorModels:
    """A scene's own errors, and sensors as imperfect as their makers state.

    Source: lms111 sheet, section 1 (30 mm systematic; the 12 mm statistical are always on);
    MTi sheet, section 7. Wheels slip once in two minutes: our assumption.
    """
    return replace(
        more,
        beam_rad=math.radians(BEAM_DEG),
        beam_exit_m=EXIT_M,
        mixed_pixels=True,
        range_offset_m=0.030,
        ahrs_sheet_errors=True,
        slip_bursts_per_min=max(0.5, more.slip_bursts_per_min),
    )


@dataclass(frozen=True, slots=True)
class Patch:
    """A rectangle of ground with a friction of its own: 1 dry floor, 0.3 wet tiles, 0.1 ice."""

    name: str
    x: tuple[float, float]
    y: tuple[float, float]
    friction: float

    def __post_init__(self) -> None:
        if not 0.0 < self.friction <= 2.0:
            raise ValueError(f"{self.name}: friction must be above 0 and at most 2")
