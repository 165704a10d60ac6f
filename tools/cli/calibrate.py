"""Where the scanner sits, from flat floor.

`mapod calibrate range`: how far off its ranges are; `mapod calibrate camera`: a camera's lens, from
pictures of a chessboard; `mapod calibrate stripe`: where a laser's plane lies to its camera;
`mapod calibrate depth`: where a depth camera sits, from flat floor.

Reads the scanner and the attitude sensor of mapod.toml for a while, and estimates the lens's height
and the scanner's tilt and roll from what is floor. It moves nothing: turn the robot on the spot, or
drive it by its radio, meanwhile. Close mapod first: a port has one reader. Prints the lines of
mapod.toml; --write puts their values there, with a comment that says when. What the floor does not
tell is not written; x, y and yaw of the mount it never tells.
"""

import argparse
import math
import sys
from datetime import UTC, datetime

from config_file import load_config
from core.config import Config, ConfigError
from hw.ports.url import PortUrlError
from tools.calibration.collect_floor import RefusedError, collect
from tools.calibration.fit import Mount
from tools.calibration.mount import (
    MOST_ANGLE_ERROR_RAD,
    Calibration,
    NoFloorError,
    calibrate,
    reads_m,
)
from tools.calibration.noted import with_note
from tools.cli import calibrate_camera, calibrate_depth, calibrate_range, calibrate_stripe
from tools.cli.options import fail, number_in, parser_of, settings_text
from tools.settings import NotThereError, rewrite, with_values
from tools.terminal.progress import advancing

BY_HAND_OFF_M = 0.3  # a measured height that differs so much from the settings' is a slip
UNPROVEN_OFF_RAD = math.radians(1.0)  # a mount that moved so far is not believed without proof
OTHERS = {
    "range": calibrate_range.main,
    "camera": calibrate_camera.main,
    "stripe": calibrate_stripe.main,
    "depth": calibrate_depth.main,
}
AHEAD_M, ASIDE_M = 8.0, 4.0  # where the effect is told


def mount_of(config: Config, maybe_height_m: float | None) -> Mount:
    x_m, y_m, z_m = config.scanner.mount_xyz_m
    height_m = z_m if maybe_height_m is None else maybe_height_m
    return Mount(x_m, y_m, height_m, *config.scanner.mount_rpy_rad)


def rounded(value: float, error: float) -> str:
    """A value to the first digit of its error.

    >>> rounded(8.2034, 0.042), rounded(1.0804, 0.0051), rounded(-0.004, 0.1)
    ('8.20', '1.080', '0.0')
    """
    digits = min(max(-math.floor(math.log10(error)), 1), 4) if error > 0 else 4
    return f"{round(value, digits) + 0.0:.{digits}f}"


def values_of(found: Calibration) -> dict[str, tuple[str, str]]:
    """By key of [scanner]: value and error as text, both to the error's first digit."""
    mount = found.mount
    numbers = {
        "mount_z_m": (mount.z_m, found.z_error_m),
        "mount_roll_deg": (math.degrees(mount.roll_rad), math.degrees(found.roll_error_rad)),
        "mount_tilt_deg": (math.degrees(mount.tilt_rad), math.degrees(found.tilt_error_rad)),
    }
    return {
        key: (rounded(value, error), rounded(error, error))
        for key, (value, error) in numbers.items()
    }


def seen_in_words(found: Calibration, config: Config) -> list[str]:
    now = mount_of(config, None)
    places = (("straight", 0.0), ("4 m to the left", ASIDE_M), ("4 m to the right", -ASIDE_M))
    reads = [
        f"{1000 * reads_m(found.mount, now, (AHEAD_M, y_m)):+.0f} mm {where}"
        for where, y_m in places
    ]
    return [
        f"floor: {found.floor_returns} of {found.returns} returns looked at, in "
        f"{found.floor_scans} of {found.scans} scans, from {found.ahead_m:.2f} m ahead of the lens",
        f"residual: {1000 * found.rms_m:.1f} mm rms in height, 95 % within "
        f"{1000 * found.within_m:.1f} mm",
        f"the robot turned by {math.degrees(found.turned_rad):.0f} deg and nodded or rolled by "
        f"{math.degrees(found.motion_rad):.2f} deg (1 sigma) against the floor; the floor slopes "
        f"by {math.degrees(found.slope_rad):.2f} +- {math.degrees(found.slope_error_rad):.2f} deg",
        f"with the present settings this floor reads, {AHEAD_M:g} m ahead: {', '.join(reads)}",
    ]


def table(found: Calibration, config: Config) -> list[str]:
    lines = [f"{'':<16}{'present':>9}   found (error: 1 sigma)"]
    for key, (value, error) in values_of(found).items():
        lines.append(f"{key:<16}{getattr(config.scanner, key):>9g}   {value} +- {error}")
    return lines


def check_height(maybe_height_m: float | None, config: Config) -> None:
    """Raises RefusedError for a height by hand that can only be a slip."""
    now_m = config.scanner.mount_z_m
    if maybe_height_m is not None and abs(maybe_height_m - now_m) > BY_HAND_OFF_M:
        raise RefusedError(
            f"a height of {maybe_height_m:g} m is far from mount_z_m = {now_m:g}: is it in metres, "
            "from the floor to the lens? If it is right, correct mount_z_m by hand first"
        )


def check_separate(found: Calibration) -> None:
    """Raises RefusedError unless height and tilt are both known."""
    mount = found.mount
    if not found.z_is_separate:
        steps = (-0.05, 0.0, 0.05)
        tilts = [math.asin((mount.z_m + d) * math.sin(mount.tilt_rad) / mount.z_m) for d in steps]
        pairs = ", ".join(
            f"{math.degrees(tilt):.1f} deg at {mount.z_m + d:.2f} m"
            for d, tilt in zip(steps, tilts, strict=True)
        )
        raise RefusedError(
            "height and tilt can't be told apart: to the scanner it is all the same whether the "
            f"tilt is {pairs}. Measure the lens's height above the floor and say --height; or let "
            "the robot stand half of the time level and half nodded by 3 deg or more, with a plank "
            "under its casters (the drive wheels stay on the floor)"
        )
    worst_rad = max(found.tilt_error_rad, found.roll_error_rad)
    if worst_rad > MOST_ANGLE_ERROR_RAD:
        raise RefusedError(
            f"tilt or roll is known no better than {math.degrees(worst_rad):.1f} deg: give the "
            "scanner more floor to see"
        )


def check_proven(found: Calibration, config: Config, vouched: bool, write: bool) -> None:
    """Raises RefusedError if a wall may have been taken for floor; a harmless doubt is told."""
    if found.is_proven or vouched:
        return
    now = mount_of(config, None)
    off_rad = max(
        abs(found.mount.tilt_rad - now.tilt_rad),
        abs(math.remainder(found.mount.roll_rad - now.roll_rad, math.tau)),
    )
    doubt = (
        f"the robot neither turned nor nodded, so that a wall {found.ahead_m:.1f} m ahead would "
        "look the same: turn it on the spot while it measures, or say --floor if you see that "
        "there is only floor"
    )
    if off_rad > UNPROVEN_OFF_RAD:
        raise RefusedError(f"{math.degrees(off_rad):.1f} deg off the settings, but {doubt}")
    if write:
        raise RefusedError(f"not written: {doubt}")
    print(f"calibrate: take care: {doubt}", file=sys.stderr)


def tell(found: Calibration, options: argparse.Namespace, config: Config, text: str) -> None:
    """Raises RefusedError, NotThereError: not known well enough; the file has changed."""
    print("\n".join(seen_in_words(found, config)))
    check_separate(found)
    print("\n".join(table(found, config)))
    check_proven(found, config, options.floor, options.write)
    values = {key: value for key, (value, _) in values_of(found).items()}
    print("\n[scanner]")
    for key, value in values.items():
        print(f"{key} = {value}")
    if options.write:
        noted = with_note(with_values(text, "scanner", values), datetime.now(UTC))
        rewrite(options.config, text, noted)
        print(f"\nwritten to {options.config}")


def arguments(given: list[str] | None) -> argparse.Namespace:
    parser = parser_of("calibrate", __doc__, "mapod calibrate --height 1.08 --write")
    parser.add_config()
    add = parser.add_argument
    add("--seconds", type=number_in(2, 600), default=20.0, help="how long (default: 20)")
    add("--height", type=number_in(0.02, 5), help="of the lens above the floor, by tape, in m")
    add("--height-error", type=number_in(0.0005, 0.1), default=0.005, help="of it (0.005 m)")
    add("--level", type=number_in(0.005, 2), default=0.1, help="the floor is, in deg (0.1)")
    add("--floor", action="store_true", help="you see that there is only floor ahead, no wall")
    add("--write", action="store_true", help="put the values into the settings' file")
    return parser.parse_args(given)


def main(given: list[str] | None = None) -> int:
    """Exit status: 0 done, 1 refused, 2 wrong use."""
    given = sys.argv[1:] if given is None else given
    if given[:1] and (other := OTHERS.get(given[0])):
        return other(given[1:])
    options = arguments(given)
    try:
        text = settings_text(options.config)
        config = load_config(text)
        check_height(options.height, config)
        with advancing("calibrate", options.seconds) as advance:
            watch = collect(config, options.seconds, advance)
        z_sigma_m = None if options.height is None else options.height_error
        guess = mount_of(config, options.height)
        found = calibrate(watch.view(), guess, z_sigma_m, math.radians(options.level))
        tell(found, options, config, text)
    except (ConfigError, PortUrlError, UnicodeDecodeError, OSError) as error:
        return fail("calibrate", error)
    except (RefusedError, NoFloorError, NotThereError) as error:
        return fail("calibrate", error, 1)
    except KeyboardInterrupt:
        return fail("calibrate", "broken off; nothing is written", 1)
    return 0
