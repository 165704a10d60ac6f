"""The demo's own work: the app's configuration, and children that come, fail, hang and go."""

import argparse
import contextlib
import io
import json
import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import textwrap
import time
import tomllib
from pathlib import Path

import pytest
from rich.console import Console

from tests import ROOT, Capsys, Patch
from tests.support.cases import few
from tools.cli import demo
from tools.cli.options import configured
from tools.cli.view import PAGE_AT
from tools.settings import NotThereError, rewritten
from tools.terminal import processes
from tools.terminal.processes import SimulatedRobot, Stop, folder_kept_on_failure

pytestmark = pytest.mark.usefixtures("temporary")
PORTS = '{"scanner": "tcp://127.0.0.1:1", "ahrs": "serial:///a?baud=1", "drive": "serial:///d"}'
WORLD = f"""
    print({PORTS!r})
    time.sleep(60)
"""
APP = """
    import socket, struct, tomllib
    from mapod_link.frames import GEOM, MAP, POSE, bytes_from_frame
    ports = tomllib.load(open(sys.argv[-1], "rb"))["planner"]["port"]
    planner = ports if isinstance(ports, str) else ports[0]
    print(ports, flush=True)
    host, port = planner.removeprefix("udp://").split(":")
    line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    line.connect((host, int(port)))
    geom = struct.pack("<BxHHHIHH", 7, 9, 5, 200, 1, 20, 500)
    pose = struct.pack("<iihhhhhHBBBB", 500, 100, 0, 0, 0, 0, 0, 0x7F, 3, 1, 2, 1)
    cells = struct.pack("<hhHB3s", 0, 0, 0, 7, bytes(3)) + bytes([0x40 | 17, 0x80 | 8])
    for seq in range(20_000):
        kind, body = ((GEOM, geom), (POSE, pose), (MAP, cells))[seq % 3]
        line.send(bytes_from_frame(kind, seq, int(time.monotonic() * 1000), body))
        time.sleep(0.005)
"""
POLITE = "signal.signal(signal.SIGINT, lambda *_: sys.exit(0))\n"
DEAF = "signal.signal(signal.SIGINT, signal.SIG_IGN)\n"
RUDE = "signal.signal(signal.SIGINT, lambda *_: sys.exit(3))\n"


def stub(code: str, manners: str = POLITE) -> list[str]:
    return [sys.executable, "-c", f"import signal, sys, time\n{manners}{textwrap.dedent(code)}"]


def options(out: Path | None = None, seconds: float = 0.3) -> argparse.Namespace:
    config = ROOT / "mapod.toml"
    return argparse.Namespace(
        seconds=seconds,
        seed=1,
        scene="stub",
        config=config,
        serial=False,
        drive=False,
        cleans=False,
        out=out,
        no_page=True,
        record=None,
    )


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: Patch) -> Path:
    """The folder in which a demo makes its own; and all the time that its children need to end."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(processes, "GRACE_S", 60.0)
    return tmp_path


def ran(world: list[str], app: list[str]) -> int:
    return demo.run(options(), world, app, Console(file=io.StringIO()))


def is_gone(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"


def test_a_cleaners_world_has_its_camera_and_wheels_that_obey_the_app() -> None:
    given = options()
    given.cleans = True
    words = demo.world_words(given, configured(ROOT / "robots" / "cleaner.toml"))
    assert words[words.index("--camera") + 1 :][:4] == ["0.12", "0.0", "1.1", "55.0"]
    assert "--no-driver" in words
    assert "--camera" not in demo.world_words(options(), configured(ROOT / "mapod.toml"))


def test_only_the_named_keys_of_the_shipped_configuration_change_and_others_are_refused() -> None:
    shipped = (ROOT / "mapod.toml").read_text()
    values = {"scanner.port": "tcp://127.0.0.1:5", "planner.port": "serial:///x?baud=9600&y=1"}
    text = rewritten(shipped, values)
    expected = tomllib.loads(shipped)
    for key, value in values.items():
        section, name = key.split(".")
        expected[section][name] = value
    assert tomllib.loads(text) == expected
    changed = [a for a, b in zip(shipped.splitlines(), text.splitlines(), strict=True) if a != b]
    assert len(changed) == 2
    robot = tomllib.loads(rewritten(shipped, demo.DRIVEN))["robot"]
    assert (robot["enable_motors"], robot["start_clear_m"]) == (True, 9.0)
    with pytest.raises(NotThereError, match=r"no b\.port"):
        rewritten('[a]\nport = "x"  # y\n[b]\nporter = "x"\n', {"a.port": "z", "b.port": "z"})


def test_a_robot_without_wheels_gets_its_positioning_system_as_one_more_planner(
    capsys: Capsys,
) -> None:
    cart = (ROOT / "robots" / "cart.toml").read_text()
    values = processes.with_positioning({"planner.port": ["udp://a:1"]}, "udp://b:2")
    table = tomllib.loads(rewritten(cart, {**values, "drive.port": ""}))
    assert table["planner"]["port"] == ["udp://a:1", "udp://b:2"]
    assert processes.with_positioning({"planner.port": "udp://a:1"}, "") == {
        "planner.port": "udp://a:1"
    }
    assert demo.main(["--robot", "cart", "--drive"]) == 2
    assert "mapod drives nothing with motion.source = 'external'" in capsys.readouterr().err


@pytest.mark.real_time
def test_a_robot_with_legs_walks_on_its_own_ground_and_gets_a_map(
    capsys: Capsys, temporary: Path
) -> None:
    arguments = ["--robot", "messor", "--seconds", "3", "--no-page", "--out", str(temporary / "x")]
    assert demo.main(arguments) == 0
    said = capsys.readouterr().out
    assert 'starting the world "stones"' in said
    assert "1 character = 0.01 m" in said
    assert "health   all well" in said


def test_a_folder_counts_from_where_one_stands(temporary: Path) -> None:
    with contextlib.chdir(temporary), folder_kept_on_failure(Path("kept")) as folder:
        pass
    assert folder == temporary.resolve() / "kept"  # our processes run in another folder


def test_a_run_ends_by_itself_with_a_summary(capsys: Capsys, temporary: Path) -> None:
    given = options(temporary / "kept")
    assert demo.run(given, stub(WORLD), stub(APP), Console(file=io.StringIO())) == 0
    said = capsys.readouterr().out
    assert [path.name for path in temporary.iterdir()] == ["kept"]
    assert (temporary / "kept" / "world.out").read_text().startswith('{"scanner"')
    assert "\n#..\n#.^\n#..\n" in said
    assert "# obstacle   . free" in said
    assert "all processes have ended" in said


@pytest.mark.real_time
def test_the_page_is_told_first_and_ends_with_the_rest(capsys: Capsys, temporary: Path) -> None:
    given = options(temporary / "kept")
    given.no_page = False
    with contextlib.ExitStack() as taken:  # by us, or by somebody: then it is another port
        with contextlib.suppress(OSError):
            taken.enter_context(socket.create_server(PAGE_AT))
        assert demo.run(given, stub(WORLD), stub(APP), Console(file=io.StringIO())) == 0
    first = capsys.readouterr().out.splitlines()[0]
    assert re.fullmatch(r"mapod: http://127\.0\.0\.1:(?!8750)\d+/#token=[\w-]{22}", first)
    _, page_url = json.loads((temporary / "kept" / "app.out").read_text().replace("'", '"'))
    assert f"watching {page_url};" in (temporary / "kept" / "page.out").read_text()


def test_ctrl_c_before_the_page_is_up_starts_nothing_more(
    capsys: Capsys, monkeypatch: Patch
) -> None:
    def stopped(robot: SimulatedRobot, settings: str, stop: Stop) -> tuple[str, str]:
        stop.wanted = True
        return "", ""

    monkeypatch.setattr(demo, "page", stopped)
    given = options()
    given.no_page = False
    assert demo.run(given, stub(WORLD), stub(APP), Console(file=io.StringIO())) == 0
    said = capsys.readouterr()
    assert (said.out, said.err) == ("mapod: all processes have ended\n", "")


def test_an_app_that_dies_is_reported(capsys: Capsys, temporary: Path) -> None:
    assert ran(stub(WORLD), stub("sys.exit('no such scanner')")) == 1
    said = capsys.readouterr().err
    [folder] = temporary.iterdir()
    assert f"all that was said is in {folder}" in said
    assert "no such scanner" in (folder / "app.log").read_text()
    assert "the app ended with status 1" in said
    assert "no such scanner" in said


@pytest.mark.parametrize(
    ("world", "app", "words"),
    [
        (stub("sys.exit('no such scene')"), stub(APP), "no such scene"),
        (stub("print('hello'); time.sleep(60)"), stub(APP), "names no ports: hello"),
        (stub(WORLD), stub(APP, RUDE), "the app ended with status 3"),
    ],
    ids=["fails", "is no world", "fails while ending"],
)
def test_a_child_that_fails_is_reported(
    world: list[str], app: list[str], words: str, capsys: Capsys
) -> None:
    assert ran(world, app) == 1
    assert words in capsys.readouterr().err


def test_no_map_and_no_end_in_time_are_reported(monkeypatch: Patch, capsys: Capsys) -> None:
    monkeypatch.setattr(processes, "GRACE_S", 0.3)
    assert ran(stub(WORLD), stub(APP, DEAF)) == 1
    assert "did not end within" in capsys.readouterr().err
    monkeypatch.setattr(processes, "FIRST_MAP_S", 0.2)
    assert ran(stub(WORLD), stub("time.sleep(60)")) == 1
    assert "no map within" in capsys.readouterr().err


def until_said(process: "subprocess.Popen[str]", words: str) -> str:
    assert process.stdout is not None
    for line in process.stdout:
        if words in line:
            return line
    raise AssertionError(f"never said {words!r}")


RUNNER = """
    from rich.console import Console
    from tests.tools.cli.test_demo import APP, WORLD, options, stub
    from tools.cli import demo
    from tools.cli import view
    from tools.terminal import processes
    view.PROGRESS_PERIOD_S, processes.GRACE_S = 0.1, 60.0
    given = options(None, 30.0)
    start = processes.Child.__init__
    def tell(self, *rest):
        start(self, *rest)
        print("child", self._process.pid, flush=True)
    processes.Child.__init__ = tell
    sys.exit(demo.run(given, stub(WORLD), stub(APP), Console()))
"""


@pytest.mark.parametrize("number", few([signal.SIGKILL, signal.SIGINT, signal.SIGTERM], 1))
def test_no_process_is_left_however_the_demo_ends(number: signal.Signals, tmp_path: Path) -> None:
    runner = subprocess.Popen(
        stub(RUNNER, ""),
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env={**os.environ, "TMPDIR": str(tmp_path)},
    )
    with runner:
        pids = [int(until_said(runner, "child").split()[1]) for _ in range(2)]
        until_said(runner, "live")
        runner.send_signal(number)
        status = runner.wait(60)
    assert status == (0 if number != signal.SIGKILL else -signal.SIGKILL)
    deadline_s = time.monotonic() + 60.0
    while not all(is_gone(pid) for pid in pids):
        assert time.monotonic() < deadline_s, "a process is left"
