"""Holds requirements.lock against a public list of known weaknesses: `make audit`. Needs a network.

pip-audit asks for each library of the lock at its version; it lies in a folder of its own, so that
it is no library of mapod's. Silence is no good news: a library that the list does not know, and a
list that can't be reached, are told, and end in exit status 2. A known weakness ends in 1.
"""

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tools.deps.lock import FILE

CLEAN, WEAK, UNKNOWN = 0, 1, 2  # exit status
SERVICES = "pypi", "osv"  # lists that can be asked
TOLD = 8  # names of libraries in a line, at most


@dataclass(slots=True)
class Audit:
    """What a list says of the lock."""

    known: list[str] = field(default_factory=list)  # libraries that it knows at their version
    unknown: list[str] = field(default_factory=list)  # and that it does not
    weak: list[str] = field(default_factory=list)  # a line for each weakness

    @property
    def status(self) -> int:
        if self.weak:
            return WEAK
        return UNKNOWN if self.unknown or not self.known else CLEAN

    def lines(self) -> list[str]:
        """For a person."""
        total = len(self.known) + len(self.unknown)
        lines = [*self.weak]
        lines.append(
            f"{len(self.known)} of {total} libraries of {FILE.name} were held against the list; "
            f"{len(self.weak)} known weaknesses"
        )
        if self.unknown:
            more = " ..." if len(self.unknown) > TOLD else ""
            lines.append(f"the list did not tell of {', '.join(self.unknown[:TOLD])}{more}")
        if not self.known:
            lines.append("so nothing is known: is there a network, and does it reach the list?")
        return lines


def audit_from_report(report: Mapping[str, Any]) -> Audit:
    """From pip-audit's report in JSON.

    >>> audit_from_report({"dependencies": [{"name": "a", "skip_reason": "not found"}]}).status
    2
    """
    audit = Audit()
    for found in report["dependencies"]:
        if "skip_reason" in found:
            audit.unknown.append(found["name"])
            continue
        audit.known.append(found["name"])
        for one in found["vulns"]:
            names = ", ".join([one["id"], *one.get("aliases", ())])
            fixed = ", ".join(one.get("fix_versions", ())) or "no version yet"
            audit.weak.append(f"{found['name']} {found['version']}: {names}; mended in {fixed}")
    return audit


def report_of(folder: Path, service: str) -> Mapping[str, Any] | str:
    """What pip-audit of that folder reports, or the last line of why it can't."""
    command = [sys.executable, "-m", "pip_audit", "--format", "json", "--progress-spinner", "off"]
    command += ["--disable-pip", "--require-hashes", "--requirement", str(FILE)]
    command += ["--vulnerability-service", service]
    around = {**os.environ, "PYTHONPATH": str(folder)}
    done = subprocess.run(command, env=around, capture_output=True, text=True, check=False)
    try:
        report: Mapping[str, Any] = json.loads(done.stdout)
    except ValueError:
        return (done.stderr.strip().splitlines() or ["pip-audit said nothing"])[-1][:300]
    return report


def main() -> int:
    parser = argparse.ArgumentParser(prog="make audit", description=__doc__.split("\n")[0])
    parser.add_argument("--tool", type=Path, required=True, help="folder that has pip-audit")
    parser.add_argument("--service", choices=SERVICES, default="pypi", help="which list is asked")
    options = parser.parse_args()
    report = report_of(options.tool, options.service)
    if isinstance(report, str):
        print(f"mapod: nothing was looked at: {report}")
        print("mapod: the list of known weaknesses is on the network, and can't be asked from here")
        return UNKNOWN
    audit = audit_from_report(report)
    for line in audit.lines():
        print(f"mapod: {line}")
    return audit.status


if __name__ == "__main__":
    sys.exit(main())
