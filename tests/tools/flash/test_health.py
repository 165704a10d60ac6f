"""A flash with a service: the new version is watched; what does not work goes back by itself."""

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.tools.flash.stand_in import bundle, flashed, runs
from tests.tools.flash.systemd import Systemd
from tests.tools.flash.test_cuts import cut
from tools.flash.robot.service import State

pytestmark = pytest.mark.real_time
SERVICE = ("--service", "mapod", "--health-seconds", "8")


@pytest.fixture
def systemd(tmp_path: Path) -> Iterator[Systemd]:
    (tmp_path / "root/etc").mkdir(parents=True)
    (tmp_path / "root/etc/passwd").write_text("root:x:0:0::/root:/bin/sh\nmapod:x:9:9::/:/bin/sh\n")
    with tempfile.TemporaryDirectory(dir="/tmp") as folder:  # a socket's path is short
        one = Systemd(tmp_path / "root", Path(folder))
        yield one
        one.close()


def flash(systemd: Systemd, path: Path) -> "subprocess.CompletedProcess[str]":
    python = systemd.path / "python"  # not in somebody's home
    if not python.exists():
        python.symlink_to(getattr(sys, "_base_executable", sys.executable))
    words = [*SERVICE, "--python", str(python)]
    return flashed(path, systemd.root, *words, path=str(systemd.path))


def test_what_does_not_work_goes_back_by_itself(systemd: Systemd, tmp_path: Path) -> None:
    done = flash(systemd, bundle(tmp_path, 1))
    assert done.returncode == 0, done.stderr
    assert "the service is active (running): scanner running; planner told" in done.stdout
    done = flash(systemd, bundle(tmp_path, 2, fault="run"))
    assert done.returncode == 1
    assert "does not work: the app does not come up" in done.stderr
    assert "; went back to 0.1.0-" in done.stderr
    assert done.stdout.endswith("robot: it works as before\n")
    assert runs(systemd.root) == "app 1 with a"
    worse = bundle(tmp_path, 3, status="scanner starting: no answer; planner heard")
    done = flash(systemd, worse)
    assert "scanner ran before and does not now: scanner starting: no answer" in done.stderr
    assert runs(systemd.root) == "app 1 with a"
    better = bundle(tmp_path, 4, status="ahrs running; scanner running; planner heard")
    assert flash(systemd, better).returncode == 0
    assert runs(systemd.root) == "app 4 with a"


def test_a_robot_without_its_devices_can_be_flashed(systemd: Systemd, tmp_path: Path) -> None:
    for number in (1, 2):
        path = bundle(tmp_path, number, status="scanner closed: refused; planner told")
        done = flash(systemd, path)
        assert done.returncode == 0, done.stderr
        assert "scanner closed: refused" in done.stdout


def test_a_killed_flash_is_undone_at_the_next_start(systemd: Systemd, tmp_path: Path) -> None:
    assert flash(systemd, bundle(tmp_path, 1)).returncode == 0
    os.environ["PATH"], path = f"{systemd.path}:{os.environ['PATH']}", os.environ["PATH"]
    try:
        assert cut(bundle(tmp_path, 2), systemd.root, 1, "/current").returncode == -9
    finally:
        os.environ["PATH"] = path
    assert runs(systemd.root) == "app 2 with a"
    systemd.kill_app()
    while runs(systemd.root) != "app 1 with a":
        pass


def test_what_counts_as_running() -> None:
    words = "scanner running; ahrs starting: asks; planner told; planner 2 heard; drive closed: no"
    assert State("", "active", "running", "7", words).runs == {"scanner", "planner", "planner 2"}
    assert State("", "activating", "start", "7", words).runs == set()
