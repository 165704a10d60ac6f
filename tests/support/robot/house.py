"""The real program as a process against fakes on real TCP and ptys, which a test steps.

No waiting but in select: the fakes' steps set the pace; a wait ends when its condition holds.
"""

import json
import os
import select
import signal
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from fakes.ax3500.device import FakeAx3500
from fakes.lms1xx.device import FakeLms111
from fakes.wires.wire import Fake, PtyWire, TcpWire
from fakes.world.simple import Room
from tests import ROOT
from tests.support.machine.modbus_rig import free_port
from tests.support.machine.real_time import StillWheels, level_sensor
from tools.settings import rewritten

STEP_S = 0.002
POSE = 0x12
HEALTH_AT = 26  # of a POSE frame: 8 of head, 18 of body
OK = {"scanner": 1 << 0, "ahrs": 1 << 1, "drive": 1 << 2}  # health bits of the devices


class House:
    """The process, its three devices and a planner's ear. Faults are set on `fakes` and `wires`."""

    def __init__(self, folder: Path, **settings: object) -> None:
        """`settings`: of the program, at "section.key"."""
        self._folder, self._settings = folder, settings
        self.log: list[dict[str, Any]] = []
        self.health = 0  # newest
        self.seen: list[int] = []  # health of each POSE frame, until somebody takes them
        self._planner = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._planner.bind(("127.0.0.1", 0))
        self._planner.setblocking(False)
        self.fakes: dict[str, Fake] = {
            "ahrs": level_sensor(),
            "drive": FakeAx3500(StillWheels(), 1),
        }
        self._scanner = FakeLms111(Room("room").ranges_m_at, 1)
        self._scanner_port = free_port()
        self._scanner_wire: TcpWire | None = None
        self.links = {name: str(folder / name) for name in self.fakes}
        self.lines: dict[str, PtyWire] = {}
        self._unread = b""
        self.process: subprocess.Popen[bytes] | None = None

    def serve_scanner(self) -> None:
        self._scanner_wire = TcpWire(self._scanner, port=self._scanner_port)

    def start(self) -> None:
        """Start the program; whatever is absent then is absent at its start."""
        values = {
            "scanner.port": f"tcp://127.0.0.1:{self._scanner_port}",
            "ahrs.port": f"serial://{self.links['ahrs']}?baud=115200",
            "drive.port": f"serial://{self.links['drive']}?baud=9600&parity=E&bytesize=7",
            "planner.port": f"udp://127.0.0.1:{self._planner.getsockname()[1]}",
            "log.format": "json",
            "record.flight": "",  # whose writing would take time from the fakes
        }
        config = self._folder / "mapod.toml"
        shipped = (ROOT / "mapod.toml").read_text(encoding="utf-8")
        config.write_text(rewritten(shipped, values | self._settings), encoding="utf-8")
        self.process = subprocess.Popen(
            [sys.executable, str(ROOT / "main.py"), "--config", str(config)],
            cwd=ROOT,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
        )
        assert self.process.stderr is not None
        os.set_blocking(self.process.stderr.fileno(), False)

    def plug_in(self, name: str) -> None:
        if name == "scanner":
            assert self._scanner_wire is not None
            self._scanner_wire.unplugged = False
        else:
            self.lines[name] = PtyWire(self.fakes[name], self.links[name])

    def unplug(self, name: str) -> None:
        """The cable is pulled, or the port's adapter: then its path is away."""
        if name == "scanner":
            assert self._scanner_wire is not None
            self._scanner_wire.unplugged = True
        else:
            self.lines.pop(name).close()

    def step(self) -> None:
        """Fakes up to now; then up to 2 ms of waiting for what the program says."""
        assert self.process is not None
        assert self.process.stderr is not None
        for wire in (self._scanner_wire, *self.lines.values()):
            if wire is not None:
                wire.step(time.monotonic())
        said, pose = self.process.stderr.fileno(), self._planner.fileno()
        ready, _, _ = select.select([said, pose], [], [], STEP_S)
        if said in ready:
            self._read_log(said)
        if pose in ready:
            frame = self._planner.recv(2048)
            if frame[0] == POSE:
                (self.health,) = struct.unpack_from("<H", frame, HEALTH_AT)
                self.seen.append(self.health)

    def _read_log(self, fd: int) -> None:
        data = os.read(fd, 65536)
        assert data or self.process is None or self.process.poll() is None, self._unread.decode()
        lines = (self._unread + data).split(b"\n")
        self._unread = lines.pop()
        for line in lines:
            try:
                self.log.append(json.loads(line))
            except ValueError:
                raise AssertionError(f"no log line: {line.decode()}") from None

    def until(self, done: Callable[[], object], limit_s: float = 60.0) -> None:
        """Step until it holds."""
        begun_s = time.monotonic()
        while not done():
            self.step()
            if time.monotonic() - begun_s > limit_s:
                raise AssertionError(f"it did not come about; the log ends {self.log[-6:]}")

    def run(self, seconds: float) -> None:
        begun_s = time.monotonic()
        self.until(lambda: time.monotonic() - begun_s >= seconds)

    def all_run(self) -> bool:
        return self.health & 7 == 7

    def changes(self, device: str, since: int = 0) -> list[dict[str, Any]]:
        """The log lines about a device's state."""
        return [
            line
            for line in self.log[since:]
            if line["event"] == "device_changed" and line["device"] == device
        ]

    def close(self) -> int:
        """End the program as its user does; its exit status."""
        status = 0
        if self.process is not None:
            self.process.send_signal(signal.SIGTERM)
            try:
                status = self.process.wait(timeout=60)
            finally:
                self.process.kill()
                assert self.process.stderr is not None
                self.process.stderr.close()
        for name in list(self.lines):
            self.unplug(name)
        if self._scanner_wire is not None:
            self._scanner_wire.close()
        self._planner.close()
        return status
