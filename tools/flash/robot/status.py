"""What runs on the robot, and the way back to what ran before."""

import json
import os
import shutil
from pathlib import Path
from typing import Any

from tools.flash.robot.checks import check_root
from tools.flash.robot.package import MANIFEST
from tools.flash.robot.places import FlashError, Places, check_form, is_locked, locked
from tools.flash.robot.service import NoService, Service
from tools.flash.robot.settings import adopt, difference, edits, is_ours, settings_now
from tools.flash.robot.switch import Tell, finish_cut, switch


def status(places: Places, tell: Tell) -> None:
    """Version, the one before, service, settings, space: a line each."""
    current, previous = places.version(places.current), places.version(places.previous)
    if is_locked(places):
        tell(f"a flash is at work{who(places)}")
    elif places.trial.is_symlink():
        tell("a flash was cut: the next start goes back to the version before it")
    if current is None:
        tell("no version of mapod is flashed here")
        return
    tell(f"runs {current}{commit_of(places, current)}")
    tell(f"before that: {previous}{commit_of(places, previous)}" if previous else "no earlier one")
    if places.root == Path("/") and Path("/run/systemd/system").is_dir():
        tell(f"service: {Service().state().describe()}")
    changed = edits(places, current)
    where = "/etc/mapod/mapod.toml"
    if not is_ours(places):
        tell(f"settings: {where}, a file of your own, which the next flash takes over")
    else:
        tell(f"settings: {where}, " + ("changed since the flash:" if changed else "as flashed"))
    for line in changed:
        tell(f"  {line}")
    tell(f"free: {shutil.disk_usage(places.home).free / 1e6:.0f} MB")


def who(places: Places) -> str:
    """For root alone."""
    return f": {places.lock.read_text().strip()}" if os.access(places.lock, os.R_OK) else ""


def commit_of(places: Places, name: str) -> str:
    """ " (of commit 1234abc)", where the manifest says so."""
    path = places.versions / name / MANIFEST
    about: dict[str, Any] = json.loads(path.read_text()) if path.exists() else {}
    return f" (of commit {about['commit']})" if about.get("commit") else ""


def rollback(places: Places, service: Service | NoService, health_s: float, tell: Tell) -> None:
    """Raises FlashError: there is no version to go back to, or it does not work."""
    check_root(places)
    check_form(places)
    with locked(places, "a rollback"):
        finish_cut(places, service, tell)
        name, current = places.version(places.previous), places.version(places.current)
        if name is None or current is None:
            raise FlashError("there is no earlier version to go back to")
        if told := adopt(places):
            tell(told)
        now, then = settings_now(places), places.settings_of(name)
        if now and then.exists():
            changes = difference(now.read_bytes(), then.read_bytes(), now.name, then.name)
            if changes:
                tell(f"its settings come back too; those of {current} stay in /etc/mapod/settings:")
            for line in changes:
                tell(f"  {line}")
        tell(f"going back from {current} to {name}")
        switch(places, name, service, health_s, tell)
        tell(f"{name} is back" + ("" if service.exists else "; nothing is started"))
