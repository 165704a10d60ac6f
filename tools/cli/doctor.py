"""Whether this machine can run mapod well: one line each, and what to do.

Looks at libraries, settings, kernels, ports, the way to the scanner, calibration, recordings,
real-time rights, cores, clocks, disk and service. It sends no byte to any device. Run it as the
user who runs mapod: rights are told of that one.
"""

import json
import platform
import sys
from collections.abc import Iterator
from dataclasses import asdict
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path

from tools.cli.options import parser_of
from tools.doctor.finding import Finding, status_of

LIBRARIES = ("numpy", "numba", "msgspec", "pyserial", "cobs", "mcap", "zstandard", "rich")
PYTHON = (3, 11)
STATE = Path("/var/lib/mapod")  # where the service is started; by hand it is the folder one is in


def find_python() -> Iterator[Finding]:
    """Python and the libraries of `pyproject.toml`."""
    version = platform.python_version()
    if sys.version_info < PYTHON:
        yield Finding("fault", "Python", version, "Install Python 3.11 or newer")
    else:
        yield Finding("OK", "Python", f"{version} on {platform.machine()}")
    found, lacking = [], []
    for name in LIBRARIES:
        try:
            found.append(f"{name} {metadata.version(name)}")
        except metadata.PackageNotFoundError:
            lacking.append(name)
    if lacking:
        advice = "Install mapod anew: pip install brings them"
        yield Finding("fault", "libraries", f"no {', no '.join(lacking)}", advice)
    else:
        yield Finding("OK", "libraries", ", ".join(found))


def find_app(path: Path, base: Path) -> Iterator[Finding]:
    """Settings, kernels, ports, calibration and recordings; needs the libraries."""
    from config_file import read_key
    from core.config import ConfigError
    from tools.cli.options import configured
    from tools.doctor.calibrated import maybe_of_ranges, of_calibration
    from tools.doctor.kernels import of_kernels
    from tools.doctor.storage import find_storage
    from tools.doctor.wires import find_wires
    from wiring import check_ports

    try:
        config = configured(path)
        check_ports(config)
        read_key(config.planner.key_file)
    except ConfigError as error:
        yield Finding("fault", "settings", str(error))
        return
    yield Finding("OK", "settings", f"{path} can be used")
    yield of_kernels(config)
    yield from find_wires(config, Path("/"))
    text, now = path.read_text(encoding="utf-8"), datetime.now(UTC)
    yield of_calibration(text, now)
    if ranges := maybe_of_ranges(text, now, config.scanner):
        yield ranges
    yield from find_storage(config, base)


def find_all(path: Path) -> Iterator[Finding]:
    from tools.doctor.machine import find_machine
    from tools.doctor.service import find_service, maybe_unit
    from version import version

    python = list(find_python())
    yield from python
    if status_of(python) == 2:
        return
    base = STATE if STATE.is_dir() else Path()
    yield from find_app(path, base)
    yield from find_machine(Path("/"), base)
    yield from find_service(maybe_unit(), version())


def main(arguments: list[str] | None = None) -> int:
    """Exit status: 0 all is fine, 1 mapod runs but lacks something, 2 it can't run."""
    parser = parser_of("doctor", __doc__, "mapod doctor --config /etc/mapod/mapod.toml")
    parser.add_config()
    parser.add_argument("--json", action="store_true", help="for programs: a list of findings")
    options = parser.parse_args(arguments)
    findings = []
    for finding in find_all(options.config):
        if not options.json:
            print(finding, flush=True)
        findings.append(finding)
    if options.json:
        print(json.dumps([asdict(finding) for finding in findings], indent=1))
    return status_of(findings)
