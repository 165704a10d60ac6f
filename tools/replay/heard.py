"""A scanner's bytes alone around one app: nobody is asked anything, the robot is level and stands.

Nothing was recorded of how the body lay and moved, so it is said to lie level and to stand still;
what the scanner was set to is taken from its telegrams. Its bytes pass the app's own codec. None of
this needs the simulation.
"""

from collections.abc import Callable, Sequence
from typing import Any, Generic, TypeVar

import msgspec

from app import App, Ports
from core.config import Config
from core.records import Attitude, Scan, WheelCounts
from hw.device import BadFrame, Device, DeviceStatus, NoPort, Port, Session
from hw.lms1xx.options import Lms1xxOptions
from hw.lms1xx.scan import ScanMaker
from hw.lms1xx.status import describe_status
from hw.lms1xx.telegrams import MAX_BEAMS, ScanTelegram, new_parser
from tools.replay.ports import Became, PlayedPort
from tools.replay.streams import Piece
from wiring import Devices

Measurement = TypeVar("Measurement", bound=Attitude | WheelCounts)
ATTITUDES_HZ, COUNTS_HZ = 100.0, 20.0
BYTES_PER_S = 4 * 2 * MAX_BEAMS * 50.0  # four channels of all beams
PIECE = 4096
BEGIN_S = 1000.0  # host clock of the replay at the first byte
LEAD_S = 0.5  # that the body is known to stand before the first scan
REST_S = 0.5  # after the last byte, for the last frames
SESSION = 1


class Steady(Generic[Measurement]):
    """A device without a wire that measures the same for ever."""

    identity, trouble, doubt = "nothing was recorded of it", "", ""
    settled, clock_locked, emergency_stop = True, True, False
    clock_uncertainty_s = 0.0

    def __init__(self, name: str, rate_hz: float, measured: Callable[[float], Measurement]) -> None:
        self.status = DeviceStatus(name, "running", "")
        self.port: Port = NoPort()
        self._period_s, self._measured_at = 1.0 / rate_hz, measured
        self._next = round((BEGIN_S - LEAD_S) * rate_hz)  # number of the next measurement
        self._held: list[Measurement] = []

    @property
    def due_s(self) -> float:
        return self._next * self._period_s

    @property
    def has_heard(self) -> bool:
        return bool(self._held)

    def hear(self, now_s: float) -> None:
        while self.due_s <= now_s:
            self._held.append(self._measured_at(self.due_s))
            self._next += 1
        self.status.heard_s = now_s

    keep = hear

    def step(self, now_s: float) -> Sequence[Measurement]:
        self.hear(now_s)
        measurements, self._held = self._held, []
        return measurements

    def drive(self, left: float, right: float) -> None: ...

    def stop(self) -> None: ...

    def measured(self) -> dict[str, float]:
        return {}


def level_at(t_s: float) -> Attitude:
    return Attitude(t_s, (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def standing_at(t_s: float) -> WheelCounts:
    return WheelCounts(t_s, 0.0, 0.0, 0)


class HeardOptions(Lms1xxOptions, frozen=True):
    """What a scanner was set to, as its telegrams tell; sister models have other rates."""

    scan_rate_hz: float  # type: ignore[assignment]

    def __post_init__(self) -> None:
        """Whatever a scanner sends is taken."""


class HeardScanner(Device[Scan]):
    """A scanner that somebody else had asked for scans: all that it sends is taken."""

    is_impaired, doubt = False, ""

    def __init__(self, port: Port, options: Lms1xxOptions) -> None:
        self._maker, self._options = ScanMaker(options), options
        self._telegrams: list[ScanTelegram] = []
        self._newest: tuple[int, int] | None = None
        super().__init__(
            DeviceStatus("scanner"),
            port,
            lambda: new_parser("auto"),
            self._listen,
            BYTES_PER_S,
            PIECE,
        )

    def _listen(self) -> Session:
        while True:
            tick = yield b""
            for event in tick.events:
                if isinstance(event, ScanTelegram):
                    self._accept(event)

    def _accept(self, telegram: ScanTelegram) -> None:
        number = telegram.telegram_counter, telegram.sent_us
        value = telegram.status[0] | telegram.status[1]
        if number == self._newest:
            self.status.reject(BadFrame("scan telegram repeated", b""))
        elif value and value not in self._options.accepted_status:
            self.status.reject(BadFrame(describe_status(telegram.status), b""))
        else:
            self.status.state, self.status.cause = "running", ""
            self._telegrams.append(telegram)
        self._newest = number

    @property
    def clock_locked(self) -> bool:
        return self._maker.clock.locked

    @property
    def clock_uncertainty_s(self) -> float:
        return self._maker.clock.uncertainty_s

    def _measure(self, now_s: float, events: list[Any]) -> list[Scan]:
        telegrams, self._telegrams = self._telegrams, []
        scans = []
        for telegram in telegrams:
            scan = self._maker.scan(telegram)
            if isinstance(scan, Scan):
                scans.append(scan)
            else:
                self.status.reject(scan)
        return scans


def first_telegram(pieces: Sequence[Piece]) -> ScanTelegram | None:
    """The first scan in a stream; None: there is none."""
    parser = new_parser("auto")
    for t_s, piece in pieces:
        for event in parser.feed(t_s, piece):
            if isinstance(event, ScanTelegram):
                return event
    return None


def config_as_heard(config: Config, telegram: ScanTelegram) -> Config:
    """The settings, but for what the telegrams of the scanner say themselves."""
    channel = telegram.channels.get("DIST1") or next(iter(telegram.channels.values()))
    keys = msgspec.structs.asdict(config.scanner.options)  # type: ignore[arg-type]
    keys |= {"scan_rate_hz": telegram.scan_hz, "angular_step_deg": channel.step_deg}
    scanner = msgspec.structs.replace(config.scanner, options=HeardOptions(**keys))
    robot = msgspec.structs.replace(config.robot, enable_motors=False)
    return msgspec.structs.replace(config, scanner=scanner, robot=robot)


class HeardReplay:
    """Pieces of a scanner's stream at their instants, around one app.

    Args:
        pieces: with the instants of any clock.
    """

    def __init__(self, pieces: Sequence[Piece], config: Config) -> None:
        telegram = first_telegram(pieces)
        self.config = config if telegram is None else config_as_heard(config, telegram)
        self.lacks = "" if telegram else "the scanner's bytes hold no scan (LMDscandata)"
        self._pieces, self._at = pieces, 0
        self._offset_s = BEGIN_S - pieces[0][0] if pieces else 0.0
        self.end_s = (pieces[-1][0] if pieces else 0.0) + self._offset_s + REST_S
        self._port, self._planner = PlayedPort(datagrams=False), PlayedPort(datagrams=True)
        for port in (self._port, self._planner):
            port.becomes(Became(use=1, is_open=True, opened=1, backlog=0, cause=""))
        nowhere = NoPort()
        others = (nowhere,) * (len(self.config.planner.ports) - 1)
        ports = Ports(self._port, nowhere, nowhere, self._planner, others)
        devices = Devices(
            scanner=HeardScanner(self._port, self.config.scanner.options),  # type: ignore[arg-type]
            ahrs=Steady("attitude", ATTITUDES_HZ, level_at),
            drive=Steady("wheels", COUNTS_HZ, standing_at),
        )
        self.app = App(self.config, ports, session=SESSION, replayed=True, devices=devices)
        self.begin_s = self.now_s = BEGIN_S
        self.frames: list[bytes] = []
        self.done = not pieces

    @property
    def next_s(self) -> float:
        due_s = max(self.now_s, self.app.plan.due_s)
        if self._at < len(self._pieces):
            return min(due_s, self._pieces[self._at][0] + self._offset_s)
        return due_s

    def step(self) -> None:
        """The next turn: for bytes that arrive, or because one is due."""
        self.now_s, readable = self.next_s, []
        while self._at < len(self._pieces):
            t_s, piece = self._pieces[self._at]
            if t_s + self._offset_s > self.now_s:
                break
            self._port.arrives(piece)
            self._at += 1
            readable = [self._port]
        self.app.turn(self.now_s, readable)
        self.frames = self._planner.written
        self._port.end_call()
        self._planner.end_call()
        self.done = self.now_s >= self.end_s
