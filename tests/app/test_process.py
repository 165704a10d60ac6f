"""The whole app as its user runs it: real processes, real sockets and ptys, real time."""

import re
import subprocess
import sys

import pytest

from tests import ROOT

LEFT = 99
ADOPTS = f"""
import ctypes, os, subprocess, sys
ctypes.CDLL(None).prctl(36, 1)  # PR_SET_CHILD_SUBREAPER: whoever loses its parent becomes our child
status = subprocess.run(sys.argv[1:]).returncode
try:
    while os.waitpid(-1, os.WNOHANG)[0]:
        pass  # it has ended already
except ChildProcessError:
    sys.exit(status)
sys.exit({LEFT})
"""


@pytest.mark.real_time
@pytest.mark.parametrize("wire", [[], ["--serial"]], ids=["udp", "serial"])
def test_the_demo_maps_the_corridor_ends_by_itself_and_leaves_no_process(wire: list[str]) -> None:
    demo = [sys.executable, "-m", "mapod", "demo", "--seconds", "6", *wire]
    done = subprocess.run(
        [sys.executable, "-c", ADOPTS, *demo], cwd=ROOT, capture_output=True, text=True, check=False
    )
    said = done.stdout
    assert done.returncode != LEFT, "a process is left"
    assert done.returncode == 0, done.stderr
    cells = re.search(r"cells +(\d+) free, (\d+) obstacle", said)
    assert cells is not None
    assert int(cells[1]) > 100
    assert int(cells[2]) > 50
    assert "mode     running" in said
    assert "0 rejected" in said
    assert "all processes have ended" in said
    picture = [line for line in said.splitlines() if set(line) <= set(" .#^<v>")]
    assert any(line.count("#") > 10 for line in picture) or sum("#" in line for line in picture) > 8
