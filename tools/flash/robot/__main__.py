"""The command on the robot: `install` out of a bundle, `status`, `rollback`."""

import argparse
import errno
import os
import signal
import sys
from pathlib import Path
from typing import NoReturn

from tools.flash.robot.install import Flash, install
from tools.flash.robot.package import Package
from tools.flash.robot.places import FlashError, Places
from tools.flash.robot.service import base_python, detached, service_of
from tools.flash.robot.status import rollback, status

FULL = (errno.ENOSPC, errno.EDQUOT)


class Parser(argparse.ArgumentParser):
    """Wrong use is one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message} ({self.prog} --help)\n")


def tell(line: str) -> None:
    """To whoever listens; a connection that is lost ends nothing."""
    try:
        print(f"robot: {line}", flush=True)
    except OSError:
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115


def arguments(given: list[str], program: str) -> argparse.Namespace:
    parser = Parser(prog=program, description=__doc__, allow_abbrev=False)
    add = parser.add_argument
    add("action", choices=("install", "status", "rollback"))
    add("--root", type=Path, default=Path("/"), help="another root file system (default: /)")
    add("--service", choices=("mapod", "none"), help="restart it, or start nothing")
    add("--health-seconds", type=float, default=30.0, help="for the app to be well (default: 30)")
    add("--python", default=base_python(), help="the Python that mapod will run with")
    add("--again", action="store_true", help="also a version that runs already: another processor")
    add("--here", action="store_true", help="in this process, not as a unit of its own")
    return parser.parse_args(given)


def main(given: list[str], bundle: Path) -> int:
    """Exit status: 0 done, 1 refused or gone back, 2 wrong use."""
    options = arguments(given, bundle.name)
    is_root = options.root == Path("/")
    if options.action != "status" and is_root and not options.here and os.geteuid() == 0:
        again = [sys.executable, "-IS", str(bundle.resolve()), *given, "--here"]
        if (ended := detached(again)) is not None:
            return ended
    os.umask(0o022)
    os.nice(10)  # what runs on the robot meanwhile comes first
    signal.signal(signal.SIGHUP, signal.SIG_IGN)  # a lost connection ends no flash
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        act(options, bundle)
    except FlashError as error:
        print(f"mapod flash: {error}", file=sys.stderr)
        return 1
    except OSError as error:
        full = "the disk got full: nothing is changed" if error.errno in FULL else error
        print(f"mapod flash: {full}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("mapod flash: broken off", file=sys.stderr)
        return 130
    return 0


def act(options: argparse.Namespace, bundle: Path) -> None:
    places = Places(options.root.resolve())
    if options.action == "status":
        status(places, tell)
        return
    service = service_of(places, options.service)
    if options.action == "rollback":
        rollback(places, service, options.health_seconds, tell)
        return
    package = Package(bundle)
    flash = Flash(
        package, places, service, options.python, options.health_seconds, tell, options.again
    )
    install(flash)
