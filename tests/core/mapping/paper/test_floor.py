"""The paper's method on flat floor seen by exact rays: what its compensation repairs, what not."""

import math

import numpy as np
import numpy.typing as npt
import pytest

from core.geometry import R_from_rpy
from core.mapping.paper.steps import PaperSettings, ReferencePlane, sigma_from_bearing

F64 = npt.NDArray[np.float64]
LENS_M = 1.08
TILT_RAD = math.radians(7.5)
BEARING_RAD = np.radians(np.arange(-60.0, 60.1, 0.25))
INNER = np.abs(BEARING_RAD) <= math.radians(45) + 1e-9


def floor_ranges(roll_rad: float, pitch_rad: float, max_range_m: float) -> F64:
    """Ranges (n,) to flat floor from a lens that the body turns about; NaN beyond the maximum."""
    rays_sensor = np.stack([np.cos(BEARING_RAD), np.sin(BEARING_RAD), 0 * BEARING_RAD])
    R_map_sensor = R_from_rpy(roll_rad, pitch_rad, 0.0) @ R_from_rpy(0.0, TILT_RAD, 0.0)
    down = np.maximum(-(R_map_sensor @ rays_sensor)[2], 1e-9)
    ranges_m = LENS_M / down
    return np.asarray(np.where(ranges_m < max_range_m, ranges_m, np.nan))


def heights_after(
    roll_deg: float, pitch_deg: float, scans: int, compensated: bool, max_range_m: float
) -> F64:
    """Heights (n,) that flat floor seems to have after tilting evenly over `scans` scans."""
    settings = PaperSettings(
        lens_height_m=LENS_M,
        tilt_rad=TILT_RAD,
        max_range_m=max_range_m,
        cells=101,
        cell_m=0.2,
        h_pos_m=0.1,
        h_neg_m=-0.1,
        epsilon_rad=1.0,  # ground never counts as changed
        eta_rad=0.01,
        compensated=compensated,
    )
    plane = ReferencePlane(settings, sigma_from_bearing(BEARING_RAD))
    for k in range(scans + 1):
        roll_rad, pitch_rad = (math.radians(angle * k / scans) for angle in (roll_deg, pitch_deg))
        ranges_m = floor_ranges(roll_rad, pitch_rad, max_range_m)
        plane.add(ranges_m, 0.0, pitch_rad, roll_rad, 0.0)
    return LENS_M / plane.reference_m * (plane.reference_m - ranges_m)


POSES = [(0.0, -4.5), (0.0, 2.5), (-5.2, 0.0), (-3.0, -2.0)]  # roll, pitch of figures 5.8 to 5.10
# Nose up by 4.5 of 7.5 deg, floor is first met at 20.6 m: the scanner's 20 m show none of it.
FAR_M = 60.0


@pytest.mark.parametrize(("roll_deg", "pitch_deg"), POSES)
def test_compensated_floor_stays_within_five_centimetres_and_without_is_mostly_obstacle(
    roll_deg: float, pitch_deg: float
) -> None:
    for scans in (1, 100):
        heights_m = heights_after(roll_deg, pitch_deg, scans, True, FAR_M)
        assert np.nanmax(np.abs(heights_m)) < 0.05
        assert np.max(np.abs(heights_m[INNER])) < 0.035
    heights_m = heights_after(roll_deg, pitch_deg, 1, False, FAR_M)
    assert np.mean(np.abs(heights_m[INNER]) >= 0.1) > 0.75
    assert np.isnan(heights_after(0.0, -4.5, 100, True, 20.0)).all()  # the scanner's range
