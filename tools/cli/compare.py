"""A real device and its fake, asked the same.

Asks both the same questions, listens to what both send, and lists what differs: which commands are
answered and how, how soon, how often data come, counters, layout, values. It asks only what changes
nothing (an MTi stops measuring for a moment, and measures again); --also-settings asks more. Close
mapod first: a port has one reader. Without --fake the fake is started here, as alike as can be.
"""

import argparse
import contextlib
import json
import sys
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path

from rich.console import Console
from rich.table import Table

from core.config import ConfigError
from hw.ports.url import parse_url
from hw.ports.wires import PortUrlError
from tools.cli.conversation import NoAnswerError, RefusedError
from tools.cli.options import configured, fail, lacks_simulation, parser_of
from tools.compare import ahrs as compare_ahrs
from tools.compare import drive as compare_drive
from tools.compare import scanner as compare_scanner
from tools.compare.facts import Difference, Portrait, differences
from tools.terminal.processes import Child, RunError, Stop, first_words_of
from tools.terminal.progress import advancing

PLANNER = (
    "a receiver of the planner link is checked by its conformance tests: "
    "mapod link-test --port {url}"
)
Look = Callable[[str, float, bool], Portrait]
LOOKS: dict[str, Look] = {
    "scanner": compare_scanner.portrait,
    "ahrs": compare_ahrs.portrait,
    "drive": compare_drive.portrait,
}

ALIKE = {"scanner": compare_scanner.make_alike, "ahrs": compare_ahrs.make_alike}


def fake_like(device: str, real: Portrait) -> list[str]:
    if device == "scanner":
        return ["fakes.programs.lms1xx", "--port", "0", *_scanner_options(real)]
    if device == "ahrs":
        legacy = "MTData" in str(real.get("stream: messages", "MTData")).split()
        return ["fakes.programs.mti", *(() if legacy else ("--model", "MTi-30"))]
    logs = str(real.get("as found", "")).startswith("sends")
    watched = str(real.get("^00: values", "")).startswith("02")
    return [
        "fakes.programs.ax3500",
        "--mode",
        "rc" if logs else "rs232_watchdog" if watched else "rs232",
    ]


def _scanner_options(real: Portrait) -> list[str]:
    options = ["--dialect", str(real["dialect"])]
    rate = real.get("scan: scans a second")
    layout = str(real.get("scan DIST1: layout", ""))
    if rate is not None and rate.value in (25.0, 50.0):
        options += ["--scan-rate", f"{rate.value:g}"]
    for step in ("0.25", "0.5"):
        if f"steps of {step} deg" in layout:
            options += ["--angular-step", step]
    return options


@contextlib.contextmanager
def running(command: list[str]) -> Iterator[str]:
    """The port of a fake that runs meanwhile. Raises RunError: it does not start."""
    with tempfile.TemporaryDirectory(prefix="mapod-compare-") as folder:
        fake = Child("fake", [sys.executable, "-m", *command], Path(folder))
        try:
            told = first_words_of(fake, Stop())
            yield next(value for value in told.values() if "://" in value)
        finally:
            fake.end()


def compared(
    device: str, real: str, fake: str | None, seconds: float, settings: bool
) -> tuple[Portrait, Portrait]:
    """Portraits of both; fake None: one is started. Raises NoAnswerError, RunError."""
    look = LOOKS[device]
    if fake is not None:
        with ThreadPoolExecutor(2) as pool:
            both = [pool.submit(look, url, seconds, settings) for url in (real, fake)]
            return both[0].result(), both[1].result()
    portrait = look(real, seconds, settings)
    with running(fake_like(device, portrait)) as url:
        if device in ALIKE:
            ALIKE[device](real, url)
        return portrait, look(url, seconds, settings)


def show(found: list[Difference], facts: int, console: Console) -> None:
    if not found:
        console.print(f"{facts} facts, no difference")
        return
    table = Table(title=f"{facts} facts, {sum(one.counts for one in found)} differ")
    for column in ("", "what", "real", "fake"):
        table.add_column(column, overflow="fold")
    for one in sorted(found, key=lambda one: not one.counts):
        style = "" if one.counts else "dim"
        table.add_row(
            "differs" if one.counts else "its own", one.name, one.real, one.fake, style=style
        )
    console.print(table)


def arguments(given: list[str] | None) -> argparse.Namespace:
    parser = parser_of(
        "compare", __doc__, "mapod compare scanner --port tcp://192.168.0.1:2112 --out facts.json"
    )
    add = parser.add_argument
    add("device", choices=(*LOOKS, "planner"))
    parser.add_port("tcp://192.168.0.1:2112, the real device")
    parser.add_config()
    add("--fake", help="port of a fake that runs already (default: start one)")
    parser.add_seconds("to listen to its stream; 5", 5.0)
    add(
        "--also-settings",
        action="store_true",
        help="also what needs a login, a reset, or stops motors; nothing is stored",
    )
    parser.add_out("a file for all facts of both, as JSON")
    return parser.parse_args(given)


def main(given: list[str] | None = None) -> int:
    """Exit status: 0 no difference that counts, 1 differences, 2 wrong use or no answer."""
    options = arguments(given)
    if options.device == "planner":
        return fail("compare", PLANNER.format(url=options.port or "URL"))
    if options.fake is None and (why := lacks_simulation()):
        return fail("compare", f"{why}; or name a fake that runs: --fake URL")
    try:
        url = options.port or getattr(configured(options.config), options.device).port
        for port in (url, options.fake):
            if port is not None:
                parse_url(port)
        with advancing("asking", None):
            real, fake = compared(
                options.device, url, options.fake, options.seconds, options.also_settings
            )
    except (ConfigError, PortUrlError, NoAnswerError, RefusedError, RunError, OSError) as error:
        return fail("compare", error)
    found = differences(real, fake)
    if options.out:
        facts = {
            side: {name: asdict(fact) for name, fact in portrait.items()}
            for side, portrait in (("real", real), ("fake", fake))
        }
        options.out.write_text(json.dumps(facts, indent=1), encoding="utf-8")
    show(found, len(real.keys() | fake.keys()), Console())
    return 1 if any(one.counts for one in found) else 0
