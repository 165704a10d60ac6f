"""Where a depth camera sits on the robot, from the flat floor that it sees.

The robot stands still on a level floor, some of which the camera sees; things may stand on it.
Reads the camera of mapod.toml for some seconds, or images of a folder (docs/devices.md). Close
mapod first: a port has one reader. Prints the lines of mapod.toml; --write puts their values there.
x, y and yaw of the mount the floor does not tell.
"""

import argparse
import importlib.util
import math
import sys
from pathlib import Path

from config_file import load_config
from core.config import Config, ConfigError
from core.device_settings import Depth
from core.records import DepthImage
from hw.ports.url import PortUrlError
from tools.calibration.collect_depth import images_in, watched
from tools.calibration.collect_floor import RefusedError
from tools.calibration.depth import DepthMount, NoFloorError, mount_of, seen_in
from tools.calibration.fit import Mount
from tools.calibration.mount import reads_m
from tools.cli.options import fail, number_in, parser_of, settings_text
from tools.settings import NotThereError, rewrite, with_values
from tools.terminal.progress import advancing

NAME = "calibrate depth"
NOT_INSTALLED = "needs the objects' libraries: pip install 'mapod[objects]'"
AHEAD_M = 2.0  # where the effect is told


def guess_of(depth: Depth) -> Mount:
    return Mount(*depth.mount_xyz_m, *depth.mount_rpy_rad)


def rows_of(found: DepthMount) -> dict[str, tuple[float, float]]:
    """By key of [depth]: value and 1 sigma."""
    mount = found.mount
    return {
        "mount_z_m": (mount.z_m, found.z_error_m),
        "mount_roll_deg": (math.degrees(mount.roll_rad), math.degrees(found.roll_error_rad)),
        "mount_tilt_deg": (math.degrees(mount.tilt_rad), math.degrees(found.tilt_error_rad)),
    }


def tell(found: DepthMount, options: argparse.Namespace, depth: Depth, text: str) -> None:
    """Raises ConfigError, NotThereError: it can't be; the file has changed."""
    off_m = reads_m(found.mount, guess_of(depth), (AHEAD_M, 0.0))
    print(
        f"floor: {found.points} points of it a frame, {found.share:.0%} of what may be floor, in "
        f"{found.used} of {found.frames} frames\nwith the present settings this floor reads, "
        f"{AHEAD_M:g} m ahead: {1000 * off_m:+.0f} mm"
    )
    print(f"{'':<16}{'present':>9}   found (error: 1 sigma)")
    values = {}
    for key, (value, error) in rows_of(found).items():
        values[key] = f"{value:.{4 if key.endswith('_m') else 3}f}"
        print(f"{key:<16}{getattr(depth, key):>9g}   {values[key]} +- {error:.2g}")
    print("\n[depth]")
    for key, value_text in values.items():
        print(f"{key} = {value_text}")
    if options.write:
        rewrite(options.config, text, with_values(text, "depth", values))
        print(f"\nwritten to {options.config}")


def images_for(config: Config, options: argparse.Namespace) -> list[DepthImage]:
    """Of the folder, or of the camera. Raises RefusedError, PortUrlError, OSError, ValueError."""
    if options.folder is None:
        with advancing(NAME, options.seconds) as advance:
            return watched(config, options.seconds, advance)
    images, faults = images_in(options.folder)
    for fault in faults:
        print(f"mapod {NAME}: left out: {fault}", file=sys.stderr)
    return images


def main(given: list[str] | None = None) -> int:
    """Exit status: 0 done, 1 refused, 2 wrong use."""
    parser = parser_of(NAME, __doc__, "mapod calibrate depth --write")
    parser.add_config()
    add = parser.add_argument
    add("--folder", type=Path, help="depth images with times.csv and camera.toml")
    add("--seconds", type=number_in(0.5, 600), default=5.0, help="how long (default: 5)")
    add("--level", type=number_in(0.005, 2), default=0.1, help="the floor is, in deg (0.1)")
    add("--write", action="store_true", help="put the values into the settings")
    options = parser.parse_args(given)
    if importlib.util.find_spec("shapely") is None:
        return fail(NAME, NOT_INSTALLED)
    try:
        text = settings_text(options.config)
        config = load_config(text)
        if config.depth is None or config.objects is None:
            return fail(NAME, f"{options.config}: needs the sections [depth] and [objects]")
        images = images_for(config, options)
        seen = seen_in(images, config.objects, guess_of(config.depth))
        found = mount_of(seen, len(images), math.radians(options.level))
        tell(found, options, config.depth, text)
    except (RefusedError, NoFloorError, NotThereError) as error:
        return fail(NAME, error, 1)
    except (ConfigError, PortUrlError, OSError, ValueError) as error:
        return fail(NAME, error)
    except KeyboardInterrupt:
        return fail(NAME, "broken off; nothing is written", 1)
    return 0
