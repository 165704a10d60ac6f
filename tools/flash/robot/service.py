"""systemd's side of it: units in their places, restarts, and what counts as healthy.

Healthy is: the unit is active and its app has said that it is ready, for HOLD_S in one process, and
everything that ran under the version before (docs/service.md: the words of the unit's status) runs
again. What did not run before, such as a scanner that is not plugged in, bars no flash.
"""

import os
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from tools.flash.robot.places import FlashError, Places, put_file, put_link, relative

UNIT = "mapod.service"
RUNS = ("running", "told", "heard")  # words for: this input, or this link, works
HOLD_S = 3.0
LOOK_EACH_S = 0.5
RECOVER = "/opt/mapod/recover"
PROPERTIES = "LoadState,ActiveState,SubState,MainPID,StatusText"


@dataclass(frozen=True)
class State:
    """What systemd says of the service now."""

    load: str = "not-found"
    active: str = "inactive"
    sub: str = "dead"
    process: str = "0"
    words: str = ""

    @property
    def is_ready(self) -> bool:
        return self.active == "active" and self.sub == "running"

    @property
    def runs(self) -> set[str]:
        """The names of what works: "scanner", "planner 2"."""
        parts = [part.partition(":")[0].rpartition(" ") for part in self.words.split("; ")]
        return {name for name, _, state in parts if state in RUNS and self.is_ready}

    def describe(self) -> str:
        return f"{self.active} ({self.sub})" + (f": {self.words}" if self.words else "")


class Service:
    """mapod as systemd runs it."""

    exists = True

    def state(self) -> State:
        said = systemctl("show", UNIT, f"--property={PROPERTIES}").stdout
        of = dict(line.partition("=")[::2] for line in said.splitlines())
        keys = ("LoadState", "ActiveState", "SubState", "MainPID", "StatusText")
        return State(*(of.get(key, "") for key in keys))

    def restart(self) -> None:
        """Begins to run what is current now. Raises FlashError: its unit is refused."""
        systemctl("daemon-reload")
        if shutil.which("udevadm"):
            subprocess.run(["udevadm", "control", "--reload"], capture_output=True, check=False)
        if (load := self.state().load) != "loaded":
            raise FlashError(f"systemd does not take {UNIT}: {load}")
        systemctl("reset-failed", UNIT)
        done = systemctl("--no-block", "restart", UNIT)
        if done.returncode:
            raise FlashError(f"systemd does not start {UNIT}: {last_line(done.stderr)}")

    def wait_until_healthy(self, before: State, seconds: float) -> str:
        """Waits so long at most. Gives why it is not healthy, or "" where it is."""
        until_s, well_since_s = time.monotonic() + seconds, 0.0
        last, missing = State(), list[str]()
        while (now_s := time.monotonic()) < until_s:
            state = self.state()
            missing = sorted(before.runs - state.runs)
            if state.process != last.process or not state.is_ready or missing:
                well_since_s = now_s
            last = state
            if state.active == "failed":
                break
            if now_s - well_since_s >= HOLD_S:
                return ""
            time.sleep(LOOK_EACH_S)
        if last.is_ready and missing:
            return f"{', '.join(missing)} ran before and does not now: {last.words}"
        return f"the app does not come up: {last.describe()}"

    def last_words(self) -> list[str]:
        """The end of its log, without what systemd says of it."""
        if not shutil.which("journalctl"):
            return []
        command = [
            "journalctl",
            f"_SYSTEMD_UNIT={UNIT}",
            "--lines=12",
            "--output=cat",
            "--no-pager",
        ]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        return done.stdout.splitlines()


class NoService:
    """Where nothing is started: an image, a second root, a container."""

    exists = False

    def state(self) -> State:
        return State()

    def restart(self) -> None:
        """Nobody is there to do it."""

    def wait_until_healthy(self, before: State, seconds: float) -> str:
        return ""

    def last_words(self) -> list[str]:
        return []


def service_of(places: Places, asked: str | None) -> Service | NoService:
    """What "mapod", "none" or no word at all means here. Raises FlashError: no systemd."""
    is_here = (places.root / "run/systemd/system").is_dir() and shutil.which("systemctl")
    if asked == "none" or (asked is None and places.root != Path("/")):
        return NoService()
    if not is_here:
        raise FlashError("systemd does not run here: --service none installs without a service")
    return Service()


def systemctl(*words: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(["systemctl", *words], capture_output=True, text=True, check=False)


def last_line(text: str) -> str:
    return (text.strip().splitlines() or ["no reason given"])[-1]


def put_recovery(places: Places, content: bytes, unit: bytes) -> None:
    """What undoes a cut flash. It belongs to no version."""
    put_file(places.home / "recover", content, 0o755)
    places.units.mkdir(parents=True, exist_ok=True)
    put_file(places.units / "mapod-recover.service", unit)
    want(places, "mapod-recover.service")


def want(places: Places, unit: str) -> None:
    """Starts a unit with the system, as `systemctl enable` does."""
    wants = places.units / "multi-user.target.wants"
    wants.mkdir(parents=True, exist_ok=True)
    put_link(wants / unit, f"../{unit}")


def put_system_links(places: Places) -> list[str]:
    """Unit, rules and command as links through `current`; gives what is somebody else's there."""
    own = []
    for link, file in (
        (places.units / UNIT, UNIT),
        (places.root / "etc/udev/rules.d/99-mapod.rules", "99-mapod.rules"),
        (places.root / "usr/local/bin/mapod", "bin/mapod"),
    ):
        link.parent.mkdir(parents=True, exist_ok=True)
        says = relative(link, places.current) + f"/{file}"
        if link.is_symlink() and os.readlink(link) == says:
            continue
        if link.exists() or link.is_symlink():
            own.append(f"/{link.relative_to(places.root)}")
            continue
        put_link(link, says)
        if file == UNIT:
            want(places, UNIT)
    return own


def make_user(places: Places, sysusers: Path) -> None:
    """The user that the service runs as. Raises FlashError: it can't be made."""
    passwd = places.root / "etc/passwd"
    if passwd.exists() and "\nmapod:" in "\n" + passwd.read_text(errors="replace"):
        return
    done = subprocess.run(
        ["systemd-sysusers", f"--root={places.root}", str(sysusers)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode:
        raise FlashError(f"can't make the user mapod: {last_line(done.stderr)}")


def detached(command: list[str]) -> int | None:
    """Runs a command as a unit of its own, which no lost connection ends; None: can't be had.

    Where it is killed, systemd undoes at once what it had begun.
    """
    if not shutil.which("systemd-run") or not Path("/run/systemd/system").is_dir():
        return None
    undo = f"--property=ExecStopPost=-{RECOVER} --restart"
    words = ["systemd-run", "--pipe", "--wait", "--collect", "--quiet", undo, "--", *command]
    return subprocess.run(words, check=False).returncode


def base_python() -> str:
    """The Python that runs this, outside of any virtual environment."""
    return os.path.realpath(getattr(sys, "_base_executable", sys.executable))
