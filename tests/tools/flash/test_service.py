"""The unit of the service: systemd knows every line of it, and it is as shut off as it was."""

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from tests import ROOT

UNIT = ROOT / "tools" / "flash" / "mapod.service"
EXPOSURE = 1.5  # of 10, as systemd-analyze counts
needs_systemd = pytest.mark.skipif(
    shutil.which("systemd-analyze") is None, reason="systemd-analyze is not here: apt has systemd"
)


def analyzed(*words: str) -> "subprocess.CompletedProcess[str]":
    command = ["systemd-analyze", *words]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@needs_systemd
def test_the_service_is_not_more_exposed_than_it_was_and_each_point_is_explained() -> None:
    most = f"--threshold={10 * EXPOSURE:.0f}"
    done = analyzed("security", "--offline=true", most, "--json=short", str(UNIT))
    assert done.returncode == 0, done.stdout
    exposed = [row["name"] for row in json.loads(done.stdout) if row["exposure"]]
    told = (ROOT / "docs" / "service.md").read_text(encoding="utf-8").replace("\\|", "|")
    assert [name for name in exposed if f"`{name}`" not in told] == []


@needs_systemd
def test_systemd_knows_every_line(tmp_path: Path) -> None:
    text = UNIT.read_text(encoding="utf-8")
    text = re.sub(r"/opt/mapod/\S+", shutil.which("true") or "", text)
    unit = tmp_path / "mapod.service"
    unit.write_text(text.replace("User=mapod", "User=root").replace("Group=mapod", "Group=root"))
    said = analyzed("verify", "--man=no", str(unit)).stderr
    assert [line for line in said.splitlines() if "mapod" in line] == []


def test_the_watchdog_is_fed_several_times_and_a_restart_is_never_given_up() -> None:
    keys = dict(re.findall(r"^(\w+)=(.*)$", UNIT.read_text(encoding="utf-8"), re.MULTILINE))
    assert (keys["Type"], keys["Restart"], keys["WatchdogSec"]) == ("notify", "always", "2")
    assert keys["StartLimitIntervalSec"] == "0"
    assert " run --unattended --config /etc/mapod/mapod.toml" in keys["ExecStart"]
