"""Each fake as a process of its own, asked by sockets and terminals; and the rig's process."""

import contextlib
import json
import os
import select
import signal
import socket
import subprocess
import sys
import termios
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO

import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.records import DepthImage
from fakes.programs.serving import MOST_S, Pace
from hw.ports.wires import open_port, ports_beside
from hw.visionary.camera import Visionary
from tests import ROOT
from tests.support.devices.bench_visionary import options_of

PYTHON = (sys.executable, "-m")
PATIENCE_S = 60.0  # bounds what a hung process can cost
LAGS = "this machine is too slow, the world lags"  # may be said at any time
Start = Callable[..., "Program"]


class Program:
    """A program of the fakes, running."""

    def __init__(self, *arguments: str) -> None:
        self.process = subprocess.Popen(
            [*PYTHON, *arguments, "--until-stdin-closes", "--seconds", "50"],
            cwd=ROOT,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert self.process.stdout
        assert self.process.stderr
        self.errors: IO[str] = self.process.stderr
        line = self.process.stdout.readline()
        assert line, self.errors.read()
        self.ports: dict[str, str | None] = json.loads(line)

    def heard(self) -> str:
        """The next line of what happened."""
        while LAGS in (line := self.errors.readline()):
            pass
        return line

    def url(self, name: str) -> str:
        url = self.ports[name]
        assert url is not None
        return url

    def path(self, name: str) -> str:
        return self.url(name).removeprefix("serial://").split("?")[0]

    def connect(self, name: str) -> socket.socket:
        host, port = self.url(name).removeprefix("tcp://").split(":")
        return socket.create_connection((host, int(port)), timeout=PATIENCE_S)


@pytest.fixture
def start() -> Iterator[Start]:
    programs: list[Program] = []

    def one(*arguments: str) -> Program:
        programs.append(Program(*arguments))
        return programs[-1]

    yield one
    for program in programs:
        program.process.kill()
        program.process.communicate()


def read_until(done: Callable[[bytes], object], file: int) -> bytes:
    """All that comes until it is enough; fails if that takes too long."""
    got, end_s = b"", time.monotonic() + PATIENCE_S
    while not done(got):
        assert time.monotonic() < end_s, got
        if select.select([file], [], [], 1.0)[0]:
            got += os.read(file, 4096)
    return got


def asked(line: int, question: bytes, ending: bytes) -> bytes:
    """What a terminal answers, up to an ending."""
    os.write(line, question)
    return read_until(lambda got: got.endswith(ending), line)


def ended(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*PYTHON, *arguments], cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE_S
    )


def test_the_drive_answers_on_its_link_until_a_fault_and_ends_at_a_signal(
    start: Start, tmp_path: Path
) -> None:
    link = tmp_path / "ax3500"
    program = start(
        *("fakes.programs.ax3500", "--link", str(link), "--mode", "rs232"),
        *("--fault", "battery_v=12@0s", "--fault", "refuse=?R@0s"),
    )
    assert program.ports == {"ax3500": f"serial://{link}?baud=9600&parity=E&bytesize=7"}
    line = os.open(link, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    assert asked(line, b"?Q0\r", b"0\r0\r") == b"?Q0\r0\r"
    assert asked(line, b"?E\r", b"6C\r") == b"?E\r38\r6C\r"
    assert asked(line, b"?R\r", b"-\r") == b"?R\r-\r"
    assert asked(line, b"!A40\r", b"+\r") == b"!A40\r+\r"
    os.close(line)
    program.process.send_signal(signal.SIGTERM)
    _, errors = program.process.communicate(timeout=PATIENCE_S)
    assert program.process.returncode == 0
    told = [line for line in errors.splitlines() if LAGS not in line]
    assert told == ["ax3500: battery_v=12 on", "ax3500: refuse=?R on"]
    assert not os.path.lexists(link)


def test_the_drive_is_reached_over_tcp_too_and_tells_who_comes_and_ends_with_its_starter(
    start: Start,
) -> None:
    program = start("fakes.programs.ax3500", "--port", "0", "--model", "AX2850", "--unpaced")
    with program.connect("ax3500") as client:
        assert asked(client.fileno(), b"^8A\r", b"+\r") == b"^8A\r24\r+\r"
        name = "{}:{}".format(*client.getsockname())
        assert program.heard() == f"ax3500: client {name} connected\n"
    program.process.communicate(timeout=PATIENCE_S)  # closes its standard input
    assert program.process.returncode == 0


def test_a_drive_in_radio_mode_logs_by_itself_and_tells_of_a_host_at_the_wrong_speed(
    start: Start,
) -> None:
    program = start("fakes.programs.ax3500", "--mode", "rc", "--model", "AX1500", "--seed", "3")
    line = os.open(program.path("ax3500"), os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    logged = read_until(lambda got: got.count(b"\r") >= 2, line)
    assert logged.split(b"\r")[1].startswith(b":0000")
    settings = termios.tcgetattr(line)
    settings[4] = settings[5] = termios.B115200
    termios.tcsetattr(line, termios.TCSANOW, settings)
    assert program.heard() == "ax3500: host at 115200 baud, device at 9600\n"
    os.close(line)


def test_the_attitude_sensor_streams_until_it_falls_mute(start: Start) -> None:
    program = start(
        *("fakes.programs.mti", "--port", "0", "--scene", "turning", "--rate", "50"),
        *("--fault", "mute@100ms-200ms"),
    )
    with program.connect("mti") as client:
        read_until(lambda got: got.count(b"\xfa\xff\x32") > 3, client.fileno())
        told = [program.heard() for _ in range(3)]
        assert {line.split()[-1] for line in told} == {"connected", "on", "off"}
        client.sendall(bytes.fromhex("FAFF3000D1"))  # GoToConfig
        read_until(lambda got: b"\xfa\xff\x31\x00\xd0" in got, client.fileno())
        client.sendall(bytes.fromhex("FAFF0400FD"))  # ReqPeriod
        read_until(lambda got: b"\xfa\xff\x05\x02\x09\x00" in got, client.fileno())


def test_the_scanner_is_set_as_told_and_a_cut_throws_its_client_out(start: Start) -> None:
    cuts = [word for k in range(99) for word in ("--fault", f"cut@{k * 500 + 300}ms+100ms")]
    program = start(
        *("fakes.programs.lms1xx", "--port", "0", "--scan-rate", "25", "--dialect", "ascii"), *cuts
    )
    answered = b""
    while b"\x03" not in answered:  # it may come while the wire is cut
        with contextlib.suppress(ConnectionError), program.connect("lms111") as client:
            client.sendall(b"\x02sRN LMPscancfg\x03")
            answered = b""
            while piece := client.recv(100):
                answered += piece
    assert answered.startswith(b"\x02sRA LMPscancfg 9C4 1 ")  # 25 Hz


def test_the_hokuyo_scanner_changes_its_rate_on_a_pty_and_answers_over_tcp_too(
    start: Start, tmp_path: Path
) -> None:
    link = tmp_path / "urg"
    program = start("fakes.programs.urg04lx", "--link", str(link), "--fault", "noise=0@0s")
    assert program.ports == {"urg04lx": f"serial://{link}?baud=19200"}
    line = os.open(link, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    assert asked(line, b"QT\n", b"\n\n") == b"QT\nE\n\n"
    assert asked(line, b"SCIP2.0\n", b"\n\n") == b"SCIP2.0\n0\n\n"
    assert asked(line, b"SS115200\n", b"\n\n") == b"SS115200\n00P\n\n"
    settings = termios.tcgetattr(line)
    settings[4] = settings[5] = termios.B115200
    termios.tcsetattr(line, termios.TCSANOW, settings)
    while "host at 115200 baud" not in program.heard():
        pass
    assert asked(line, b"BM\n", b"\n\n") == b"BM\n00P\n\n"
    assert len(asked(line, b"GD0044072500\n", b"\n\n")) == 2134
    os.close(line)
    program = start("fakes.programs.urg04lx", "--port", "0", "--model", "UTM-30LX")
    with program.connect("urg04lx") as client:
        assert asked(client.fileno(), b"%ST\n", b"\n\n") == b"%ST\n00P\n000@\n\n"


@pytest.mark.parametrize(
    ("program", "name"), [("fakes.programs.stripe", "stripe"), ("fakes", "scanner")]
)
def test_a_camera_with_a_laser_streams_alone_and_in_the_rig(
    start: Start, program: str, name: str
) -> None:
    options = ("--port", "0") if name == "stripe" else ("--scanner", "stripe", "--all-tcp")
    with start(program, *options).connect(name) as client:
        client.sendall(b"GET /stream HTTP/1.0\r\n\r\n")
        got = read_until(lambda got: got.count(b"\xff\xd9\r\n--imagefollows") > 2, client.fileno())
    assert got.startswith(b"HTTP/1.0 200 OK\r\n")


def test_a_depth_camera_gives_images_to_its_driver_on_two_ports(start: Start) -> None:
    program = start("fakes.programs.visionary", "--port", "0", "--stream-port", "0", "--model", "t")
    camera = Visionary(
        open_port(program.url("control")),
        options_of(control="cola_b"),
        ports_beside(program.url("control")),
    )
    images: list[DepthImage] = []
    end_s = time.monotonic() + PATIENCE_S
    while len(images) < 3 and time.monotonic() < end_s:
        images += camera.step(time.monotonic())
        time.sleep(0.002)
    camera.stop()
    camera.port.close()
    assert [image.numbers.shape for image in images[:3]] == [(144, 176)] * 3
    assert camera.identity.startswith("Visionary-T CX")


def test_the_list_of_faults_tells_all_and_ends() -> None:
    done = ended("fakes.programs.ax3500", "--list-faults")
    names = [line.split()[0] for line in done.stdout.splitlines()]
    assert {"mute", "wire.mute", "gone", "rollover", "power_cycle", "w_rate"} <= set(names)
    assert (done.returncode, done.stderr) == (0, "")


def test_what_there_is_not_is_one_line_and_status_two() -> None:
    done = ended("fakes.programs.lms1xx", "--scene", "wall:x")
    assert (done.returncode, done.stdout) == (2, "")
    [line] = done.stderr.splitlines()
    assert "no scene 'wall:x'; there are room" in line
    done = ended("fakes.programs.mti", "--period", "1m")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.endswith("--period: must be from 0.5ms to 100ms, is 1m\n")
    done = ended("fakes", "--lens", "0.2", "0", "-1", "55")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.endswith("degrees, is 0.2 0 -1 55\n")
    done = ended("fakes", "--scene", "stones", "--no-driver")
    assert (done.returncode, done.stdout) == (2, "")
    assert "--no-driver: not in 'stones', where the robot walks by itself" in done.stderr


def test_the_rig_says_where_its_devices_are_and_one_that_is_left_out_has_no_port(
    start: Start, tmp_path: Path
) -> None:
    link = tmp_path / "drive"
    program = start(
        *("fakes", "--leave-out", "ahrs", "--no-driver", "--drive-link", str(link)),
        *("--drive-mode", "rc", "--fault", "drive.cut@0s-100ms"),
    )
    assert program.url("scanner").startswith("tcp://127.0.0.1:")
    assert program.ports["ahrs"] is None
    assert program.url("drive") == f"serial://{link}?baud=9600&parity=E&bytesize=7"
    assert [program.heard() for _ in "12"] == ["fakes: drive.cut on\n", "fakes: drive.cut off\n"]
    line = os.open(link, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    read_until(lambda got: b":00" in got, line)
    os.close(line)
    program.process.send_signal(signal.SIGINT)
    program.process.communicate(timeout=PATIENCE_S)
    assert program.process.returncode == 0


@given(st.lists(st.floats(0.0, 3.0), max_size=40))
def test_the_clock_of_the_programs_never_jumps_and_never_runs_ahead(waits_s: list[float]) -> None:
    pace, host_s = Pace(10.0), 10.0
    for wait_s in waits_s:
        before_s, host_s = pace.now_s, host_s + wait_s
        kept_up = pace.step(host_s)
        assert before_s <= pace.now_s <= host_s
        assert pace.now_s - before_s <= MOST_S + 1e-9
        assert kept_up or pace.now_s - before_s == pytest.approx(MOST_S)
