"""The whole way onto a robot: a second root with systemd and sshd, fakes as devices, a planner.

One robot goes through all of it, in order: flash, crash, hang, a broken version, cuts, the next
flash, rollback. `make flash-proof` runs this alone, and tells what it took.
"""

import json
import os
import random
import re
import select
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from mapod_link import FREE, OBSTACLE, Link, open_link
from tests import ROOT
from tests.support.machine.second_root import (
    LOGIN,
    SecondRoot,
    base_image,
    copied,
    disks,
    free_port,
    ran,
    until,
    why_not,
)

pytestmark = pytest.mark.real_time
CUTS = 20
COPY_EACH_S = 0.3  # on average
PATIENCE_S = 60.0
BROKEN = 'raise RuntimeError("broken on purpose")'
STARTED = "    locked, fifo = take_real_time()\n"  # behind all that a flash itself tries
NOT_COPIED = (".*", "__pycache__", "build", "tests", "docs")
ALL_RUN = re.compile(r"scanner running; ahrs running; drive running; planner (told|heard)")


class Robot:
    """The second root with a planner, and the ways in which a person deals with it."""

    def __init__(self, root: SecondRoot, planner: Link) -> None:
        self.root, self.planner = root, planner

    def flash(self, *words: str | Path) -> "subprocess.Popen[str]":
        """`mapod flash` from this checkout, begun."""
        options = [
            word for pair in self.root.options.items() for word in ("--ssh-option", "=".join(pair))
        ]
        reached = ["--ssh-port", str(self.root.port), "--identity", str(self.root.identity)]
        command = [sys.executable, "-m", "mapod", "flash", LOGIN, *reached, *options]
        return subprocess.Popen(
            [*command, *map(str, words)], cwd=ROOT, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip

    def flashed(self, *words: str | Path) -> tuple[int, str]:
        """Its exit status, and what it said."""
        process = self.flash(*words)
        said, _ = process.communicate()
        return process.returncode, said

    def unit(self, name: str) -> str:
        """A property of the service."""
        return self.root.said(f"systemctl show mapod --property {name} --value")

    def version(self) -> str:
        return self.root.said("readlink /opt/mapod/current")

    def comes_to_run(self) -> None:
        """With all its devices."""
        until(lambda: ALL_RUN.fullmatch(self.unit("StatusText")), "all devices run", self.how_it_is)

    def how_it_is(self) -> str:
        """What systemd says of the service, and the end of its log."""
        state = "systemctl show mapod --property ActiveState,SubState,NRestarts,StatusText"
        log = "journalctl --unit mapod --output cat --no-pager --lines 100"
        return self.root.asked(f"{state}; {log}").stdout

    def signal(self, name: str) -> float:
        """To the app, as the kernel does: systemd has not asked for it. When, since the epoch."""
        return float(self.root.said(f"date +%s.%N; kill -{name} {self.unit('MainPID')}"))

    def maps(self) -> bool:
        """Whether the planner has a map that is worth something."""
        known = self.planner.receiver
        if known.pose is None or known.pose.mode != 1:
            return False
        return bool((known.cells == FREE).any() and (known.cells == OBSTACLE).any())

    def session(self) -> int:
        geom = self.planner.receiver.geom
        return geom.session if geom else 0

    def maps_anew(self, begin: Callable[[], float]) -> float:
        """Seconds from what ends the app to the first good map of another run of it."""
        assert self.planner.wait_for(lambda _: self.maps(), PATIENCE_S)
        before = self.session()
        begun_s = begin()
        assert self.planner.wait_for(lambda _: self.session() != before and self.maps(), PATIENCE_S)
        return time.time() - begun_s


def tell(text: str) -> None:
    """To who looks on: `pytest -s`."""
    sys.stdout.write(f"\n{text}\n")


def settings(ports: dict[str, str], planner: str) -> str:
    """The shipped ones, with these devices."""
    text = (ROOT / "mapod.toml").read_text(encoding="utf-8")
    for name, url in (*ports.items(), ("planner", planner)):
        text, count = re.subn(rf'(\[{name}\][^\[]*?\nport = )"[^"]+"', rf'\1"{url}"', text)
        assert count == 1, name
    return text


@pytest.fixture(scope="module")
def fakes() -> Iterator[dict[str, str]]:
    """The URLs of devices that serve for as long as the tests run."""
    command = [sys.executable, "-m", "fakes", "--all-tcp", "--no-driver", "--until-stdin-closes"]
    with subprocess.Popen(
        command, cwd=ROOT, text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        assert process.stdout
        yield json.loads(process.stdout.readline())
        process.terminate()


@pytest.fixture(scope="module")
def bundles(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with `good.pyz`, `broken.pyz` and `next.pyz`; only the first is this checkout."""
    folder = tmp_path_factory.mktemp("bundles")
    for name, old, new in (
        ("good", "", ""),
        ("broken", STARTED, f"    {BROKEN}\n{STARTED}"),
        ("next", "SETTLE_S = 0.5", "SETTLE_S = 0.4"),
    ):
        tree = folder / name
        shutil.copytree(ROOT, tree, ignore=shutil.ignore_patterns(*NOT_COPIED))
        shutil.copytree(ROOT / "docs", tree / "docs")
        (ROOT / "build").mkdir(exist_ok=True)
        (tree / "build").symlink_to(ROOT / "build")  # the libraries are downloaded once
        text = (tree / "main.py").read_text(encoding="utf-8")
        assert old in text, name
        (tree / "main.py").write_text(text.replace(old, new, 1), encoding="utf-8")
        bundle = str(folder / f"{name}.pyz")
        command = [sys.executable, "-m", "mapod", "flash", "--bundle", bundle]
        done = subprocess.run(command, cwd=tree, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture(scope="module")
def robot(fakes: dict[str, str], tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    """Debian as installed, with the robot's settings, and nothing of mapod."""
    if why := why_not():
        pytest.skip(why)
    folder = tmp_path_factory.mktemp("robot")
    url = f"udp://127.0.0.1:{free_port()}"
    with disks(folder) as place, open_link(url) as planner:
        ran("cp", "--sparse=always", base_image(), place / "robot.ext4")
        root = SecondRoot(place / "robot.ext4", folder)
        with root.opened() as files:
            (files / "etc/mapod").mkdir()
            (files / "etc/mapod/mapod.toml").write_text(settings(fakes, url))
        root.boot()
        try:
            yield Robot(root, planner)
        finally:
            root.close()


def test_a_flash_brings_a_map_to_the_planner(robot: Robot, bundles: Path) -> None:
    status, said = robot.flashed("--from", bundles / "good.pyz")
    assert status == 0, said
    assert robot.planner.wait_for(lambda _: robot.maps(), PATIENCE_S)
    robot.comes_to_run()
    about = robot.root.said(f"cat /proc/{robot.unit('MainPID')}/status")
    assert re.search(r"CapEff:\s0+\n", about)
    assert re.search(r"Seccomp:\s2\n", about)
    uid = robot.root.said("id --user mapod")
    assert re.search(rf"Uid:\s{uid}\s{uid}\s{uid}\s{uid}\n", about)
    doctor = robot.root.asked(
        "su -s /bin/sh mapod -c 'mapod doctor --config /etc/mapod/mapod.toml'"
    )
    assert re.search(r"^OK +kernels", doctor.stdout, re.MULTILINE), doctor.stdout
    assert doctor.returncode in (0, 1), doctor.stdout


def test_a_crash_and_a_loop_that_hangs_are_over_by_themselves(robot: Robot) -> None:
    crashed_s = robot.maps_anew(lambda: robot.signal("KILL"))
    assert robot.unit("NRestarts") == "1"
    hung_s = robot.maps_anew(lambda: robot.signal("STOP"))
    assert robot.unit("NRestarts") == "2"
    log = robot.root.said("journalctl --unit mapod --output cat")
    assert "Watchdog timeout" in log
    assert log.count("app_started") == 3
    assert log.count("state=running") >= 9  # three devices, three times
    assert "Traceback" not in log
    assert robot.root.said("find /var/cache/mapod -type f") == ""  # the flash has compiled all
    tell(
        f"the planner has a map again {crashed_s:.1f} s after a crash, {hung_s:.1f} s after a hang"
    )


@pytest.fixture(scope="module")
def cut_disks(robot: Robot, bundles: Path) -> list[Path]:
    """What a power cut would have left, at random moments of a flash that has to go back.

    Half of them from before the new version is tried, half from then on.
    """
    chance, before, said = random.Random(1), robot.version(), ""
    taken: dict[bool, list[Path]] = {False: [], True: []}
    with robot.flash("--from", bundles / "broken.pyz", "--health-seconds", "8") as flash:
        assert flash.stdout
        while flash.poll() is None:
            disks = taken["restarting the service" in said]
            disks.append(copied(robot.root.disk, f"cut-{len(taken[False])}-{len(taken[True])}"))
            wait_s = chance.uniform(0.0, 2 * COPY_EACH_S)
            if select.select([flash.stdout], [], [], wait_s)[0]:
                said += os.read(flash.stdout.fileno(), 4096).decode()
        said += flash.stdout.read()
    assert flash.returncode == 1, said
    assert robot.version() == before, said
    assert "broken on purpose" in said, said
    chosen = [disk for disks in taken.values() for disk in chance.sample(disks, CUTS // 2)]
    for disk in {*taken[False], *taken[True]} - {*chosen}:
        disk.unlink()
    return chosen


def test_a_broken_version_goes_back_by_itself(robot: Robot, cut_disks: list[Path]) -> None:
    robot.comes_to_run()
    assert robot.planner.wait_for(lambda _: robot.maps(), PATIENCE_S)
    assert robot.root.asked("ls /opt/mapod/trial").returncode != 0


def test_cut_at_any_moment_the_old_version_runs(robot: Robot, cut_disks: list[Path]) -> None:
    good, trials = robot.version(), 0
    robot.root.close()
    for disk in cut_disks:
        robot.root.disk = disk
        with robot.root.opened() as files:
            trials += (files / "opt/mapod/trial").is_symlink()
        robot.root.boot()
        until(lambda: robot.unit("ActiveState") == "active", "the app runs", robot.how_it_is)
        assert robot.version() == good
        assert robot.root.asked("ls /opt/mapod/trial").returncode != 0
        if disk != cut_disks[-1]:
            robot.root.close()
            disk.unlink()
    tell(f"{CUTS} cuts, {trials} of them while the new version was on trial")
    assert trials > 0
    robot.comes_to_run()


def test_after_a_cut_the_next_flash_works_and_can_be_rolled_back(
    robot: Robot, bundles: Path
) -> None:
    old = robot.version()
    status, said = robot.flashed("--from", bundles / "next.pyz")
    assert status == 0, said
    assert robot.version() != old
    robot.root.cut()
    robot.root.boot()
    assert robot.version() != old  # all of it is on the disk
    robot.comes_to_run()
    status, said = robot.flashed("--rollback")
    assert status == 0, said
    assert robot.version() == old
    robot.comes_to_run()
    assert robot.planner.wait_for(lambda _: robot.maps(), PATIENCE_S)
