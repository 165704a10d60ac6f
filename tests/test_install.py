"""What `pip install .` gives: built from a copy, installed into a clean environment, used there.

No network is needed: the libraries are those of this environment, put on the path of the clean one.
"""

import os
import shutil
import signal
import subprocess
import sys
import venv
import zipfile
from email import message_from_bytes
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest

from tests import ROOT

SETUPTOOLS = 77
BUILT_FROM = ("mapod", "mapod_link", "core", "hw", "tools", "fakes")
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
print(*sorted({name.partition(".")[0] for name in sys.modules}))
"""
LINK_ALONE = """
import sys
import mapod_link
names = {name.partition(".")[0] for name in sys.modules} - set(sys.stdlib_module_names)
print(*sorted(name for name in names if not name.startswith("_")))
"""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel, built from a copy of the sources."""
    if int(metadata.version("setuptools").partition(".")[0]) < SETUPTOOLS:
        pytest.fail(f"building needs setuptools {SETUPTOOLS} or later: pip install '.[test]'")
    folder = tmp_path_factory.mktemp("sources")
    ignored = shutil.ignore_patterns("__pycache__", "build", "*.egg-info")
    for name in BUILT_FROM:
        shutil.copytree(ROOT / name, folder / name, ignore=ignored)
    for path in [*ROOT.glob("*.py"), *ROOT.glob("*.toml"), *ROOT.glob("*.md"), *ROOT.glob("LIC*")]:
        shutil.copy(path, folder)
    pip("wheel", "--no-build-isolation", "--no-deps", "-w", str(folder / "dist"), str(folder))
    [built] = (folder / "dist").glob("*.whl")
    return built


def pip(*words: str) -> None:
    """Run pip; a failure shows what it said."""
    command = [sys.executable, "-m", "pip", "--disable-pip-version-check", *words]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.fixture(scope="module")
def clean(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The programs of an environment where the wheel is installed, and nothing else of ours."""
    home = tmp_path_factory.mktemp("clean")
    venv.create(home, with_pip=False)
    python = home / "bin" / "python"
    pip("--python", str(python), "install", "--no-index", "--no-deps", str(wheel))
    [site] = home.glob("lib/python3*/site-packages")
    (site / "libraries.pth").write_text(f"{Path(np.__file__).parents[1]}\n")
    return home / "bin"


def ran(program: Path, *words: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """A program of the clean environment; kernels run as Python."""
    env = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    env.pop("PYTHONPATH", None)
    return subprocess.run(
        [str(program), *words], cwd=cwd, env=env, capture_output=True, text=True, check=False
    )


def test_the_wheel_has_two_names_and_needs_no_simulation(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        [about] = [name for name in names if name.endswith("/METADATA")]
        told = message_from_bytes(archive.read(about))
        header = archive.read("mapod/hw/mcu/mapod_link.h")
    assert {name.partition("/")[0] for name in names} == {
        "mapod", "mapod_link", about.partition("/")[0],
    }  # fmt: skip
    parts = {name.split("/")[1] for name in names if name.startswith("mapod/")}
    assert not parts & {"fakes", "tests", "docs"}
    tools = {name.split("/")[2] for name in names if name.startswith("mapod/tools/")}
    assert not tools & {"rig", "experiments", "bench", "fuzz.py", "docs", "laser_replay.py"}
    data = {"mapod/py.typed", "mapod_link/py.typed", "mapod/mapod.toml", "mapod/hw/mcu/example.c"}
    assert data <= set(names)
    assert header == (ROOT / "hw/mcu/mapod_link.h").read_bytes()
    needed = [line for line in told.get_all("Requires-Dist", []) if "extra ==" not in line]
    assert not [line for line in needed if line.startswith(("mujoco", "pytest", "ruff", "mypy"))]
    assert told["License-Expression"] == "Apache-2.0"


def test_every_module_and_every_command_loads_under_the_one_name(
    clean: Path, tmp_path: Path
) -> None:
    done = ran(clean / "python", "-c", EVERY_MODULE, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert not {"core", "hw", "app", "main", "tools", "fakes"} & set(done.stdout.split())


def test_the_receiver_needs_nothing_but_numpy(clean: Path, tmp_path: Path) -> None:
    done = ran(clean / "python", "-c", LINK_ALONE, cwd=tmp_path)
    assert done.stdout.split() == ["mapod_link", "numpy"], done.stderr


def test_settings_are_written_checked_and_never_overwritten(clean: Path, tmp_path: Path) -> None:
    mapod = clean / "mapod"
    first, again = (ran(mapod, "init", cwd=tmp_path) for _ in range(2))
    assert (first.returncode, again.returncode) == (0, 2)
    assert "is there already" in again.stderr
    assert (tmp_path / "mapod.toml").read_bytes() == (ROOT / "mapod.toml").read_bytes()
    assert Path(first.stdout.split("includes ")[1].split(";")[0]).is_file()
    checked = ran(mapod, "check", cwd=tmp_path)
    assert (checked.returncode, checked.stderr) == (0, "")
    assert "centre beam meets the ground" in checked.stdout
    assert ran(mapod, "version", cwd=tmp_path).stdout.startswith("mapod 0.")


@pytest.mark.parametrize("words", [("demo",), ("compare", "scanner"), ("replay", "mapod.toml")])
def test_what_needs_the_simulation_says_so_in_a_line(
    words: tuple[str, ...], clean: Path, tmp_path: Path
) -> None:
    shutil.copy(ROOT / "mapod.toml", tmp_path)
    done = ran(clean / "mapod", *words, cwd=tmp_path)
    assert done.returncode == 2
    assert "needs the simulation" in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_it_runs_against_nothing_is_recorded_and_replayed(clean: Path, tmp_path: Path) -> None:
    text = (ROOT / "mapod.toml").read_text(encoding="utf-8")
    text = text.replace("tcp://192.168.0.1:2112", "tcp://127.0.0.1:1")
    text = text.replace('method = "beams"', 'method = "reference_plane"')  # quick without compiler
    (tmp_path / "mapod.toml").write_text(text, encoding="utf-8")
    process = subprocess.Popen(
        [str(clean / "mapod"), "record", "--out", "nothing.rec"],
        cwd=tmp_path,
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        stderr=subprocess.PIPE,
        text=True,
    )
    with process:
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
    done = ran(clean / "mapod", "replay", "nothing.rec", cwd=tmp_path)
    assert done.returncode == 1
    assert "the recording holds no byte of the scanner" in done.stderr
