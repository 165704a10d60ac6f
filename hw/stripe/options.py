"""What the settings say of a camera and its laser: the keys of [scanner] that the driver knows.

Lens and plane are as in geometry.py, angles in degrees.
"""

import math
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta, Struct

from core.records import F64, ScannerSpec
from hw.stripe.detect import Colour, Method
from hw.stripe.geometry import (
    LaserPlane,
    Lens,
    Sigmas,
    ranges_from_pixels,
    slopes_from_pixel,
    variance_of_range,
)

Pair = Annotated[list[float], Meta(min_length=2, max_length=2)]
Pixels = Annotated[int, Meta(ge=32, le=4096)]
MOST_FOCAL_PX = 50_000.0  # 5 deg over the largest image
LEAST_BASELINE_M = 0.01  # to either side
SIGMA_STEPS = 200  # rows in which the least range is looked for
MOST_BYTES_A_PIXEL = 1.0  # of a JPEG: a good one has 0.2


class StripeOptions(Struct, frozen=True):
    """Where the images come from, how the line is found in them, and what a pixel means."""

    path: Annotated[str, Meta(pattern=r"^/[!-~]*$", max_length=500)]
    rate_hz: Annotated[float, Meta(ge=0.5, le=120)]
    latency_s: Annotated[float, Meta(ge=0, le=1)]
    image_px: Annotated[list[Pixels], Meta(min_length=2, max_length=2)]
    along: Literal["columns", "rows"]
    find: Method
    colour: Colour
    line_px: Annotated[float, Meta(ge=1, le=30)]
    contrast: Annotated[float, Meta(ge=5, le=200)]
    focal_px: Pair
    centre_px: Pair
    distortion: Annotated[list[float], Meta(min_length=5, max_length=5)]
    baseline_m: Annotated[float, Meta(ge=-3, le=3)]
    laser_deg: Annotated[float, Meta(ge=-80, le=80)]
    sigma_px: Annotated[float, Meta(ge=0.02, le=5)]
    sigma_baseline_m: Annotated[float, Meta(ge=0, le=0.1)]
    sigma_laser_deg: Annotated[float, Meta(ge=0, le=5)]
    max_range_m: Annotated[float, Meta(ge=0.2, le=30)]

    def __post_init__(self) -> None:
        if not all(0.0 < focal <= MOST_FOCAL_PX for focal in self.focal_px):
            raise ValueError(
                f"focal_px: must be above 0, up to {MOST_FOCAL_PX:g}, is {self.focal_px}"
            )
        for of, size, centre in zip(
            ("width", "height"), self.image_px, self.centre_px, strict=True
        ):  # outside of the image where that is a part of a larger one
            if not -size <= centre <= 2 * size:
                raise ValueError(
                    f"centre_px: must be within {-size} to {2 * size} px of {of}, is {centre:g}"
                )
        if abs(self.baseline_m) < LEAST_BASELINE_M:
            raise ValueError(
                f"baseline_m: must be {LEAST_BASELINE_M:g} m or more to one side, "
                f"is {self.baseline_m:g}"
            )
        w, h = self.image_px
        edge = [(u, v) for u in (0.0, w / 2, w - 1.0) for v in (0.0, h / 2, h - 1.0)]
        if not all(math.isfinite(slopes_from_pixel(self.lens, u, v)[0]) for u, v in edge):
            raise ValueError(
                f"distortion: folds the image, so pixels have no ray, is {self.distortion}"
            )
        if not math.isfinite(self._least_range_m):
            raise ValueError(
                "laser_deg: must let the camera see the laser's plane within "
                f"max_range_m = {self.max_range_m:g}, is {self.laser_deg:g}"
            )

    @property
    def lens(self) -> Lens:
        return Lens(*map(float, (*self.focal_px, *self.centre_px, *self.distortion)))

    @property
    def plane(self) -> LaserPlane:
        axis = 2 if self.along == "columns" else 1
        return LaserPlane(float(self.baseline_m), math.radians(self.laser_deg), axis)

    @property
    def sigmas(self) -> Sigmas:
        angle_rad = math.radians(self.sigma_laser_deg)
        return Sigmas(float(self.sigma_baseline_m), angle_rad, float(self.sigma_px))

    @property
    def beams(self) -> int:
        """Columns, or rows where the line runs up the image."""
        return self.image_px[0 if self.along == "columns" else 1]

    @property
    def most_bytes(self) -> int:
        """Of an image as a JPEG."""
        return 4096 + round(MOST_BYTES_A_PIXEL * math.prod(self.image_px))

    def pixels_across(self, places: F64) -> tuple[F64, F64]:
        """Pixels (us, vs) of the middle column or row, at places (n,) across the line."""
        middle = np.full(places.shape, self.beams / 2.0)
        return (middle, places) if self.along == "columns" else (places, middle)

    def _ranges_across(self) -> tuple[F64, F64]:
        """Places across the middle of the image, and their ranges; NaN: beyond max_range_m."""
        across = self.image_px[1 if self.along == "columns" else 0]
        places = np.linspace(0.0, across - 1.0, SIGMA_STEPS)
        directions, ranges_m = np.zeros((SIGMA_STEPS, 3)), np.zeros(SIGMA_STEPS)
        us, vs = self.pixels_across(places)
        lens, plane = self.lens, self.plane
        ranges_from_pixels(us, vs, lens, plane, float(self.max_range_m), directions, ranges_m)
        return places, ranges_m

    @property
    def _least_range_m(self) -> float:
        ranges_m = self._ranges_across()[1]
        return float(np.nanmin(ranges_m)) if np.isfinite(ranges_m).any() else math.nan

    def sigma_m(self, place: float) -> float:
        """1 sigma of the range at a place across the middle of the image."""
        us, vs = self.pixels_across(np.array([place]))
        variance, *_ = variance_of_range(
            self.lens, self.plane, self.sigmas, float(us[0]), float(vs[0])
        )
        return math.sqrt(variance)

    @property
    def _light_normal(self) -> tuple[float, float, float] | None:
        """Of the laser's plane, sensor frame; none where the line runs up the image."""
        if self.along == "rows":
            return None
        return math.sin(self.plane.beta_rad), 0.0, math.cos(self.plane.beta_rad)

    @property
    def spec(self) -> ScannerSpec:
        """Its error grows with the square of the range: told as the share that it is farthest."""
        places, ranges_m = self._ranges_across()
        near, far = int(np.nanargmin(ranges_m)), int(np.nanargmax(ranges_m))
        far_at = np.full(self.beams, places[far])
        along = np.arange(self.beams, dtype=np.float64)
        us, vs = (along, far_at) if self.along == "columns" else (far_at, along)
        directions, unused_m = np.zeros((self.beams, 3)), np.zeros(self.beams)
        lens, plane = self.lens, self.plane
        ranges_from_pixels(us, vs, lens, plane, float(self.max_range_m), directions, unused_m)
        return ScannerSpec(
            period_s=1.0 / self.rate_hz,
            max_beams=self.beams,
            max_range_m=self.max_range_m,
            echoes=1,
            sigma_m=self.sigma_m(float(places[near])),
            sigma_share=self.sigma_m(float(places[far])) / float(ranges_m[far]),
            is_plane=False,
            directions=directions,
            light_normal=self._light_normal,
        )

    def describe(self) -> str:
        spec, side = self.spec, {"columns": "above", "rows": "left of"}[self.along]
        w, h = self.image_px
        return (
            f"camera of {w} x {h} px at {self.rate_hz:g} images/s, {self.colour} laser "
            f"{self.baseline_m:g} m {side} it, dipping {self.laser_deg:g} deg; "
            f"1 sigma {spec.sigma_m * 1000:.1f} mm at {self._least_range_m:.2f} m, "
            f"{spec.sigma_share:.1%} at {spec.max_range_m:g} m"
        )
