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
from fakes.lms1xx.cola import RefusedError, Value, fields, packed, read, unpacked, written
from fakes.lms1xx.faults import Faults
from fakes.lms1xx.head import LaserHead, Truth
from fakes.lms1xx.scan import TIME
from fakes.lms1xx.settings import MODELS, SCAN_CONFIG, WRITABLE, Settings
from fakes.wires.timing import Outbox

HASHES = {2: 0xB21ACE26, 3: 0xF4724744, 4: 0x81BE23AA}  # of the passwords of the user levels
CLIENT = 3  # the level that may change settings
IDLE, CONFIGURING, ROTATING, READY = 3, 2, 4, 7  # STlms
BUSY_STATE, READY_STATE, ERROR_STATE = 0, 1, 2  # SCdevicestate
SCANS = "LMDscandata"
EVENTS = (SCANS, "LFErec", "LIDoutputstate", "LIDinputstate")  # the others never occur
FIELD = re.compile(r"field0[0-2]\d")
INPUTS = fields("HIBBBBH", 1, 0, 2, 2, 2, 2, 0)
HOURS = 0x456  # of operation, in tenths
ANSWER_S = 0.0012
SLOW_ANSWERS_S = {"SetAccessMode": 0.0028, "LMCstartmeas": 0.014}
PREFIXES = {"sRN": "sRA", "sWN": "sWA", "sMN": "sAN", "sEN": "sEA"}

Take = Callable[[str], tuple[int, ...]]  # the arguments of a command, by the kinds it has


class Client:
    """One host's connection: its login, its subscriptions, its dialect; `exchange` is its wire.

    One answer a command, in order; each answer and each scan is one piece.
    """

    def __init__(self, device: "FakeLms111", binary: bool) -> None:
        self.gone = False  # the device has thrown it out; its wire closes then
        self._device = device
        self.begin(binary)

    def begin(self, binary: bool) -> None:
        """As newly connected, or as after a loss of power: nothing that was under way is sent."""
        self.level = 0  # of its login
        self.subscribed: set[str] = set()
        self._binary = binary
        self._reader = cola.CommandReader() if binary else cola.TextReader()
        self._outbox = Outbox()
        self._answered_s = -math.inf

    def left(self, now_s: float) -> None:
        self._device.leave(self)

    def exchange(self, now_s: float, received: bytes) -> bytes:
        now_s = self._device.advance(now_s)
        has_started = self._device.head.clock.device_s >= self._device.start_silent_s
        if has_started and not self._device.deaf:
            for payload in self._reader.feed(now_s, received):
                self._answer(now_s, payload)
        sent = self._outbox.take(now_s - self._device.late_s)
        return b"" if self._device.mute else sent

    def tell(self, due_s: float, values: list[Value]) -> None:
        self._send(due_s, _payload(f"sSN {SCANS} ", values, self._binary), self._binary)

    def _answer(self, now_s: float, payload: bytes) -> None:
        kind, name, arguments = cola.command(payload)
        device, binary = self._device, self._binary  # a reboot may change the dialect

        def take(kinds: str) -> tuple[int, ...]:
            return unpacked(kinds, arguments) if binary else read(kinds, arguments)

        try:
            code = device.refuse.get(f"{kind} {name}", device.refuse.get(name))
            if code is not None:
                raise RefusedError(code)
            if not binary and not cola.is_text(payload):
                raise RefusedError(cola.INVALID_CHARACTER)
            if kind not in PREFIXES:
                raise RefusedError(cola.UNKNOWN_COMMAND)
            values = device.carry_out(self, kind, name, take)
            answer = _payload(f"{PREFIXES[kind]} {name} ", values, binary)
        except RefusedError as refused:
            answer = cola.refusal(refused.code, binary)
        if device.answers_lost > 0:
            device.answers_lost -= 1
            return
        wait_s = SLOW_ANSWERS_S.get(name, ANSWER_S) + device.slow_answer_s
        self._answered_s = max(now_s + wait_s, self._answered_s)
        self._send(self._answered_s, answer, binary)

    def _send(self, due_s: float, payload: bytes, binary: bool) -> None:
        device = self._device
        telegram = cola.frame(payload) if binary else cola.text_frame(payload)
        if device.head.hit(device.wrong_checksum_rate):
            telegram = telegram[:-1] + bytes([telegram[-1] ^ 0xFF])
        if device.cut_next:
            device.cut_next = False
            telegram = telegram[: len(telegram) // 2]
        self._outbox.put(due_s, telegram)


def _payload(head: str, values: list[Value], binary: bool) -> bytes:
    if binary:
        return head.encode("latin-1") + packed(values)
    return head.encode("latin-1") + written(values) if values else head.rstrip().encode()


class FakeLms111(Faults):
    """One scanner. Its faults and properties are attributes (`Faults`), to be set at any time.

    Args:
        ranges_m_at: what its beams meet (`LaserHead`).
    """

    def __init__(self, ranges_m_at: Truth, seed: int, model: str = "LMS111") -> None:
        if model not in MODELS:
            raise ValueError(f"model: must be one of {', '.join(MODELS)}, is {model!r}")
        super().__init__()
        self._model = MODELS[model]
        self.refuse.update(self._model.refuse)
        self.max_range_m = self._model.max_range_m
        self._written = Settings()
        version = self._model.telegram_version
        self.head = LaserHead(self, ranges_m_at, seed, version, self._written.scan)
        self._binary = self._binary_next = True  # what a new connection speaks, now and later
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
        self.head.power_up()
        self._written.load()
        self._apply()
        self._changed_s = -math.inf  # device time at which EIHstCola was written
        self._configuring = False
        self._binary = self._binary_next
        for client in (*self._clients, self._single):
            client.begin(self._binary)
        self._fresh = True

    def _apply(self) -> None:
        """What was written counts from now on."""
        self.head.settings = self._written.scan
        self.mean_scans, self.two_in_a_row = self._written.filters

    def reboot(self, now_s: float) -> None:
        """Power off and on: what mEEwriteall did not keep is lost."""
        self.head.clock.follow(now_s, self.drift_ppm)
        self._restart()

    def _restart(self, asker: Client | None = None) -> None:
        for client in self._clients:
            client.gone = client is not asker  # who is still to hear the answer
        self._power_up()
        self.clock_offset_us = self.first_scan = 0
        self.power_ons += 1

    def connect(self, now_s: float) -> Client | None:
        """One more host; None: it is turned away."""
        self.advance(now_s)
        has_room = len(self._clients) < self.max_clients
        if not has_room or self.head.clock.device_s < self.refuse_connections_s:
            return None
        self._take_dialect()
        client = Client(self, self._binary)
        self._clients.append(client)
        return client

    def leave(self, client: Client) -> None:
        if client in self._clients:
            self._clients.remove(client)

    def reconnected(self, now_s: float) -> None:
        """A new host on the single wire: nobody is logged in or subscribed, the rest goes on."""
        self._take_dialect()
        self._single.begin(self._binary)

    def exchange(self, now_s: float, received: bytes) -> bytes:
        return self._single.exchange(now_s, received)

    def advance(self, now_s: float) -> float:
        """Let the device do all that is due; the instant that it has reached."""
        now_s = self.head.clock.follow(now_s, self.drift_ppm)
        if self._fresh:
            self._fresh = False
            if self.measures_at_power_up:
                self.head.sweep_from(self.start_silent_s + self.spin_up_s)
        if not self.head.has_news:
            return now_s  # as at most looks
        clients = (*self._clients, self._single)
        listeners = [client for client in clients if SCANS in client.subscribed]
        # Ready or not: no scan before Run.
        is_wanted = bool(listeners) and not self._configuring
        for due_s, values in self.head.due_scans(is_wanted):
            for client in listeners:
                client.tell(due_s, values)
        return now_s

    def _take_dialect(self) -> None:
        if self.head.clock.device_s - self._changed_s >= self.dialect_change_s:
            self._binary = self._binary_next

    def carry_out(self, client: Client, kind: str, name: str, take: Take) -> list[Value]:
        """Do what a command says; the values of its answer.

        Raises:
            RefusedError: it is not done, and the code says why.
        """
        if kind == "sRN":
            return self._read(name)
        do = {"sWN": self._write, "sMN": self._call, "sEN": self._subscribe}[kind]
        return do(client, name, take)

    def _read(self, name: str) -> list[Value]:
        readers: dict[str, Callable[[], list[Value]]] = {
            "LMPscancfg": self._written.read_scan_config,
            "LMDscandata": self._polled,
            "STlms": self._state_in_full,
            "SCdevicestate": lambda: [("B", self._device_state())],
            "LCMstate": lambda: [("B", self.contamination & 0xFF)],
            "ODpwrc": lambda: [("I", self.power_ons)],
            "ODoprh": lambda: [("I", HOURS)],
            "EIHstCola": lambda: [("B", int(self._binary_next))],
            "FirmwareVersion": lambda: [("S", self._model.firmware)],
            "LocationName": lambda: [("S", b"not defined")],
            "LIDinputstate": lambda: INPUTS,
            **dict.fromkeys(("DeviceIdent", "0"), lambda: [("S", t) for t in self._model.ident]),
        }
        if name in readers:
            return readers[name]()
        if name in WRITABLE:
            return self._written.read(name, self.untrue_output_step)
        if FIELD.fullmatch(name):
            return [("B", 0)]  # not defined
        raise RefusedError(cola.UNKNOWN_VARIABLE)

    def _write(self, client: Client, name: str, take: Take) -> list[Value]:
        if name not in WRITABLE and name != "EIHstCola":
            self._read(name)  # unknown, or else:
            raise RefusedError(cola.WRITE_DENIED)
        if client.level < CLIENT:
            raise RefusedError(cola.WRITE_DENIED)
        if name == "EIHstCola":
            self._set_dialect(*take("B"))
        else:
            self._written.write(name, take(WRITABLE[name][0]))
        return []

    def _call(self, client: Client, name: str, take: Take) -> list[Value]:
        methods: dict[str, tuple[str, int, Callable[[tuple[int, ...]], list[Value] | None]]] = {
            "SetAccessMode": ("bI", 0, lambda values: self._log_in(client, *values)),
            "Run": ("", 0, lambda _: self._run(client)),
            "mLMPsetscancfg": (SCAN_CONFIG, CLIENT, self._written.set_scan_config),
            "LMCstartmeas": ("", CLIENT, lambda _: self._start(True)),
            "LMCstopmeas": ("", CLIENT, lambda _: self._start(False)),
            "LMCstandby": ("", CLIENT, lambda _: self._start(False)),
            "mEEwriteall": ("", CLIENT, lambda _: self._written.store()),
            "LSPsetdatetime": (TIME, CLIENT, self._set_time),
            "mSCreboot": ("", CLIENT, lambda _: self._restart(client)),
        }
        if name not in methods:
            raise RefusedError(cola.UNKNOWN_METHOD)
        kinds, level, method = methods[name]
        if client.level < level:
            raise RefusedError(cola.METHOD_DENIED)
        return method(take(kinds)) or []

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
        self._configuring, self.head.begin_s = True, None
        return [("B", 1)]

    def _run(self, client: Client) -> list[Value]:
        client.level, self._configuring = 0, False
        has_changed = self.head.settings != self._written.scan
        if self.head.begin_s is not None and has_changed:
            self.head.sweep_from(max(self.head.begin_s, self.head.clock.device_s))
        self._apply()
        return [("B", 1)]

    def _set_dialect(self, is_binary: int) -> None:
        if is_binary > 1:
            raise RefusedError(cola.CONDITION_FAILED)
        self._binary_next, self._changed_s = bool(is_binary), self.head.clock.device_s

    def _set_time(self, values: tuple[int, ...]) -> list[Value]:
        try:
            when = datetime(*values)  # type: ignore[arg-type]
        except ValueError:
            return [("B", 0)]
        if not 1970 <= when.year < 2100:
            return [("B", 0)]
        uptime_us = self.head.uptime_us(self.head.clock.device_s)
        self.head.clock_set = when - timedelta(microseconds=uptime_us)
        return [("B", 1)]

    def _start(self, wanted: bool) -> list[Value]:
        """The mirror turns at once and it gets ready, but scans come only after Run."""
        if wanted and self.head.begin_s is None:
            self.head.sweep_from(self.head.clock.device_s + self.spin_up_s)
        elif not wanted:
            self.head.begin_s = None
        return [("B", 0)]

    @property
    def state(self) -> int:
        """The code of STlms."""
        if self.head.begin_s is not None:
            return READY if self.head.clock.device_s >= self.head.begin_s else ROTATING
        return CONFIGURING if self._configuring else IDLE

    def _device_state(self) -> int:
        if self.in_error:
            return ERROR_STATE
        is_busy = self._configuring or self.state == ROTATING
        return BUSY_STATE if is_busy else READY_STATE

    def _polled(self) -> list[Value]:
        """The last complete sweep."""
        latest = self.head.latest_sweep()
        if latest < 0:
            raise RefusedError(cola.CONDITION_FAILED)
        return self.head.scan(latest)

    def _state_in_full(self) -> list[Value]:
        now = self.head.date(self.head.clock.device_s)
        texts = (now.strftime("%H:%M:%S"), now.strftime("%d.%m.%Y"))
        return [
            *fields("HB", self.state, int(self.temperature_bad)),
            *(("S", text.encode("ascii")) for text in texts),
            *fields("III", 0, 0, 0),
        ]
