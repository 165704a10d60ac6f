"""Where to mount a sensor that looks down: what it sees of random stepfields.

Tells of each mount how much of what lies in its view is occluded, how wide a strip is seen, how far
ahead it looks, and how well heights are known. Six mounts, or those of --sensor; with --config that
of the settings' scanner; with --height and --tilt that one. It opens no port.
"""

import argparse
import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from core.config import ConfigError
from core.device_settings import Scanner
from hw.stripe.options import StripeOptions
from tools.cli.options import (
    a_seed,
    cannot_be_written,
    configured,
    fail,
    number_in,
    parser_of,
    whole_in,
)
from tools.placement.field import flat
from tools.placement.measure import XS, Result, fields_of, measured, over
from tools.placement.search import best_mount
from tools.placement.sensor import KINDS, NAMED, Sensor


class MountError(Exception):
    """A mount that cannot be judged, in words."""


def of_settings(path: Path) -> Sensor:
    """Raises ConfigError, MountError: no such settings; a mount that the model has not."""
    scanner = configured(path).scanner
    for key in ("mount_roll_deg", "mount_yaw_deg"):
        if getattr(scanner, key) != 0:
            raise MountError(f"{key}: must be 0 here, is {getattr(scanner, key):g}")
    if not 0 < scanner.mount_tilt_deg < 90:
        raise MountError(f"mount_tilt_deg: must look down, is {scanner.mount_tilt_deg:g}")
    if isinstance(scanner.options, StripeOptions):
        return of_stripe(scanner, scanner.options)
    spec = scanner.options.spec
    if not spec.is_plane or np.abs(spec.directions[:, 2]).max() > 1e-6:
        raise MountError(f"scanner.driver: {scanner.driver!r} has not one plane of rays")
    bearings_rad = np.arctan2(spec.directions[:, 1], spec.directions[:, 0])
    return Sensor(
        name="settings",
        z_m=scanner.mount_z_m,
        tilt_rad=math.radians(scanner.mount_tilt_deg),
        right_rad=float(bearings_rad.min()),
        left_rad=float(bearings_rad.max()),
        reach_m=spec.max_range_m,
        sigma_m=spec.sigma_m,
        sigma_share=spec.sigma_share,
    )


def of_stripe(scanner: Scanner, options: StripeOptions) -> Sensor:
    """A camera and its laser, without the lens's distortion. Raises MountError: one beside it."""
    if options.along != "columns" or min(options.baseline_m, options.laser_deg) <= 0:
        raise MountError(
            'scanner: the laser must be above the camera and dip: along = "columns", '
            "baseline_m and laser_deg above 0; else give --sensor stripe"
        )
    (wide_px, high_px), lens = options.image_px, options.lens
    return Sensor(
        name="settings",
        z_m=scanner.mount_z_m,
        tilt_rad=math.radians(scanner.mount_tilt_deg),
        right_rad=-math.atan((wide_px - 0.5 - lens.cx) / lens.fx),
        left_rad=math.atan((lens.cx + 0.5) / lens.fx),
        reach_m=options.max_range_m,
        baseline_m=options.baseline_m,
        angle_rad=math.radians(options.laser_deg),
        focal_px=lens.fy,
        half_high_px=min(lens.cy + 0.5, high_px - 0.5 - lens.cy),
        sigma_px=options.sigma_px,
    )


def chosen(options: argparse.Namespace) -> list[Sensor]:
    """Raises ConfigError, MountError."""
    if (options.height is None) != (options.tilt is None):
        raise MountError("--height and --tilt: say both or none")
    if options.config is not None:
        if options.sensor is not None:
            raise MountError("--sensor: not with --config, which names the sensor")
        sensors = [of_settings(options.config)]
    else:
        sensors = [s for s in NAMED if s.name.startswith(options.sensor or "")]
    if options.height is None:
        return sensors
    kinds = [KINDS[options.sensor or "urg"]("given", 1.0, 45.0)]
    tilt_rad = math.radians(options.tilt)
    base = sensors[0] if options.config is not None else kinds[0]
    return [replace(base, name="given", z_m=options.height, tilt_rad=tilt_rad)]


def line(found: Result) -> str:
    sensor, m, e = found.sensor, found.mean, found.within
    mount = f"{sensor.name:<13}{sensor.z_m:>8.2f}{math.degrees(sensor.tilt_rad):>7.1f}"
    if np.isnan(m[2:]).any():
        ahead_m = f"it looks {sensor.look_ahead_m:.2f} m ahead"
        return f"{mount}   sees nothing of a field {XS[0]:.1f} to {XS[-1]:.1f} m ahead: {ahead_m}"
    return (
        f"{mount}{100 * m[0]:>8.1f} +- {100 * e[0]:<5.2f}{m[1]:>6.2f} +- {e[1]:<6.3f}"
        f"{measured(sensor, flat())[1]:>6.2f}{sensor.look_ahead_m:>8.2f}"
        f"{1000 * m[2]:>7.2f} +- {1000 * e[2]:<5.3f}{1000 * m[3]:>6.2f} +- {1000 * e[3]:<5.3f}"
    )


HEAD = (
    f"{'mount':<13}{'height m':>8}{'tilt':>7}{'occluded %':>16}{'strip m':>14}"
    f"{'flat m':>8}{'ahead m':>8}{'sigma mm':>13}{'90 % mm':>15}"
)


def arguments(given: list[str] | None) -> argparse.Namespace:
    parser = parser_of("placement", __doc__, "mapod placement --sensor urg --optimise")
    add = parser.add_argument
    add("--config", type=Path, help="settings whose scanner is judged")
    add("--sensor", choices=sorted(KINDS), help="only the mounts of this kind")
    add("--fields", type=whole_in(2, 10000), default=200, help="how many stepfields (default: 200)")
    add("--seed", type=a_seed, default=1, help="of all chance (default: 1)")
    add("--step", type=number_in(0.0, 0.5), default=0.15, help="highest block, in m (0.15)")
    add("--height", type=number_in(0.1, 5), help="of the lens above the ground, in m")
    add("--tilt", type=number_in(1, 74), help="looking down, in deg")
    add("--optimise", action="store_true", help="search height and tilt for the least occlusion")
    add(
        "--heights", type=number_in(0.1, 5), nargs=2, default=(0.3, 0.7), help="bounds, m (0.3 0.7)"
    )
    add("--tilts", type=number_in(1, 74), nargs=2, default=(10.0, 70.0), help="deg (10 70)")
    add("--width", type=number_in(0, 5), default=0.6, help="strip that must be seen, m (0.6)")
    add("--picture", type=Path, help="a PNG of what is seen of the first field")
    return parser.parse_args(given)


def main(given: list[str] | None = None) -> int:
    """Exit status: 0 done, 1 no mount sees the strip, 2 wrong use."""
    options = arguments(given)
    if unwritable := cannot_be_written(("--picture", options.picture, ".png")):
        return fail("placement", unwritable)
    try:
        sensors = chosen(options)
        for name in ("heights", "tilts"):
            low, high = getattr(options, name)
            if low >= high:
                raise MountError(f"--{name}: must be two, the lower first, is {low:g} {high:g}")
        fields = fields_of(options.seed, options.fields, options.step)
        if options.optimise:
            kinds = {sensor.baseline_m > 0: sensor for sensor in sensors}
            sensors = []
            for sensor in kinds.values():
                few = fields[:20]
                maybe_best, tried = best_mount(
                    sensor, options.heights, options.tilts, options.width, few
                )
                kind = "stripe" if sensor.baseline_m > 0 else "scanner"
                print(f"{kind}: {tried} mounts tried over {len(few)} fields")
                if maybe_best is None:
                    return fail("placement", f"no mount sees {options.width:g} m", 1)
                sensors.append(replace(maybe_best.sensor, name=f"best {kind}"))
        print(HEAD)
        for sensor in sensors:
            print(line(over(sensor, fields)))
        if options.picture is not None:
            from tools.placement.picture import drawn

            drawn(sensors, fields[0]).save(options.picture, format="PNG")
    except (ConfigError, MountError, OSError) as error:
        return fail("placement", error)
    return 0
