"""A recording around one app: the calls that were recorded, on the bytes that were recorded.

The app is the one that runs on the robot, and what it writes goes nowhere. It is told neither that
its data are old nor by whom it is called, so that it must write to its planners what it wrote then;
`checks` say whether it did. Other settings may be given: then it answers "what if", with an app
beside it that runs as it ran, whose devices it follows.
"""

import math
import time
from collections.abc import Iterator

import numpy as np

from app import App, Ports
from beside import Replayed
from config_file import load_config
from core.config import Config
from core.objects.seen import Seen
from core.paths.cleaning.planned import Planned
from core.saved.encoding import StateError, arrays_from_bytes
from core.saved.state import restore
from recording.frames import seen_from_bytes
from recording.plans import planned_from_bytes
from recording.reader import Recording
from recording.records import (
    ASK,
    ASKED,
    CHANGED,
    IN,
    OUT,
    PLANNED,
    READ_ENDED,
    RESTORED,
    SEEN,
    STEP,
    STOP,
    TURN,
    Record,
)
from tools.replay.followers import followers, leads_of
from tools.replay.identity import PlannerCheck
from tools.replay.opening import opened_devices
from tools.replay.ports import DEVICES, PlayedPort, became_from_bytes, played_ports
from wiring import Devices, devices_on

PLACED_S = 5.0  # for so long it is looked for where the body stood
BodyPlace = tuple[float, float, float]  # x and y (m), yaw (rad)
PLAYED_CALLS = {STEP, TURN, STOP, ASK, RESTORED}


class Player:
    """A recording around one app, with its own settings or `config`.

    Args:
        key: of the planner link, which no recording keeps.
        replayed: the app is to say so in its frames (mode 4): for who sends them on.
        begins_at: where the body stands first, if it begins in the middle of a run; None: where it
            stood then. What the settings say of the ground of the run's start does not count there.

    Raises:
        ConfigError: the recorded settings are none.
        RecordingError: it begins in the middle of a run and does not say how; or it is damaged.

    Attributes:
        lead: the app that runs as it ran; None: it is this one, for no settings are others.
        now_s: host clock of the recording, of the newest call; that of its first record before.
        done: nothing is left to play.
        remarks: what could not be played as it was, for a person.
    """

    def __init__(
        self,
        recording: Recording,
        config: Config | None = None,
        *,
        key: bytes | None = None,
        replayed: bool = False,
        begins_at: BodyPlace | None = None,
    ) -> None:
        self.recording, recorded = recording, load_config(recording.config)
        self.config = recorded if config is None else config
        self.lead = Player(recording, key=key) if self.config != recorded else None
        self._ports, self.remarks = played_ports(recording, self.config), list[str]()
        planners = self._ports[DEVICES : DEVICES + len(self.config.planner.ports)]
        scanner, ahrs, drive = self._ports[:DEVICES]
        ports = Ports(scanner, ahrs, drive, planners[0], tuple(planners[1:]))
        devices, self._seen = self._devices(ports), Replayed[Seen]()
        self._planned = Replayed[Planned | None]()
        self.app = App(
            self.config, ports, session=recording.session, key=key, replayed=replayed,
            devices=devices, frames=self._seen, plans=self._planned,
        )  # fmt: skip
        self.checks = checks_of(planners)
        self.now_s, self.done = 0.0, False
        self.lead_cpu_s = 0.0  # of the app beside it
        self.scanner_bytes = 0
        self.frames: list[bytes] = []  # what the newest call wrote to the first planner
        self._planners = planners
        self._recorded: list[list[bytes]] = [[] for _ in self._ports]  # written by the next call
        self._records = recording.records()
        self._call = self._read_on()  # the next one
        self.begin_s = self.now_s = self._call.t_s if self._call else 0.0
        if not recording.from_start:
            x_m, y_m, yaw_rad = begins_at or begin_of(recording)
            self.app.mapper.go_on_from(np.array([x_m, y_m, 0.0]), yaw_rad, 0.0)

    @property
    def next_s(self) -> float:
        """When the next call was; where there is none, when the newest one was."""
        return self._call.t_s if self._call else self.now_s

    @property
    def lacks(self) -> str:
        """Why no scan can have been mapped, as far as the recording itself says; or ""."""
        if self.scanner_bytes:
            return ""
        return f"the recording holds no byte of the scanner{'' if self.done else ' up to there'}"

    def play_until(self, t_s: float) -> None:
        """All calls up to this instant, by the recording's host clock. Raises RecordingError."""
        for _ in self.steps_until(t_s):
            pass

    def steps_until(self, t_s: float) -> Iterator[float]:
        """The same, call by call: the instant of each once it is played."""
        while not self.done and self.next_s <= t_s:
            self.step()
            yield self.now_s

    def step(self) -> None:
        """The next call. Raises RecordingError: the recording is damaged behind it."""
        call = self._call
        if call is None:
            self.done = True
            return
        following = self._read_on()
        if self.lead is not None:
            begun_s = time.process_time()
            self.lead.step()
            self.lead_cpu_s += time.process_time() - begun_s
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

    def _devices(self, ports: Ports) -> Devices | None:
        """Those of an app that does not run as it ran, or did not begin to run here."""
        own = None
        if not self.recording.from_start:
            own, self.remarks = opened_devices(self.recording, self._ports, self.config)
        if self.lead is None:
            return own
        app = self.lead.app
        app.devices = leads_of(app.devices)
        own = own or devices_on(ports, self.config)
        return followers(app.devices, own, app.config, self.config)

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
                else:
                    ports[number].asked.append((record.t_s, record.data))
            elif kind in PLAYED_CALLS:
                return record
            elif kind == READ_ENDED:
                ports[number].ends_read()
            elif kind == CHANGED:
                ports[number].becomes(became_from_bytes(record.data))
            elif kind == SEEN:
                self._seen.waiting.append(seen_from_bytes(record.data))
            elif kind == PLANNED:
                self._planned.waiting.append(planned_from_bytes(record.data))
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
        elif call.kind == RESTORED:
            self._restore(call.t_s)

    def _readable(self, bits: int) -> list[PlayedPort]:
        """Those of the app's ports that had something to read."""
        number = DEVICES + len(self._planners)
        return [port for k, port in enumerate(self._ports[:number]) if bits >> k & 1]

    def _restore(self, t_s: float) -> None:
        """Go on from the map that the run began with."""
        try:
            arrays = arrays_from_bytes(self.recording.loaded_map or b"")
            restore(self.app.mapper, arrays, self.config, t_s)
        except StateError as error:
            self.remarks.append(f"the run went on from a saved map, the replay does not: {error}")


def begin_of(recording: Recording) -> BodyPlace:
    """Where the body stood when a recording began that begins in the middle of a run.

    From the first place that is told, and the way there as it is played: so that cells, poses and
    the log of that run are in one frame with its replay.
    """
    scout = Player(recording, begins_at=(0.0, 0.0, 0.0))
    for place in recording.places():
        if place.t_s > scout.begin_s + PLACED_S:
            break
        scout.play_until(place.t_s)
        if (way := scout.app.mapper.maybe_pose(place.t_s)) is not None:
            yaw_rad = place.yaw_rad - way.yaw_rad
            cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
            x_m = place.x_m - cos * way.x_m + sin * way.y_m
            return x_m, place.y_m - sin * way.x_m - cos * way.y_m, yaw_rad
    return 0.0, 0.0, 0.0


def checks_of(planners: list[PlayedPort]) -> list[PlannerCheck]:
    names = ["planner"] + [f"planner {number}" for number in range(2, len(planners) + 1)]
    return [PlannerCheck(name, port.datagrams) for name, port in zip(names, planners, strict=True)]
