"""What `pip install .` gives: the wheel, built from a copy and used where nothing else of ours is.

Unpacked it is tried quickly; a slow test installs it into an environment of its own, by pip.
No network is needed: the libraries are those of this environment.
"""

import os
import shutil
import signal
import subprocess
import sys
import venv
import zipfile
from email import message_from_bytes
from pathlib import Path

import numpy as np
import pytest

from tests import ROOT

BUILT_FROM = ("mapod", "mapod_link", "core", "recording", "hw", "robots", "tools", "fakes")
BUILD = "from setuptools import build_meta; print(build_meta.build_wheel('dist'))"
EVERY_MODULE = """
import contextlib, io, pkgutil, sys
import mapod
for found in pkgutil.walk_packages(mapod.__path__, "mapod."):
    if found.name != "mapod.__main__":
        __import__(found.name)
from mapod.tools.cli.command import COMMANDS, main
for name in COMMANDS:
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.suppress(SystemExit):
        main([name, "--help"])
    assert f"usage: mapod {name}" in said.getvalue() and "example" in said.getvalue(), name
for words in ("init", "init", "check", "version", "demo", "compare scanner", "replay mapod.toml"):
    print(f"{words}: status {main(words.split())}", flush=True)
assert not {"core", "hw", "app", "main", "tools", "fakes"} & sys.modules.keys()
"""
ROOMS = """
import importlib.util, sys
import mapod.core.mapping.mapper, mapod.hw.registry, mapod_link
for name in ("mapod.fakes", "mapod.tests", "core", "hw", "fakes", "tools"):
    assert importlib.util.find_spec(name) is None, name
assert not {"mujoco", "pytest", "ruff", "mypy"} & sys.modules.keys()
print(mapod.__file__, mapod_link.__file__)
"""
LINK_ALONE = """
import sys
import mapod_link
names = {name.partition(".")[0] for name in sys.modules} - set(sys.stdlib_module_names)
print(*sorted(name for name in names if not name.startswith("_")))
"""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sources")
    ignored = shutil.ignore_patterns("__pycache__", "build", "*.egg-info")
    for name in BUILT_FROM:
        shutil.copytree(ROOT / name, folder / name, ignore=ignored)
    for path in [*ROOT.glob("*.py"), *ROOT.glob("*.toml"), *ROOT.glob("*.md"), *ROOT.glob("LIC*")]:
        shutil.copy(path, folder)
    done = subprocess.run(
        [sys.executable, "-c", BUILD], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return folder / "dist" / done.stdout.splitlines()[-1]


@pytest.fixture(scope="module")
def site(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the wheel is unpacked; it is Python alone."""
    folder = tmp_path_factory.mktemp("site")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder)
    return folder


def begun(site: Path, cwd: Path, *words: str) -> "subprocess.Popen[str]":
    """A Python that has the installed package, and not the sources; kernels run as Python."""
    env = {**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(site)}
    env.pop("PYTHONDONTWRITEBYTECODE", None)  # what is loaded once compiles once
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.Popen([sys.executable, *words], cwd=cwd, env=env, text=True, **pipes)  # type: ignore[call-overload, no-any-return]


def test_the_wheel_has_two_names_and_needs_no_simulation(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        [about] = [name for name in names if name.endswith("/METADATA")]
        told = message_from_bytes(archive.read(about))
        header = archive.read("mapod/hw/mcu/mapod_link.h")
        commands = archive.read(about.replace("METADATA", "entry_points.txt")).decode()
    assert {name.partition("/")[0] for name in names} == {
        "mapod", "mapod_link", about.partition("/")[0],
    }  # fmt: skip
    parts = {name.split("/")[1] for name in names if name.startswith("mapod/")}
    assert not parts & {"fakes", "tests", "docs"}
    tools = {name.split("/")[2] for name in names if name.startswith("mapod/tools/")}
    assert not tools & {"rig", "experiments", "bench", "fuzz", "docs"}
    assert "mapod/tools/replay/laser.py" not in names
    data = {"mapod/py.typed", "mapod_link/py.typed", "mapod/mapod.toml", "mapod/hw/mcu/example.c"}
    data |= {f"mapod/tools/view/page/{name}" for name in ("index.html", "page.css", "page.js")}
    assert data <= set(names)
    assert header == (ROOT / "hw/mcu/mapod_link.h").read_bytes()
    assert "mapod = mapod.__main__:main" in commands
    needed = [line for line in told.get_all("Requires-Dist", []) if "extra ==" not in line]
    assert not [line for line in needed if line.startswith(("mujoco", "pytest", "ruff", "mypy"))]
    assert told["License-Expression"] == "Apache-2.0"


def test_every_module_and_command_works_under_one_name(site: Path, tmp_path: Path) -> None:
    done = begun(site, tmp_path, "-c", EVERY_MODULE)
    said, complained = done.communicate()
    assert done.returncode == 0, complained
    assert (tmp_path / "mapod.toml").read_bytes() == (ROOT / "mapod.toml").read_bytes()
    assert Path(said.split("includes ")[1].split(";")[0]).is_file()
    for told in ("init: status 0", "init: status 2", "centre beam meets the ground", "mapod 0."):
        assert told in said
    for words in ("check: status 0", "demo: status 2", "scanner: status 2", "toml: status 2"):
        assert words in said
    never_overwritten, *needs = complained.splitlines()
    assert "is there already" in never_overwritten
    assert len(needs) == 3
    assert all("needs the simulation" in line for line in needs)


def test_the_receiver_needs_nothing_but_numpy(site: Path, tmp_path: Path) -> None:
    said, complained = begun(site, tmp_path, "-c", LINK_ALONE).communicate()
    assert said.split() == ["mapod_link", "numpy"], complained


@pytest.mark.slow
def test_it_runs_against_nothing_is_recorded_and_replayed(site: Path, tmp_path: Path) -> None:
    text = (ROOT / "mapod.toml").read_text(encoding="utf-8")
    text = text.replace("tcp://192.168.0.1:2112", "tcp://127.0.0.1:1")
    text = text.replace(
        'method = "surface"', 'method = "reference_plane"'
    )  # quick without compiler
    (tmp_path / "mapod.toml").write_text(text, encoding="utf-8")
    with begun(site, tmp_path, "-m", "mapod", "record", "--out", "nothing.mcap") as process:
        assert process.stderr is not None
        told = ""
        while "connection refused" not in told:
            line = process.stderr.readline()
            assert line, told
            told += line
        process.send_signal(signal.SIGTERM)
        told += process.stderr.read()
    assert process.returncode == 0, told
    assert "app_stopped" in told
    replay = begun(site, tmp_path, "-m", "mapod", "replay", "nothing.mcap")
    assert "the recording holds no byte of the scanner" in replay.communicate()[1]
    assert replay.returncode == 1


@pytest.mark.slow
def test_pip_installs_it_into_a_clean_environment(wheel: Path, tmp_path: Path) -> None:
    def ran(*words: str | Path, status: int = 0) -> str:
        env = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
        env.pop("PYTHONPATH", None)
        done = subprocess.run(
            words, cwd=tmp_path, env=env, capture_output=True, text=True, check=False
        )
        assert done.returncode == status, done.stdout + done.stderr
        return done.stdout

    home = tmp_path / "clean"
    venv.create(home)
    python, mapod = home / "bin/python", home / "bin/mapod"
    pip = (sys.executable, "-m", "pip", "--disable-pip-version-check", "--python", str(python))
    ran(*pip, "install", "--no-deps", "--no-index", str(wheel))
    [site] = home.glob("lib/python3*/site-packages")
    (site / "libraries.pth").write_text(f"{Path(np.__file__).parents[1]}\n")
    names = [line.split()[0] for line in ran(mapod, "--help").splitlines() if line[:2] == "  "]
    assert {"init", "run", "demo", "link-test", "version"} <= set(names)
    for name in names:
        assert f"usage: mapod {name}" in ran(mapod, name, "--help")
    assert str(site) in ran(mapod, "init")
    assert "mine.toml" in ran(mapod, "init", "--robot", "urg04lx", "--out", "mine.toml")
    assert (tmp_path / "mapod.toml").read_bytes() == (ROOT / "mapod.toml").read_bytes()
    assert "centre beam meets the ground" in ran(mapod, "check")
    assert ran(mapod, "version").startswith("mapod 0.")
    ran(mapod, "demo", status=2)  # needs the simulation
    assert all(path.startswith(str(site)) for path in ran(python, "-c", ROOMS).split())
