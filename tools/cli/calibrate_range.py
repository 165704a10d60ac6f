"""By how much the scanner's ranges are off, from targets at known distances.

Put a bright flat board square to the laser at each distance of --at in turn, measured by tape from
the scanner's zero point, and press return; or give a table of readings. Six distances or more, from
the nearest to the farthest that matters, make a polynomial of third order; fewer, a lower one. One
target that the others contradict is named and left out. Close mapod first: a port has one reader.
Prints the lines of mapod.toml; --write puts them there.
"""

import argparse
import importlib.util
import sys
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import UTC, datetime
from math import radians
from pathlib import Path
from typing import Any

import numpy as np

from config_file import load_config, with_changes
from core.config import Config, ConfigError
from core.records import F64
from hw.ports.url import PortUrlError
from hw.registry import SCANNERS
from tools.calibration.collect_floor import RefusedError
from tools.calibration.collect_ranges import Person, Plan, Vouched, collect
from tools.calibration.noted import with_ranges_note
from tools.calibration.range_readings import ReadingsError, targets_in
from tools.calibration.ranges import TERMS, NoFitError, RangeFit, Target, fit, rms_of, terms_for
from tools.cli.options import (
    Parser,
    fail,
    number_in,
    parser_of,
    settings_text,
    value_of,
)
from tools.settings import NotThereError, checked, rewrite, with_values
from tools.terminal.progress import advancing

NAME = "calibrate range"
DIGITS, SPAN_DIGITS = 8, 3  # of the coefficients: a hundredth of a mm at 10 m; of `correction_m`
WORDS = ("a constant", "a straight line", "second order", "third order")  # by terms
BEYOND_M = 0.1  # a range that reaches so far beyond the targets is told


@dataclass(frozen=True, slots=True)
class Report:
    """A correction, and what the present settings make of the same targets."""

    found: RangeFit
    before_m: F64  # (n,) by which each target is too far with the present settings
    errors_m: F64  # (n,) of the readings, 1 sigma
    device_m: tuple[float, float]  # from the nearest to the farthest range that the scanner tells

    @classmethod
    def of(cls, targets: list[Target], config: Config, placed_m: float) -> "Report":
        """Raises NoFitError."""
        options: Any = config.scanner.options
        read_m = np.array([target.read_m for target in targets])
        true_m = np.array([target.true_m for target in targets])
        return cls(
            fit(targets, placed_m),
            options.corrected_m(read_m) - true_m,
            np.array([target.error_m(placed_m) for target in targets]),
            (options.least_m, options.spec.max_range_m),
        )

    def table(self) -> list[str]:
        lines = ["target      reads    spread     too far now   corrected"]
        for k, target in enumerate(self.found.targets):
            lines.append(
                f"{target.true_m:6.3f} m  {target.read_m:6.3f} m  {1000 * target.spread_m:5.1f} mm"
                f"  {1000 * self.before_m[k]:+9.1f} mm  {1000 * self.found.off_m[k]:+7.1f} mm"
                f"{'   left out: the others contradict it' if k == self.found.wrong else ''}"
            )
        before_mm = 1000 * rms_of(self.before_m, self.found.wrong)
        lines.append(f"rms: {before_mm:.1f} mm now, {1000 * self.found.rms_m:.1f} mm corrected")
        return lines

    def quality(self) -> list[str]:
        found, terms = self.found, self.found.terms
        errors = ", ".join(f"{error:.1g}" for error in found.errors[:terms])
        return [
            f"fitted: {WORDS[terms - 1]}; standard errors of its {terms} of {TERMS} numbers: "
            f"{errors}; the correction is known to {1000 * found.worst_m:.1f} mm or better (1 "
            "sigma) between the targets",
        ]

    def doubts(self) -> list[str]:
        """What a person should know before believing it."""
        found, told = self.found, []
        (near_m, far_m), (least_m, most_m) = found.correction_m, self.device_m
        if found.terms < TERMS:
            told.append("six targets or more are needed for the third order")
        if not found.tested:
            told.append("too few targets to notice a wrong one")
        if near_m - least_m > BEYOND_M or most_m - far_m > BEYOND_M:
            told.append(
                f"the scanner tells ranges from {least_m:g} to {most_m:g} m, and the targets lie "
                f"from {near_m:.2f} to {far_m:.2f} m: beyond, the correction of the nearer end "
                "is used, which nothing proves"
            )
        if found.rms_m > rms_of(self.before_m, found.wrong):
            told.append("the present settings fit these targets better")
        return told

    def values(self) -> dict[str, str]:
        """By key of [scanner], as text."""
        numbers = [round(float(value), DIGITS) + 0.0 for value in self.found.correction]
        span_m = [round(end_m, SPAN_DIGITS) for end_m in self.found.correction_m]
        return {"correction": str(numbers), "correction_m": str(span_m)}


def check_driver(config: Config) -> None:
    """Raises ConfigError unless its driver corrects ranges."""
    if not hasattr(config.scanner.options, "correction"):
        able = [name for name, one in SCANNERS.items() if hasattr(one.options, "correction")]
        raise ConfigError(
            f"scanner.driver: {config.scanner.driver!r} has no correction of ranges; "
            f"{' and '.join(map(repr, able))} has"
        )


def measured(config: Config, options: argparse.Namespace) -> list[Target]:
    """Raises RefusedError, PortUrlError."""
    plain = with_changes(config, scanner={"correction": [0.0] * TERMS})
    plan = Plan(tuple(options.at), options.scans, radians(options.within))

    def tell(words: str) -> None:
        print(f"{NAME}: {words}", file=sys.stderr, flush=True)

    with ExitStack() as stack:
        advance = stack.enter_context(advancing(NAME, plan.scans * len(plan.distances_m)))
        helper = Vouched() if options.yes else Person(sys.stdin.fileno(), tell)
        return list(collect(plain, plan, helper, advance))


def tell(report: Report, options: argparse.Namespace, text: str) -> None:
    """Raises ConfigError, NotThereError: it can't be; the file has changed."""
    print("\n".join([*report.table(), *report.quality()]))
    for doubt in report.doubts():
        print(f"{NAME}: take care: {doubt}", file=sys.stderr)
    values = report.values()
    checked(text, "scanner", values)
    print("\n[scanner]")
    for key, value in values.items():
        print(f"{key} = {value}")
    changed = with_values(text, "scanner", values) if options.write else ""
    if options.picture:
        from tools.calibration.range_picture import draw

        draw(options.picture, report.found, report.before_m, report.errors_m)
        print(f"\ndrawn to {options.picture}")
    if options.write:
        rewrite(options.config, text, with_ranges_note(changed, datetime.now(UTC)))
        print(f"\nwritten to {options.config}")


def a_count(text: str) -> int:
    return value_of(text, int, lambda value: 5 <= value <= 1000, "a whole number from 5 to 1000")


def arguments(given: list[str] | None) -> argparse.Namespace:
    parser = parser_of(
        NAME,
        __doc__,
        "mapod calibrate range --at 0.5 --at 1 --at 1.5 --at 2 --at 3 --at 4 --write",
        "mapod calibrate range --readings board.csv --picture board.png",
    )
    parser.add_config()
    add = parser.add_argument
    about = "where a target is put, in m; repeatable"
    add("--at", type=number_in(0.02, 100), action="append", default=[], help=about)
    add("--readings", type=Path, help="a table instead: columns true_m,read_m; uncorrected")
    add("--scans", type=a_count, default=50, help="of each target (default: 50)")
    add("--within", type=number_in(0.1, 5), default=1.0, help="deg about straight ahead (1)")
    add("--placed", type=number_in(0.0001, 0.1), default=0.002, help="m, error of --at (0.002)")
    add("--yes", action="store_true", help="the targets stand when their turn comes: don't ask")
    add("--picture", type=Path, metavar="FILE.png", help="how far off the targets are, drawn")
    add("--write", action="store_true", help="put the values into the settings' file")
    options = parser.parse_args(given)
    check_together(parser, options)
    return options


def check_together(parser: Parser, options: argparse.Namespace) -> None:
    """Ends with status 2 where what is given does not go together."""
    if bool(options.at) == (options.readings is not None):
        parser.error("either --at, once for each target, or --readings is needed")
    if len(set(options.at)) < len(options.at):
        parser.error("--at: each distance once")
    try:
        terms_for(len(options.at) if options.at else TERMS)
    except NoFitError as error:
        parser.error(f"--at: {error}")
    picture = options.picture
    if picture is not None:
        if picture.suffix.lower() != ".png" or not picture.parent.is_dir():
            parser.error(f"--picture {picture}: must be a .png in a folder that is there")
        if importlib.util.find_spec("PIL") is None:
            parser.error("--picture needs Pillow: pip install Pillow")


def main(given: list[str] | None = None) -> int:
    """Exit status: 0 done, 1 refused, 2 wrong use."""
    options = arguments(given)
    try:
        text = settings_text(options.config)
        config = load_config(text)
        check_driver(config)
        readings = options.readings
        targets = targets_in(readings) if readings else measured(config, options)
        tell(Report.of(targets, config, options.placed), options, text)
    except (ConfigError, PortUrlError, ReadingsError, OSError) as error:
        return fail(NAME, error)
    except (RefusedError, NoFitError, NotThereError) as error:
        return fail(NAME, error, 1)
    except KeyboardInterrupt:
        return fail(NAME, "broken off; nothing is written", 1)
    return 0
