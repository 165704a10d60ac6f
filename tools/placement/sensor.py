"""Sensors as they are mounted: three of each kind, from high and flat (a) to low and steep (c)."""

import math
from dataclasses import dataclass

import numpy as np

from core.records import F64


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensor:
    """A scanner whose plane is tilted; with a baseline, a camera and a plane of laser light.

    The laser stands `baseline_m` above the camera, across the camera's axis, and looks down by
    `angle_rad` more.
    """

    name: str
    z_m: float  # of the lens above the ground
    tilt_rad: float  # of its axis; looking down is positive
    right_rad: float  # bearings where its field of view ends; left is positive
    left_rad: float
    reach_m: float
    sigma_m: float = 0.0  # 1 sigma of a range, near
    sigma_share: float = 0.0  # and as a share of it, far
    sigma_rad: float = math.radians(0.2)  # 1 sigma of the line of sight's elevation
    baseline_m: float = 0.0
    angle_rad: float = 0.0
    focal_px: float = 0.0
    half_high_px: float = 0.0
    sigma_px: float = 0.0  # 1 sigma of the stripe's place in the picture

    @property
    def numbers(self) -> F64:
        """(13,), in the order of the fields after the name."""
        return np.array([getattr(self, name) for name in self.__slots__[1:]], dtype=np.float64)

    @property
    def look_ahead_m(self) -> float:
        """From the lens to where its plane meets flat ground."""
        back_m = self.baseline_m * math.sin(self.tilt_rad)
        laser_z_m = self.z_m + self.baseline_m * math.cos(self.tilt_rad)
        return back_m + laser_z_m / math.tan(self.tilt_rad + self.angle_rad)


def urg(name: str, z_m: float, tilt_deg: float) -> Sensor:
    """Source: urg04lx sheet, section 1: 5.6 m, half of the accuracy of 10 mm and 1 %."""
    return Sensor(
        name=name,
        z_m=z_m,
        tilt_rad=math.radians(tilt_deg),
        right_rad=math.radians(-60.0),
        left_rad=math.radians(60.0),
        reach_m=5.6,
        sigma_m=0.005,
        sigma_share=0.005,
    )


def stripe(name: str, z_m: float, tilt_deg: float) -> Sensor:
    """A camera of 640 x 480 pixels, 500 px focal length, and a laser 15 cm above it."""
    return Sensor(
        name=name,
        z_m=z_m,
        tilt_rad=math.radians(tilt_deg),
        right_rad=-math.atan(320.0 / 500.0),
        left_rad=math.atan(320.0 / 500.0),
        reach_m=2.0,
        baseline_m=0.15,
        angle_rad=math.radians(15.0),
        focal_px=500.0,
        half_high_px=240.0,
        sigma_px=0.3,
    )


KINDS = {"urg": urg, "stripe": stripe}
NAMED = (  # our own choice
    urg("urg a", 0.65, 20.0),
    urg("urg b", 0.50, 35.0),
    urg("urg c", 0.35, 55.0),
    stripe("stripe a", 0.55, 15.0),
    stripe("stripe b", 0.45, 30.0),
    stripe("stripe c", 0.35, 45.0),
)
