"""A scanner's bytes as a device that is asked for them, around one app that asks.

Its attitude sensor and wheels are fakes: the robot is level and stands. All bytes pass the app's
own codecs and sessions, on a simulated clock. Needs the simulation.
"""

from pathlib import Path

from app import App, Ports
from core.config import Config
from fakes.ax3500.device import FakeAx3500
from fakes.lms1xx.recorded import RecordedLms111
from fakes.mti.device import FakeMti
from fakes.wires.wire import MemoryPort, Wire
from fakes.world.simple import Motion, TwoWheels
from mapod_link.receiver import Receiver

SESSION = NONCE = 1
LONGEST_START_S = 60.0  # of the session, before the first scan must have come
REST_S = 0.5  # after the last scan, for the last frames
BEGIN_S = 1000.0


class LaserReplay:
    """A recorded scanner, a level attitude and standing wheels around one app."""

    def __init__(self, path: Path, config: Config) -> None:
        self.recording, self.config = RecordedLms111.from_files(path), config
        scanner, ahrs_port, drive_port = MemoryPort(), MemoryPort(), MemoryPort()
        self._link = MemoryPort(datagrams=True)
        drive = FakeAx3500(TwoWheels(), 2)  # which nobody turns
        self._wires = [
            Wire(self.recording, scanner, 0),
            Wire(FakeMti(Motion("still").motion_at, 1), ahrs_port, 0),
            Wire(drive, drive_port, 0),
        ]
        ports = Ports(scanner, ahrs_port, drive_port, self._link)
        self.app = App(config, ports, session=SESSION, replayed=True)
        self.planner, self.frames = Receiver(NONCE), list[bytes]()
        self._ticks, self._rest_s = 0, REST_S

    begin_s = BEGIN_S

    @property
    def now_s(self) -> float:
        return BEGIN_S + self._ticks / self.config.loop.rate_hz

    @property
    def next_s(self) -> float:
        return BEGIN_S + (self._ticks + 1) / self.config.loop.rate_hz

    @property
    def done(self) -> bool:
        """True once all scans have been sent and the frames about them as well."""
        overdue = self.now_s > BEGIN_S + LONGEST_START_S
        return self._rest_s <= 0 or (overdue and self.app.mapper.counts.scans_added == 0)

    @property
    def lacks(self) -> str:
        if self.recording.scans:
            return ""
        return "the file holds no scan: no telegram in it is a CoLa-B scan (sSN LMDscandata)"

    def step(self) -> None:
        self._ticks += 1
        for wire in self._wires:
            wire.step(self.now_s)
        self.app.step(self.now_s)
        self.frames = self._link.take_datagrams()
        for datagram in self.frames:
            self.planner.feed_datagram(self.now_s, datagram)
        for answer in self.planner.poll(self.now_s):
            self._link.give(answer)
        if self.recording.done:
            self._rest_s -= 1.0 / self.config.loop.rate_hz
