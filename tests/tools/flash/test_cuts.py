"""Flashes that end in the middle: killed, refused by the disk. The old version runs then."""

import random
import subprocess
import sys
from pathlib import Path

import pytest

from tests.tools.flash.stand_in import bundle, flashed, runs

CUT = """
import os, runpy, signal, sys
count, last = {at}, "{after}"
def hook(event, args):
    global count, last
    if event.split(".")[0] in ("open", "os", "shutil", "subprocess"):
        if last:
            if event == "os.rename" and str(args[1]).endswith(last):
                last = ""
            return
        count -= 1
        if count == 0:
            os.killpg(0, signal.SIGKILL)
sys.addaudithook(hook)
sys.argv = {argv!r}
try:
    runpy.run_path(sys.argv[0], run_name="__main__")
finally:
    print("left", count)
"""


def cut(
    path: Path, root: Path, at: int, after: str = "", again: bool = False
) -> "subprocess.CompletedProcess[str]":
    """A flash that is killed, with all that it started, at its so many-th use of a file.

    Counted from the start, or from when a file or link got a name that ends with `after`.
    """
    argv = [str(path), "install", "--root", str(root), *(["--again"] if again else [])]
    code = CUT.format(at=at, after=after, argv=argv)
    command = [sys.executable, "-IS", "-c", code]
    return subprocess.run(
        command, capture_output=True, text=True, start_new_session=True, check=False
    )


def started(root: Path) -> str:
    """What runs after the next start: as the unit does it, first `recover`, then the app."""
    subprocess.run([root / "opt/mapod/recover"], check=True, capture_output=True)
    return runs(root)


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    """A root that runs version 1, with settings of its own."""
    root = tmp_path / "root"
    root.mkdir()
    assert flashed(bundle(tmp_path, 1), root).returncode == 0
    (root / "etc/mapod/mapod.toml").write_text("own = 1\n")
    return root


def test_cut_after_the_switch_the_next_start_goes_back(robot: Path, tmp_path: Path) -> None:
    new = bundle(tmp_path, 2)
    assert cut(new, robot, 1, "/current").returncode == -9
    assert runs(robot) == "app 2 with own"  # on trial
    told = flashed(robot / "opt/mapod/flash", robot, action="status").stdout
    assert "the next start goes back" in told
    assert started(robot) == "app 1 with own"
    assert flashed(new, robot).returncode == 0
    assert started(robot) == "app 2 with own"


def test_cut_after_the_switch_the_next_flash_goes_back_first(robot: Path, tmp_path: Path) -> None:
    assert cut(bundle(tmp_path, 2), robot, 1, "/current").returncode == -9
    done = flashed(bundle(tmp_path, 3, fault="warm"), robot)
    assert "an earlier flash was cut: back to" in done.stdout
    assert done.returncode == 1
    assert runs(robot) == "app 1 with own"


@pytest.mark.slow
def test_cut_anywhere_the_old_version_runs_and_the_next_flash_works(
    robot: Path, tmp_path: Path
) -> None:
    old, new = "app 1 with own", "app 2 with own"
    path, command = bundle(tmp_path, 2), robot / "opt/mapod/flash"
    whole = 10**6 - int(cut(path, robot, 10**6).stdout.split()[-1])
    assert flashed(command, robot, action="rollback").returncode == 0
    gone_through = 0
    for at in random.Random(1).sample(range(1, whole + 1), 20):
        assert cut(path, robot, at, again=True).returncode == -9  # the one before did no harm
        assert (robot / "etc/mapod/mapod.toml").read_text() == "own = 1\n"
        if started(robot) == new:  # it had stood its trial, and only cleaned up
            gone_through += 1
            assert flashed(command, robot, action="rollback").returncode == 0
        assert started(robot) == old, at
    assert gone_through < 5
    assert flashed(path, robot, "--again").returncode == 0
    assert started(robot) == new


def test_a_first_flash_that_is_cut_is_taken_up_by_the_next(tmp_path: Path) -> None:
    root, path = tmp_path / "root", bundle(tmp_path, 1)
    (root / "etc/mapod").mkdir(parents=True)
    (root / "etc/mapod/mapod.toml").write_text("own = 1\n")
    for after in (".toml", "/current"):  # its settings are written; it is switched to
        assert cut(path, root, 1, after).returncode == -9
        assert (root / "etc/mapod/mapod.toml").read_text() == "own = 1\n"
    assert flashed(path, root).returncode == 0
    assert started(root) == "app 1 with own"


@pytest.fixture
def small_disk(tmp_path: Path) -> Path:
    """A disk of 56 MB with version 1 on it."""
    root = tmp_path / "disk"
    root.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=56m", "none", str(root)]
    if subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("mounting a small disk needs root")
    assert flashed(bundle(tmp_path, 1), root).returncode == 0
    return root


def test_a_full_disk_is_told_before_and_half_way(small_disk: Path, tmp_path: Path) -> None:
    try:
        done = flashed(bundle(tmp_path, 2, fault="fills the disk"), small_disk)
        assert done.stderr == "mapod flash: the disk got full: nothing is changed\n"
        assert started(small_disk) == "app 1 with a"
        assert not (small_disk / "opt/mapod/versions/.staging").exists()
        (small_disk / "ballast").write_bytes(bytes(10_000_000))
        done = flashed(bundle(tmp_path, 3), small_disk)
        assert "the disk is too full" in done.stderr
        assert len(done.stderr.splitlines()) == 1
        subprocess.run(["mount", "-o", "remount,ro", small_disk], check=True)
        done = flashed(bundle(tmp_path, 3), small_disk)
        assert "is on a read-only file system" in done.stderr
        assert len(done.stderr.splitlines()) == 1
        assert runs(small_disk) == "app 1 with a"
    finally:
        subprocess.run(["umount", small_disk], check=True)
