"""What a start of the app loads, and the memory that it keeps while the robot drives."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests import ROOT
from tools.bench.process import SETTINGS
from tools.bench.usage import resident_mb, usage_of
from tools.rig.real_time.bench import Bench
from tools.terminal.processes import Stop

NEVER = {"asyncio", "rich", "structlog", "colorama", "mapod_link", "fakes"}
NEVER |= {"mcap", "zstandard", "recording.foxglove", "recording.writer", "recording.reader"}
NEVER |= {"hw.modbus", "hw.runtime.servers", "tools.terminal", "tools.rig"}
COMPILER = {"numba.np.linalg", "numba.np.arraymath", "numba.np.npyimpl", "numba.typed.typedlist"}
LOADED = """
import sys
from pathlib import Path
from config_file import load_config
from tools.cli.run import run
from main import warm_kernels
print(*sys.modules)
warm_kernels(load_config(Path("mapod.toml").read_text()))
print(*sys.modules)
"""
MOST_MB = 150.0
TOLD = 100  # scans: seconds of driving


def output_of(*arguments: str) -> str:
    """Of Python, with kernels as machine code."""
    env = {name: value for name, value in os.environ.items() if name != "NUMBA_DISABLE_JIT"}
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=ROOT,
        env=env,
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    ).stdout


def test_a_start_loads_no_server_no_picture_and_not_all_of_the_compiler() -> None:
    output_of("main.py", "--warm")
    imported, warmed = (set(line.split()) for line in output_of("-c", LOADED).splitlines())
    assert "app" in imported
    assert imported & NEVER == set()
    assert warmed & COMPILER == set()  # all kernels are taken from disk


@contextmanager
def driving(folder: Path, setting: str) -> Iterator[Bench]:
    """The real process, whose clocks are locked, and a world in which the robot drives."""
    bench = Bench(folder, Stop(), SETTINGS[setting])
    with bench.closed():
        bench.start()
        yield bench


@pytest.mark.real_time
@pytest.mark.parametrize("setting", ["shipped", "fast"])
def test_memory_is_small_and_there_while_the_robot_drives(tmp_path: Path, setting: str) -> None:
    with driving(tmp_path, setting) as bench:
        app, before = bench.pids[-1], usage_of(bench.pids[-1])
        begun = len(bench.end.bursts)
        while len(bench.end.bursts) < begun + TOLD:
            bench.run(0.05)
        after, (resident, locked) = usage_of(app), resident_mb(app)
    [rights] = [event for event in bench.log.added() if event["event"] == "real_time_taken"]
    assert resident < MOST_MB
    assert after.major_faults == before.major_faults
    if rights["memory_locked"]:
        assert resident / 2 < locked <= resident  # of shared pages each process has its part
        assert after.minor_faults - before.minor_faults < TOLD
