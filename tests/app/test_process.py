"""The whole house as its user runs it: real processes, real sockets and ptys, real time."""

import os
import re
import subprocess
import sys

import pytest

from tests import ROOT


@pytest.mark.real_time
@pytest.mark.parametrize("wire", [[], ["--serial"]], ids=["udp", "serial"])
def test_the_demo_maps_the_corridor_ends_by_itself_and_leaves_no_process(wire: list[str]) -> None:
    demo = subprocess.Popen(
        [sys.executable, "-m", "tools.cli.demo", "--seconds", "6", *wire],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    said, errors = demo.communicate(timeout=120)
    assert demo.returncode == 0, errors
    cells = re.search(r"cells +(\d+) free, (\d+) obstacle", said)
    assert cells is not None
    assert int(cells[1]) > 100
    assert int(cells[2]) > 50
    assert "mode     running" in said
    assert "0 rejected" in said
    assert "all processes have ended" in said
    picture = [line for line in said.splitlines() if set(line) <= set(" .#^<v>")]
    assert any(line.count("#") > 10 for line in picture) or sum("#" in line for line in picture) > 8
    with pytest.raises(ProcessLookupError):
        os.killpg(demo.pid, 0)  # nobody is left in its session
