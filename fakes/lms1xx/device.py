"""Fake SICK LMS1xx on its TCP wire, CoLa-B or CoLa-A, which insists on the order of a session.

Nothing is configured without login, nothing configured counts before Run, login stops measuring
for all hosts, and scans come only to a connection that subscribed. It is silent to the dialect
that it is not set to, as a device is.

Source: lms111 sheet, sections 2 to 6; pace and first scans as in the recorded session.
"""

import math
import re
from collections.abc import Callable
from datetime import datetime, timedelta

from fakes.lms1xx import cola
from fakes.lms1xx.client import Client, Take
from fakes.lms1xx.cola import RefusedError
from fakes.lms1xx.cola_values import Value
from fakes.lms1xx.head import EPOCH, F64, LaserHead
from fakes.lms1xx.models import MODELS
from fakes.lms1xx.scan import SCAN_CONFIG, TIME
from fakes.lms1xx.settings import FILTERS, Settings

HASHES = {2: 0xB21ACE26, 3: 0xF4724744, 4: 0x81BE23AA}  # of the passwords of the user levels
CLIENT = 3  # the level that may change settings
IDLE, CONFIGURING, ROTATING, READY = 3, 2, 4, 7  # STlms
BUSY_STATE, READY_STATE, ERROR_STATE = 0, 1, 2  # SCdevicestate
EVENTS = ("LMDscandata", "LFErec", "LIDoutputstate", "LIDinputstate")
FIELD = re.compile(r"field0[0-2]\d")
INPUTS: list[Value] = [*zip("HI", (1, 0), strict=True), *zip("BBBB", (2, 2, 2, 2), strict=True)]
HOURS = 0x456  # of operation, in tenths


class FakeLms111(LaserHead):
    """One scanner. Plain attributes are its faults and properties, to be set at any time."""

    def __init__(
        self, ranges_m_at: Callable[[float, F64, F64], F64], seed: int, model: str = "LMS111"
    ) -> None:
        if model not in MODELS:
            raise ValueError(f"model: must be one of {', '.join(MODELS)}, is {model!r}")
        super().__init__(ranges_m_at, seed)
        self.mute = False  # its bytes are lost, it hears
        self.deaf = False  # it measures on, and hears nothing
        self.late_s = 0.0  # that all its bytes take longer
        self.slow_answer_s = 0.0  # that its answers take longer
        self.answers_lost = 0  # so many next answers are swallowed, the commands obeyed
        self.cut_next = False  # the next telegram stops in its middle; then off again
        self.refuse: dict[str, int] = {}  # name, or kind and name, of a command -> sFA code
        self.start_silent_s = 0.0  # after power-up
        self.refuse_connections_s = 0.0  # after power-up
        self.dialect_change_s = 0.0  # from EIHstCola until new connections speak the new one
        self.wrong_checksum_rate = 0.0  # of all telegrams
        self.spin_up_s = 0.3  # from Run to the first sweep
        self.temperature_bad = False  # out of its range
        self.in_error = False  # as SCdevicestate tells
        self.untrue_output_step = True  # LMPoutputRange says 0.5 deg, whatever it scans at
        self.measures_at_power_up = False  # without being told to
        self.power_ons = 0x3F  # so far
        self.max_clients = 4  # connections at once
        self._model = MODELS[model]
        self.refuse.update(self._model.refuse)
        self.max_range_m = self._model.max_range_m
        self._version = self._model.telegram_version
        self._written = Settings()
        self._binary = self._binary_next = True  # what a new connection speaks, now and later
        self._changed_s = -math.inf  # device time at which EIHstCola was written
        self._clients: list[Client] = []
        self._single = Client(self, self._binary)  # behind a wire that knows no connections
        self._power_up()

    @property
    def binary(self) -> bool:
        """Whether it speaks CoLa-B; settable, as if it had been set so before power-up."""
        return self._binary

    @binary.setter
    def binary(self, binary: bool) -> None:
        self._binary = self._binary_next = binary
        self._single.begin(binary)

    def _power_up(self) -> None:
        self._clock.restart()
        self._clock_set = EPOCH  # date and time at which its clock showed 0
        self._written.load()
        self._apply()
        self._changed_s = -math.inf
        self._begin_s: float | None = None  # device time of the first sweep
        self._configuring = False
        self._next_sweep = 0
        self._last_telegram = []
        self._binary = self._binary_next
        for client in (*self._clients, self._single):
            client.begin(self._binary)
        self._fresh = True

    def _apply(self) -> None:
        """What was written counts from now on."""
        self._active = self._written.scan
        self.mean_scans, self.two_in_a_row = self._written.mean_scans, self._written.two_in_a_row

    @property
    def stores(self) -> int:
        """Times that its memory was written."""
        return self._written.stores

    def reboot(self, now_s: float) -> None:
        """Power off and on: what mEEwriteall did not keep is lost."""
        self._clock.follow(now_s, self.drift_ppm)
        self._restart()

    def _restart(self, asker: Client | None = None) -> None:
        for client in self._clients:
            client.gone = client is not asker  # who is still to hear the answer
        self._power_up()
        self.clock_offset_us = 0
        self.power_ons += 1

    # -- connections --------------------------------------------------------------------------

    def connect(self, now_s: float) -> Client | None:
        """One more host; None: it is turned away."""
        self.advance(now_s)
        has_room = len(self._clients) < self.max_clients
        if not has_room or self._clock.device_s < self.refuse_connections_s:
            return None
        self._take_dialect()
        client = Client(self, self._binary)
        self._clients.append(client)
        return client

    def leave(self, client: Client) -> None:
        """One host less."""
        if client in self._clients:
            self._clients.remove(client)

    def reconnected(self, now_s: float) -> None:
        """A new host on the single wire: nobody is logged in or subscribed, the rest goes on."""
        self._take_dialect()
        self._single.begin(self._binary)

    def exchange(self, now_s: float, received: bytes) -> bytes:
        """Take what the host wrote; give all that the device has sent up to now_s."""
        return self._single.exchange(now_s, received)

    def advance(self, now_s: float) -> float:
        """Let the device do all that is due; the instant that it has reached."""
        now_s = self._clock.follow(now_s, self.drift_ppm)
        if self._fresh:
            self._fresh = False
            if self.measures_at_power_up:
                self._sweep_from(self.start_silent_s + self.spin_up_s)
        if self._latest_sweep() < self._next_sweep:
            return now_s  # as at most looks: no sweep has ended since the last one
        clients = (*self._clients, self._single)
        wanted = set[str]().union(*(client.subscribed for client in clients))
        if self._configuring:
            wanted = set()  # ready or not: no scan before Run
        for due_s, name, values in self._due_telegrams(wanted):
            for client in clients:
                client.tell(due_s, name, values)
        return now_s

    @property
    def answers(self) -> bool:
        """Whether it has started far enough to answer."""
        return self._clock.device_s >= self.start_silent_s

    def has_wrong_checksum(self) -> bool:
        """Whether the next telegram is to be damaged."""
        return self._hit(self.wrong_checksum_rate)

    def _take_dialect(self) -> None:
        if self._clock.device_s - self._changed_s >= self.dialect_change_s:
            self._binary = self._binary_next

    # -- commands -----------------------------------------------------------------------------

    def carry_out(self, client: Client, kind: str, name: str, take: Take) -> list[Value]:
        """Do what a command says; the values of its answer.

        Raises:
            RefusedError: it is not done, and the code says why.
        """
        match kind:
            case "sRN":
                return self._read(name)
            case "sWN":
                return self._write(client, name, take)
            case "sMN":
                return self._call(client, name, take)
            case _:
                return self._subscribe(client, name, take)

    def _read(self, name: str) -> list[Value]:
        readers: dict[str, Callable[[], list[Value]]] = {
            "LMPscancfg": self._written.scan.scan_config,
            "LMPoutputRange": self._output_range,
            "LMDscandatacfg": self._written.scan.content.values,
            "LMDscandata": self._polled,
            "STlms": self._state_in_full,
            "SCdevicestate": lambda: [("B", self._device_state())],
            "LCMstate": lambda: [("B", self.contamination & 0xFF)],
            "ODpwrc": lambda: [("I", self.power_ons)],
            "ODoprh": lambda: [("I", HOURS)],
            "EIHstCola": lambda: [("B", int(self._binary_next))],
            "FirmwareVersion": lambda: [("S", self._model.firmware)],
            "LocationName": lambda: [("S", b"not defined")],
            "LIDinputstate": lambda: [*INPUTS, ("H", 0)],
            **dict.fromkeys(("DeviceIdent", "0"), self._identity),
        }
        if name in readers:
            return readers[name]()
        if name in FILTERS:
            return list(zip(FILTERS[name][0], self._written.filters[name], strict=True))
        if FIELD.fullmatch(name):
            return [("B", 0)]  # not defined
        raise RefusedError(cola.UNKNOWN_VARIABLE)

    def _write(self, client: Client, name: str, take: Take) -> list[Value]:
        writers = self._written.writers() | {"EIHstCola": ("B", self._set_dialect)}
        if name not in writers:
            self._read(name)  # unknown, or else:
            raise RefusedError(cola.WRITE_DENIED)
        if client.level < CLIENT:
            raise RefusedError(cola.WRITE_DENIED)
        kinds, write = writers[name]
        write(take(kinds))
        return []

    def _call(self, client: Client, name: str, take: Take) -> list[Value]:
        methods: dict[str, tuple[str, int, Callable[[tuple[int, ...]], list[Value]]]] = {
            "SetAccessMode": ("bI", 0, lambda values: self._log_in(client, *values)),
            "Run": ("", 0, lambda _: self._run(client)),
            "mLMPsetscancfg": (SCAN_CONFIG, CLIENT, self._written.set_scan_config),
            "LMCstartmeas": ("", CLIENT, lambda _: self._start(True)),
            "LMCstopmeas": ("", CLIENT, lambda _: self._start(False)),
            "LMCstandby": ("", CLIENT, lambda _: self._start(False)),
            "mEEwriteall": ("", CLIENT, lambda _: self._written.store()),
            "LSPsetdatetime": (TIME, CLIENT, self._set_time),
            "mSCreboot": ("", CLIENT, lambda _: self._told_to_reboot(client)),
        }
        if name not in methods:
            raise RefusedError(cola.UNKNOWN_METHOD)
        kinds, level, method = methods[name]
        if client.level < level:
            raise RefusedError(cola.METHOD_DENIED)
        return method(take(kinds))

    def _subscribe(self, client: Client, name: str, take: Take) -> list[Value]:
        if name not in EVENTS:
            raise RefusedError(cola.UNKNOWN_EVENT)
        (wanted,) = take("B")
        (client.subscribed.add if wanted else client.subscribed.discard)(name)
        return [("B", int(wanted != 0))]

    def _log_in(self, client: Client, level: int, password: int) -> list[Value]:
        if HASHES.get(level) != password:
            return [("B", 0)]
        client.level = level
        self._configuring, self._begin_s = True, None
        return [("B", 1)]

    def _run(self, client: Client) -> list[Value]:
        client.level, self._configuring = 0, False
        has_changed = self._active != self._written.scan
        if self._begin_s is not None and has_changed:
            self._sweep_from(max(self._begin_s, self._clock.device_s))
        self._apply()
        return [("B", 1)]

    def _set_dialect(self, values: tuple[int, ...]) -> None:
        if values[0] > 1:
            raise RefusedError(cola.CONDITION_FAILED)
        self._binary_next, self._changed_s = bool(values[0]), self._clock.device_s

    def _set_time(self, values: tuple[int, ...]) -> list[Value]:
        try:
            when = datetime(*values)  # type: ignore[arg-type]
        except ValueError:
            return [("B", 0)]
        if not 1970 <= when.year < 2100:
            return [("B", 0)]
        self._clock_set = when - timedelta(microseconds=self._uptime_us(self._clock.device_s))
        return [("B", 1)]

    def _start(self, wanted: bool) -> list[Value]:
        """The mirror turns at once and it gets ready, but scans come only after Run."""
        if wanted and self._begin_s is None:
            self._sweep_from(self._clock.device_s + self.spin_up_s)
        elif not wanted:
            self._begin_s = None
        return [("B", 0)]

    def _told_to_reboot(self, client: Client) -> list[Value]:
        self._restart(client)
        return []

    # -- what it tells ------------------------------------------------------------------------

    @property
    def state(self) -> int:
        """The code of STlms."""
        if self._begin_s is not None:
            return READY if self._clock.device_s >= self._begin_s else ROTATING
        return CONFIGURING if self._configuring else IDLE

    def _device_state(self) -> int:
        if self.in_error:
            return ERROR_STATE
        is_busy = self._configuring or self.state == ROTATING
        return BUSY_STATE if is_busy else READY_STATE

    def _output_range(self) -> list[Value]:
        return self._written.scan.output_range(self.untrue_output_step)

    def _identity(self) -> list[Value]:
        return [("S", text) for text in self._model.ident]

    def _polled(self) -> list[Value]:
        """The last complete sweep."""
        latest = self._latest_sweep()
        if latest < 0:
            raise RefusedError(cola.CONDITION_FAILED)
        return self._scan(latest)

    def _state_in_full(self) -> list[Value]:
        now = self._date(self._clock.device_s)
        texts = (now.strftime("%H:%M:%S"), now.strftime("%d.%m.%Y"))
        return [
            *zip("HB", (self.state, int(self.temperature_bad)), strict=True),
            *(("S", text.encode("ascii")) for text in texts),
            *(("I", 0) for _ in range(3)),
        ]
