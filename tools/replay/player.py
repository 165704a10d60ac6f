"""A recording around one app: the calls that were recorded, on the bytes that were recorded.

The app is the one that runs on the robot, and what it writes goes nowhere. It is told neither that
its data are old nor by whom it is called, so that it must write to its planners what it wrote then;
`checks` say whether it did. Other settings may be given: then it answers "what if".
"""

import struct
from collections.abc import Iterator
from typing import Protocol

from app import App, Ports
from config_file import load_config
from core.config import Config
from core.saved.encoding import StateError, arrays_from_bytes
from core.saved.state import restore
from hw.ports.reopening import SILENCE_S
from hw.ports.serial import SILENCE_S as SERIAL_SILENCE_S
from hw.ports.url import parse_url
from mapod_link.receiver import Receiver
from recording.records import Record
from tools.replay.identity import PlannerCheck
from tools.replay.ports import PlayedPort, ReopeningPlayedPort, became_from_bytes

SESSION = 1  # of a recording that tells none
NONCE = 1  # of the receiver that looks for it
DEVICES = 3  # ports before the first planner's
STEP, TURN, STOP, ASK, RESTORE = b"S", b"T", b"X", b"A", b"R"  # calls of the app
OPENED, LOST, IN, OUT, BECAME, READ_ENDED = b"O", b"L", b"I", b"W", b"C", b"N"  # of a port
CALLS = {STEP, TURN, STOP, ASK, RESTORE}
ASKED = struct.Struct("<3d")  # m/s, rad/s, s; then who asks


class Recorded(Protocol):
    """What a player needs of a recording."""

    config: str
    ports: list[str]

    def records(self) -> Iterator[Record]: ...


def session_of(recording: Recorded) -> int:
    """The session that the recorded app told its planner; SESSION where that cannot be known."""
    told = getattr(recording, "session", None)
    if isinstance(told, int):
        return told
    receiver = Receiver(NONCE)
    for record in recording.records():
        if record.kind == OUT and record.port == DEVICES:
            receiver.feed_datagram(record.t_s, record.data)
            receiver.feed_stream(record.t_s, record.data)
        if receiver.geom is not None:
            return receiver.geom.session
    return SESSION


class Player:
    """A recording around one app, with its own settings or `config`.

    Args:
        key: of the planner link, which no recording keeps.
        replayed: the app is to say so in its frames (mode 4): for who sends them on.

    Raises:
        ConfigError: the recorded settings are none.

    Attributes:
        now_s: host clock of the recording, of the newest call; that of its first record before.
        done: nothing is left to play.
        remarks: what could not be played as it was, for a person.
    """

    def __init__(
        self,
        recording: Recorded,
        config: Config | None = None,
        *,
        key: bytes | None = None,
        replayed: bool = False,
    ) -> None:
        self.recording = recording
        self.config = load_config(recording.config) if config is None else config
        self._ports = played_ports(recording, self.config)
        planners = self._ports[DEVICES : DEVICES + len(self.config.planner.ports)]
        scanner, ahrs, drive = self._ports[:DEVICES]
        ports = Ports(scanner, ahrs, drive, planners[0], tuple(planners[1:]))
        session = session_of(recording)
        self.app = App(self.config, ports, session=session, key=key, replayed=replayed)
        names = planner_names(len(planners))
        self.checks = [
            PlannerCheck(name, port.datagrams) for name, port in zip(names, planners, strict=True)
        ]
        self.now_s, self.done, self.remarks = 0.0, False, list[str]()
        self.scanner_bytes = 0
        self.frames: list[bytes] = []  # what the newest call wrote to the first planner
        self._planners = planners
        self._recorded: list[list[bytes]] = [[] for _ in self._ports]  # written by the next call
        self._records = recording.records()
        self._call = self._read_on()  # the next one
        self.begin_s = self.now_s = self._call.t_s if self._call else 0.0

    @property
    def next_s(self) -> float:
        """When the next call was; where there is none, when the newest one was."""
        return self._call.t_s if self._call else self.now_s

    @property
    def lacks(self) -> str:
        """Why no scan can have been mapped, as far as the recording itself says; or ""."""
        return "" if self.scanner_bytes else "the recording holds no byte of the scanner"

    def play_until(self, t_s: float) -> None:
        """All calls up to this instant, by the recording's host clock. Raises RecordingError."""
        while not self.done and self.next_s <= t_s:
            self.step()

    def step(self) -> None:
        """The next call. Raises RecordingError: the recording is damaged behind it."""
        call = self._call
        if call is None:
            self.done = True
            return
        following = self._read_on()
        self._do(call)
        self.now_s = call.t_s
        self.frames = self._planners[0].written
        for k, (check, port) in enumerate(zip(self.checks, self._planners, strict=True), DEVICES):
            if port.written or self._recorded[k]:
                recorded, self._recorded[k] = self._recorded[k], []
                check.compare(call.t_s, recorded, port.written, is_cut=following is None)
        for port in self._ports:
            port.end_call()
        self._call = following
        self.done = following is None

    def _read_on(self) -> Record | None:
        """Hand to the ports what the present call got; the call behind it, None: it was the last.

        What a call got is recorded behind it, so that it is made only when the next one is known.
        """
        ports, recorded = self._ports, self._recorded
        for record in self._records:
            kind, number = record.kind, record.port
            if kind == IN:
                ports[number].arrives(record.data)
                self.scanner_bytes += len(record.data) if number == 0 else 0
            elif kind == OUT:
                if number >= DEVICES:
                    recorded[number].append(record.data)
            elif kind in CALLS:
                return record
            elif kind == OPENED:
                ports[number].opens()
            elif kind == LOST:
                ports[number].is_lost(record.data.decode(errors="replace"))
            elif kind == READ_ENDED:
                ports[number].ends_read()
            elif kind == BECAME:
                ports[number].becomes(became_from_bytes(record.data))
        return None

    def _do(self, call: Record) -> None:
        app = self.app
        if call.kind == TURN:
            app.turn(call.t_s, self._readable(call.port))
        elif call.kind == STEP:
            app.step(call.t_s)
        elif call.kind == STOP:
            app.stop()
        elif call.kind == ASK:
            who = call.data[ASKED.size :].decode(errors="replace")
            app.planners.requests.ask(call.t_s, who, *ASKED.unpack_from(call.data))
        elif call.kind == RESTORE:
            self._restore(call.t_s)

    def _readable(self, bits: int) -> list[PlayedPort]:
        """Those of the app's ports that had something to read."""
        number = DEVICES + len(self._planners)
        return [port for k, port in enumerate(self._ports[:number]) if bits >> k & 1]

    def _restore(self, t_s: float) -> None:
        """Go on from the map that the run began with."""
        try:
            arrays = arrays_from_bytes(getattr(self.recording, "loaded_map", None) or b"")
            restore(self.app.mapper, arrays, self.config, t_s)
        except StateError as error:
            self.remarks.append(f"the run went on from a saved map, the replay does not: {error}")


def planner_names(count: int) -> list[str]:
    return ["planner"] + [f"planner {number}" for number in range(2, count + 1)]


def played_ports(recording: Recorded, config: Config) -> list[PlayedPort]:
    """The ports of a recording, and one that stays closed for each planner that it has not."""
    urls = [config.scanner.port, config.ahrs.port, config.drive.port, *config.planner.ports]
    count = max(len(urls), len(recording.ports))
    wires = getattr(recording, "wires", None) or [_wire_of(url) for url in urls]
    wires = [*wires, *[{"datagrams": True, "silence_s": None}] * (count - len(wires))]
    return [
        PlayedPort(bool(wire["datagrams"]))
        if wire["silence_s"] is None
        else ReopeningPlayedPort(bool(wire["datagrams"]), float(wire["silence_s"]))
        for wire in wires
    ]


def _wire_of(url: str) -> dict[str, object]:
    """What a real port of this URL is, as a recording says it."""
    kind = parse_url(url).kind
    silence_s = SERIAL_SILENCE_S if kind == "serial" else SILENCE_S
    return {"datagrams": kind == "udp", "silence_s": silence_s}
