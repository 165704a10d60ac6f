"""The systemd service: is it installed, does it run, with which rights, and is it this version."""

import os
import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

from tools.doctor.finding import Finding
from tools.doctor.machine import of_rights, rights_here

UNIT = "mapod.service"
ASKED = (
    "LoadState",
    "ActiveState",
    "SubState",
    "StatusText",
    "NRestarts",
    "MainPID",
    "LimitRTPRIO",
    "LimitMEMLOCK",
)
INSTALLED = Path("/opt/mapod/current/bin/mapod")
INFINITY = 2**64 - 1


def maybe_unit() -> dict[str, str] | None:
    """What systemd knows of the unit; None where no systemd runs."""
    if shutil.which("systemctl") is None:
        return None
    command = ["systemctl", "show", UNIT, "--property", ",".join(ASKED)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        return None
    return dict(line.split("=", 1) for line in done.stdout.splitlines() if "=" in line)


def find_service(unit: dict[str, str] | None, version: str) -> Iterator[Finding]:
    """The unit as systemd describes it; the rights are the unit's where it is installed."""
    if unit is None or unit.get("LoadState") != "loaded":
        why = "no systemd runs here" if unit is None else f"{UNIT} is not installed"
        yield Finding("OK", "service", why)
        yield of_rights(*rights_here(), "this user")
        return
    yield of_state(unit)
    if unit["ActiveState"] == "active":
        yield of_process(int(unit["MainPID"]))
    else:
        yield of_rights(_limit(unit["LimitRTPRIO"]), _limit(unit["LimitMEMLOCK"]), UNIT)
    if INSTALLED.exists():
        told = subprocess.run([INSTALLED, "version"], capture_output=True, text=True, check=False)
        yield of_version(told.stdout.strip(), f"mapod {version}")


def of_state(unit: dict[str, str]) -> Finding:
    state, text = unit["ActiveState"], unit["StatusText"] or "says nothing"
    restarts = f", {unit['NRestarts']} restarts" if unit["NRestarts"] not in ("", "0") else ""
    says = f"{UNIT} is {state} ({unit['SubState']}{restarts}): {text}"
    if state == "active":
        return Finding("warning" if restarts else "OK", "service", says)
    return Finding("warning", "service", says, f"journalctl --unit {UNIT} --lines 50 says why")


def of_process(number: int) -> Finding:
    """The rights that a running app has taken, which may be fewer than its unit gives."""
    try:
        is_fifo = os.sched_getscheduler(number) == os.SCHED_FIFO
        status = Path(f"/proc/{number}/status").read_text(encoding="ascii")
    except OSError:
        return Finding("warning", "real time", f"{UNIT} has just ended")
    is_locked = re.search(r"^VmLck:\s+[1-9]", status, re.MULTILINE) is not None
    return of_rights(99 if is_fifo else 0, -1 if is_locked else 0, f"the process of {UNIT}")


def of_version(installed: str, here: str) -> Finding:
    if installed != here:
        says = f"the service has {installed or 'no version'}, this is {here}"
        return Finding("warning", "version", says, "`mapod flash` brings the service up to date")
    return Finding("OK", "version", f"{here}, as the service's")


def _limit(text: str) -> int:
    """A limit as systemd tells it; -1: none."""
    if text == "infinity":
        return -1
    number = int(text) if text.isdecimal() else 0
    return -1 if number == INFINITY else number
