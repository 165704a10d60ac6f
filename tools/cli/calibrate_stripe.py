"""Where a laser's plane lies to its camera, from pictures of its line on boards.

Put a flat, light board square to the camera's axis at three distances or more from the camera, take
a picture of each with the laser on, and list them in a table: columns file,true_m. Prints the lines
of mapod.toml; --write puts their values there. The camera's matrix and distortion must be right
before (`mapod calibrate camera`): they are not estimated.
"""

import argparse
import math
import sys
from pathlib import Path

import numpy as np

from config_file import load_config
from core.config import ConfigError
from hw.stripe.options import StripeOptions
from tools.calibration.stripe import PicturesError, PlaneFit, boards_in, fit
from tools.cli.options import fail, number_in, parser_of, settings_text
from tools.settings import NotThereError, checked, rewrite, with_values

NAME = "calibrate stripe"
MUCH = 4.0  # times the contradictions that are expected
DIGITS = 5  # of m and deg


def table(found: PlaneFit, options: StripeOptions) -> list[str]:
    """What is read of each board now, and with the plane that was found."""
    tangent = math.tan(math.radians(options.laser_deg))
    lines = ["board      columns   too far now   corrected"]
    for board, off_m in zip(found.boards, found.off_m, strict=True):
        now_m = options.baseline_m / (tangent - board.slope) - board.true_m
        lines.append(
            f"{board.true_m:6.3f} m  {board.columns:7d}  {1000 * now_m:+9.1f} mm"
            f"  {1000 * off_m:+7.1f} mm"
        )
    return lines


def values_of(found: PlaneFit) -> dict[str, str]:
    """By key of [scanner], as text."""
    sigma_m, sigma_rad = np.sqrt(np.diag(found.covariance))
    values = {
        "baseline_m": found.baseline_m,
        "laser_deg": math.degrees(found.beta_rad),
        "sigma_baseline_m": float(sigma_m),
        "sigma_laser_deg": math.degrees(float(sigma_rad)),
    }
    return {key: f"{value:.{DIGITS}f}" for key, value in values.items()}


def tell(found: PlaneFit, options: StripeOptions, given: argparse.Namespace, text: str) -> None:
    """Raises ConfigError, NotThereError: it can't be; the file has changed."""
    print("\n".join(table(found, options)))
    print(f"errors of both are correlated by {found.correlation:+.3f}")
    if found.chi2_share > MUCH:
        print(
            f"mapod {NAME}: take care: the boards contradict each other {found.chi2_share:.1f} "
            "times as much as their errors explain: distances, lens or squareness are off",
            file=sys.stderr,
        )
    values = values_of(found)
    checked(text, "scanner", values)
    print("\n[scanner]")
    for key, value in values.items():
        print(f"{key} = {value}")
    if given.write:
        rewrite(given.config, text, with_values(text, "scanner", values))
        print(f"\nwritten to {given.config}")


def main(given: list[str] | None = None) -> int:
    """Exit status: 0 done, 1 refused, 2 wrong use."""
    parser = parser_of(NAME, __doc__, "mapod calibrate stripe --pictures board.csv --write")
    parser.add_config()
    about = "a table with columns file,true_m"
    parser.add_argument("--pictures", type=Path, required=True, help=about)
    about = "m, 1 sigma of true_m (0.001)"
    parser.add_argument("--placed", type=number_in(0.0001, 0.1), default=0.001, help=about)
    parser.add_argument("--write", action="store_true", help="put the values into the settings")
    options = parser.parse_args(given)
    try:
        text = settings_text(options.config)
        scanner = load_config(text).scanner
        if not isinstance(scanner.options, StripeOptions):
            return fail(NAME, f"scanner.driver: must be 'stripe', is {scanner.driver!r}")
        boards = boards_in(options.pictures, scanner.options)
        found = fit(boards, options.placed, scanner.options.baseline_m)
        tell(found, scanner.options, options, text)
    except (PicturesError, NotThereError) as error:
        return fail(NAME, error, 1)
    except (ConfigError, OSError) as error:
        return fail(NAME, error)
    return 0
