"""A camera's lens, from pictures of a chessboard.

Print a chessboard, glue it onto something flat, and take 10 to 30 pictures of it with the camera,
as large as `image_px` says: near and far, at the image's edges and in its corners, leaning by 20 to
45 deg to all sides, sharp each time. The laser may be on or off. Prints the lines of mapod.toml;
--write puts their values there. Where the laser's plane lies must be measured anew after that:
`mapod calibrate stripe`.
"""

import argparse
import math
import re
import sys
from pathlib import Path

from config_file import load_config
from core.config import ConfigError
from hw.stripe.geometry import Lens
from hw.stripe.options import StripeOptions
from tools.calibration.camera import (
    ORDER,
    BoardsError,
    Chessboard,
    LensFit,
    doubts,
    fit,
    rms_with,
    views_in,
)
from tools.cli.options import fail, number_in, parser_of, settings_text
from tools.settings import NotThereError, rewrite, with_values

NAME = "calibrate camera"
PX_DIGITS, DISTORTION_DIGITS = 3, 6
MOST_CORNERS = 50


def table(found: LensFit, before: Lens) -> list[str]:
    lines = [f"{'':<4}{'present':>12}   found (error: 1 sigma)"]
    for key, now, value, error in zip(ORDER, before, found.lens, found.sigmas, strict=True):
        digits = PX_DIGITS if key[0] in "fc" else DISTORTION_DIGITS
        told = f"{value:.{digits}f} +- {error:.2g}" if error > 0.0 else "0, not sought"
        lines.append(f"{key:<4}{now:>12g}   {told}")
    return lines


def values_of(lens: Lens) -> dict[str, str]:
    """By key of [scanner], as text."""

    def told(numbers: tuple[float, ...], digits: int) -> str:
        return f"[{', '.join(f'{round(number, digits) + 0.0:.{digits}f}' for number in numbers)}]"

    return {
        "focal_px": told(lens[:2], PX_DIGITS),
        "centre_px": told(lens[2:4], PX_DIGITS),
        "distortion": told(lens[4:], DISTORTION_DIGITS),
    }


def tell(
    found: LensFit, now_px: float, options: StripeOptions, given: argparse.Namespace, text: str
) -> None:
    """Raises ConfigError, NotThereError: it can't be; the file has changed.

    Args:
        now_px: by which the present settings miss the corners, rms.
    """
    print("\n".join(table(found, options.lens)))
    w, h = options.image_px
    wide, high = (
        math.degrees(2 * math.atan(n / 2 / f)) for n, f in ((w, found.lens.fx), (h, found.lens.fy))
    )
    print(
        f"{len(found.views)} pictures; corners missed by {found.rms_px:.3f} px rms, by "
        f"{now_px:.3f} px with the present settings; field of view {wide:.1f} x {high:.1f} deg"
    )
    for doubt in doubts(found, (w, h)):
        print(f"mapod {NAME}: take care: {doubt}", file=sys.stderr)
    values = values_of(found.lens)
    print("\n[scanner]")
    for key, value in values.items():
        print(f"{key} = {value}")
    if given.write:
        rewrite(given.config, text, with_values(text, "scanner", values))
        print(f"\nwritten to {given.config}; `mapod calibrate stripe` must follow")


def a_board(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"(\d{1,3})x(\d{1,3})", text)
    size = (int(found[1]), int(found[2])) if found else (0, 0)
    if not 3 <= min(size) <= max(size) <= MOST_CORNERS:
        raise argparse.ArgumentTypeError(
            f"must be inner corners across and down, as 9x6, each from 3 to {MOST_CORNERS}; "
            f"is {text!r}"
        )
    return size


def arguments(given: list[str] | None) -> argparse.Namespace:
    example = "mapod calibrate camera --pictures boards --board 9x6 --square 0.025 --write"
    parser = parser_of(NAME, __doc__, example)
    parser.add_config()
    add = parser.add_argument
    add("--pictures", type=Path, required=True, help="a folder of .jpg or .png")
    about = "inner corners across and down, where four squares meet: 9x6 has 10 x 7 squares"
    add("--board", type=a_board, required=True, help=about)
    add("--square", type=number_in(0.001, 1), required=True, help="edge of a square, m, measured")
    add("--k3", action="store_true", help="wide lenses: fit k3 as well, which else is 0")
    add("--write", action="store_true", help="put the values into the settings")
    return parser.parse_args(given)


def main(given: list[str] | None = None) -> int:
    """Exit status: 0 done, 1 refused, 2 wrong use."""
    options = arguments(given)
    try:
        text = settings_text(options.config)
        scanner = load_config(text).scanner
        if not isinstance(scanner.options, StripeOptions):
            return fail(NAME, f"scanner.driver: must be 'stripe', is {scanner.driver!r}")
        w, h = scanner.options.image_px
        across, down = options.board
        board = Chessboard(across, down, options.square)
        views, left_out = views_in(options.pictures, board, (w, h))
        for why in left_out:
            print(f"mapod {NAME}: left out: {why}", file=sys.stderr)
        found = fit(views, board, (w, h), options.k3)
        now_px = rms_with(scanner.options.lens, views, board)
        tell(found, now_px, scanner.options, options, text)
    except (BoardsError, NotThereError) as error:
        return fail(NAME, error, 1)
    except (ConfigError, OSError) as error:
        return fail(NAME, error)
    return 0
