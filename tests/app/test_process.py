"""The whole house as its user runs it: real processes, real sockets and ptys, real time."""

import re
import subprocess
import sys

import pytest

from tests import ROOT


@pytest.mark.parametrize("wire", [[], ["--serial"]], ids=["udp", "serial"])
def test_the_demo_maps_the_corridor_ends_by_itself_and_leaves_no_process(wire: list[str]) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "tools.cli.demo", "--seconds", "6", *wire],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    cells = re.search(r"cells +(\d+) free, (\d+) obstacle", done.stdout)
    assert cells is not None
    assert int(cells[1]) > 100
    assert int(cells[2]) > 50
    assert "mode     running" in done.stdout
    assert "0 rejected" in done.stdout
    assert "all processes have ended" in done.stdout
    picture = [line for line in done.stdout.splitlines() if set(line) <= set(" .#^<v>")]
    assert any(line.count("#") > 10 for line in picture) or sum("#" in line for line in picture) > 8
    left = subprocess.run(
        ["pgrep", "-f", "mapod-run-"], capture_output=True, text=True, check=False
    )
    assert left.stdout == ""
