"""The whole of `mapod doctor`, on a machine whose devices are ptys and sockets."""

import json
import socket
from pathlib import Path

from tests import ROOT, Capsys
from tests.support.machine.real_wires import pty_at
from tools.cli.command import main
from tools.doctor.finding import Finding

SHIPPED = (ROOT / "mapod.toml").read_text(encoding="utf-8")


def test_settings_that_can_not_be_used_are_a_fault(tmp_path: Path, capsys: Capsys) -> None:
    path = tmp_path / "mapod.toml"
    path.write_text(SHIPPED.replace("rate_hz = 200", "rate_hz = 0"), encoding="utf-8")
    assert main(["doctor", "--config", str(path)]) == 2
    assert f"fault    settings   {path}: loop.rate_hz" in capsys.readouterr().out


def test_programs_get_the_same_as_json(tmp_path: Path, capsys: Capsys) -> None:
    path = tmp_path / "mapod.toml"
    path.write_text(SHIPPED.replace("rate_hz = 200", "rate_hz = 0"), encoding="utf-8")
    lines = []
    for given in ([], ["--json"]):
        assert main(["doctor", "--config", str(path), *given]) == 2
        lines.append(capsys.readouterr().out)
    told = [Finding(**one) for one in json.loads(lines[1])]
    faults = [str(finding) for finding in told if finding.level == "fault"]
    assert faults == [line for line in lines[0].splitlines() if line.startswith("fault")]
    assert len(faults) == 1


def test_a_robot_that_is_all_there_has_no_fault(tmp_path: Path, capsys: Capsys) -> None:
    with (
        socket.create_server(("127.0.0.1", 0)) as scanner,
        pty_at(f"{tmp_path}/mti"),
        pty_at(f"{tmp_path}/ax3500"),
    ):
        text = SHIPPED.replace("192.168.0.1:2112", f"127.0.0.1:{scanner.getsockname()[1]}")
        path = tmp_path / "mapod.toml"
        path.write_text(text.replace("/dev/", f"{tmp_path}/"), encoding="utf-8")
        assert main(["doctor", "--config", str(path)]) in (0, 1)  # cores, clock, rights
    lines = capsys.readouterr().out.splitlines()
    about = {line.split()[1] for line in lines}
    assert {"network", "calibrated", "recordings", "flights", "time", "kernels"} <= about
    fine = {line.split()[1] for line in lines if line.startswith("OK ")}
    assert {"Python", "libraries", "settings", "scanner", "ahrs", "drive", "planner"} <= fine
