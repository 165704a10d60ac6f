"""Puts mapod onto a robot: bundle, copy over ssh, install, switch, go back where it does not work.

The robot needs Python, systemd and ssh, no internet. Its settings, keys, maps and recordings stay;
settings that are new are added at the shipped value and shown. Without a host, --status, --rollback
and --from are about this machine. docs/flash.md says what lies where.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from tools.cli.options import ROOT, fail, number_in, parser_of, whole_in
from tools.flash.bundle import make, manifest_of, tell
from tools.flash.remote import Machine, RemoteError, Robot
from tools.flash.wheels import BundleError, Target
from tools.terminal.progress import advancing

FLASH = "opt/mapod/flash"  # on the robot: status and rollback without a bundle
IF_THERE = (
    'test -x "$0" || { echo "mapod flash: nothing is flashed there" >&2; exit 1; }; exec "$0" "$@"'
)
CACHE = ROOT / "build" / "wheels"
FAILED = 1
OLDEST_PYTHON = 11  # 3.11, as pyproject.toml says it
SPARE_BYTES = 10_000_000


def arguments(given: list[str] | None) -> argparse.Namespace:
    examples = (
        "mapod flash user@robot",
        "mapod flash user@robot --rollback",
        "mapod flash --bundle . --arch aarch64",
    )
    parser = parser_of("flash", __doc__, *examples)
    add = parser.add_argument
    add("host", nargs="?", help="as ssh knows it; needed but for --bundle, --from and this machine")
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--status", action="store_true", help="what runs there; changes nothing")
    what.add_argument("--rollback", action="store_true", help="back to the version before")
    what.add_argument("--bundle", type=Path, metavar="FILE", help="only build; a file or a folder")
    there = "take this bundle, which is built already"
    what.add_argument("--from", type=Path, dest="source", metavar="FILE", help=there)
    add("--arch", choices=("x86_64", "aarch64"), help="of --bundle (default: of this machine)")
    add("--python-version", type=a_python, metavar="3.11", help="of --bundle (default: 3.11)")
    add("--python", metavar="PATH", help="the robot's Python, where it is none of its usual ones")
    add("--root", type=Path, help="another root file system there, such as an image's")
    add("--service", choices=("mapod", "none"), help="restart it; none: start nothing")
    add("--health-seconds", type=number_in(1, 600), help="for the app to be well (default: 30)")
    add("--again", action="store_true", help="also a version that runs already")
    add("--ssh-port", type=whole_in(1, 65_535), metavar="N", help="of ssh")
    add("--identity", type=Path, metavar="FILE", help="of ssh")
    add("--ssh-option", action="append", default=[], metavar="KEY=VALUE", help="of ssh, as its -o")
    return parser.parse_args(given)


def main(given: list[str] | None = None) -> int:
    """Exit status: 0 done, 1 refused or gone back: the robot is as it was, 2 wrong use."""
    options = arguments(given)
    try:
        if options.bundle:
            tell(make(_target(options), CACHE, options.bundle))
            return 0
        if options.host:
            return _there(options)
        if options.status or options.rollback or options.source:
            return _here(options)
    except (BundleError, RemoteError) as error:
        return fail("flash", error, FAILED)
    except OSError as error:
        return fail("flash", f"{error.filename or 'ssh'}: {error.strerror}", FAILED)
    return fail("flash", "which robot? mapod flash user@robot (mapod flash --help)")


def a_python(text: str) -> str:
    """ "311" from "3.11"."""
    major, _, minor = text.partition(".")
    if major != "3" or not minor.isdecimal() or int(minor) < OLDEST_PYTHON:
        raise argparse.ArgumentTypeError(f"must be 3.{OLDEST_PYTHON} or newer, is {text}")
    return f"3{minor}"


def _target(options: argparse.Namespace) -> Target:
    return Target(options.arch or os.uname().machine, options.python_version or "311")


def _words(options: argparse.Namespace) -> list[str]:
    """What the robot's side is told."""
    given = {
        "--root": options.root,
        "--service": options.service,
        "--health-seconds": options.health_seconds,
        "--python": options.python,
    }
    words = [str(word) for name, of in given.items() if of is not None for word in (name, of)]
    return words + (["--again"] if options.again else [])


def _here(options: argparse.Namespace) -> int:
    """This machine."""
    if options.source:
        version = str(manifest_of(options.source)["python"])[3:]
        python = options.python or shutil.which(f"python3.{version}") or sys.executable
        command = [python, "-IS", str(options.source), "install"]
    else:
        command = [str((options.root or Path("/")) / FLASH)]
        if not Path(command[0]).exists():
            raise RemoteError("nothing is flashed here")
        command.append("status" if options.status else "rollback")
    return subprocess.run([*command, *_words(options)], check=False).returncode


def _there(options: argparse.Namespace) -> int:
    """A robot, over ssh."""
    ssh = ["-p", str(options.ssh_port)] if options.ssh_port else []
    ssh += ["-i", str(options.identity)] if options.identity else []
    robot = Robot(options.host, ssh + [word for of in options.ssh_option for word in ("-o", of)])
    machine = robot.look()
    if not machine.is_root and not machine.may_sudo:
        raise RemoteError(
            f"{options.host} may not use sudo without a password: log in as root, or allow it there"
        )
    if options.status or options.rollback:
        command = [
            str((options.root or Path("/")) / FLASH),
            "status" if options.status else "rollback",
        ]
        return robot.run(["sh", "-c", IF_THERE, *command, *_words(options)], machine.is_root)
    if options.source:
        return _flash(robot, machine, options.source, options)
    target = Target(machine.arch, _python(options, machine))
    with tempfile.TemporaryDirectory() as folder:
        path = make(target, CACHE, Path(folder))
        tell(path)
        return _flash(robot, machine, path, options)


def _python(options: argparse.Namespace, machine: Machine) -> str:
    if options.python_version:
        return _target(options).python
    if not machine.pythons:
        raise RemoteError(f"{options.host} has no Python 3.11 or newer: apt install python3")
    return machine.pythons[0]


def _flash(robot: Robot, machine: Machine, path: Path, options: argparse.Namespace) -> int:
    manifest = manifest_of(path)
    version = str(manifest["python"])[2:]
    if manifest["arch"] != machine.arch:
        raise RemoteError(f"the bundle is for {manifest['arch']}, {robot.host} is {machine.arch}")
    if options.python is None and version not in machine.pythons:
        has = ", ".join(f"3.{python[1:]}" for python in machine.pythons) or "none"
        raise RemoteError(f"the bundle is for Python 3.{version[1:]}, {robot.host} has {has}")
    total = path.stat().st_size
    if machine.free_bytes < total + SPARE_BYTES:
        free = machine.free_bytes / 1e6
        raise RemoteError(f"the disk of {robot.host} is too full: {free:.0f} MB free in /var/tmp")
    words = f"copying {total / 1e6:.0f} MB to {robot.host}"
    print(words, file=sys.stderr, flush=True)
    with advancing("copying", total) as advance:
        there = robot.send(path, advance)
    python = options.python or f"python3.{version[1:]}"
    return robot.run([python, "-IS", there, "install", *_words(options)], machine.is_root)
