"""Whether this machine can run mapod well: one line each, and what to do.

Looks at libraries, settings, kernels, ports, real-time rights, cores, clock, disk and service.
It sends no byte to any device. Run it as the user who runs mapod: rights are told of that one.
"""

import platform
import sys
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

from tools.cli.options import parser_of
from tools.doctor.finding import Finding, status_of

LIBRARIES = ("numpy", "numba", "msgspec", "pyserial", "cobs", "rich")
PYTHON = (3, 11)


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


def find_app(path: Path) -> Iterator[Finding]:
    """Settings, kernels and ports; needs the libraries."""
    from config_file import read_key
    from core.config import ConfigError
    from tools.cli.options import configured
    from tools.doctor.kernels import of_kernels
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


def find_all(path: Path) -> Iterator[Finding]:
    from tools.doctor.machine import find_machine
    from tools.doctor.service import find_service, maybe_unit
    from version import version

    python = list(find_python())
    yield from python
    if status_of(python) == 2:
        return
    yield from find_app(path)
    state = Path("/var/lib/mapod")
    yield from find_machine(Path("/"), state if state.is_dir() else Path())
    yield from find_service(maybe_unit(), version())


def main(arguments: list[str] | None = None) -> int:
    """Exit status: 0 all is fine, 1 mapod runs but lacks something, 2 it can't run."""
    parser = parser_of("doctor", __doc__, "mapod doctor --config /etc/mapod/mapod.toml")
    parser.add_config()
    options = parser.parse_args(arguments)
    findings = []
    for finding in find_all(options.config):
        print(finding, flush=True)
        findings.append(finding)
    return status_of(findings)
