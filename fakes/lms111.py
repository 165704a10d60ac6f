"""Fake SICK LMS111 on its TCP wire, CoLa-B, which insists on the order of a session.

Nothing is configured without login, nothing configured counts before Run, login stops measuring,
and scans come only to the connection that subscribed. It does not speak CoLa-A: set to it, it is
silent, as a device is to the wrong dialect.

Source: lms111 sheet, sections 2 to 5; pace and first scans as in the recorded session.
"""

import math
import re
import struct
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime, timedelta

from fakes import cola
from fakes.cola import RefusedError
from fakes.lms111_head import EPOCH, F64, LaserHead
from fakes.lms111_scan import AREA_START, AREA_STOP, MODES, TIME, Content, ScanSettings
from fakes.timing import Outbox

HASHES = {2: 0xB21ACE26, 3: 0xF4724744, 4: 0x81BE23AA}  # of the passwords of the user levels
CLIENT = 3  # the level that may change settings
ANSWER_S = 0.0012
SLOW_ANSWERS_S = {"SetAccessMode": 0.0028, "LMCstartmeas": 0.014}
IDLE, CONFIGURING, ROTATING, READY = 3, 2, 4, 7  # STlms
BUSY_STATE, READY_STATE = 0, 1  # SCdevicestate
EVENTS = ("LMDscandata", "LFErec", "LIDoutputstate", "LIDinputstate")
FIELD = re.compile(r"field0[0-2]\d")
PLAIN = {"LFPmeanfilter": bytes.fromhex("00000200"), "LFPnto1filter": b"\0", "MSsuppmode": b"\0"}
FIXED = {
    "0": cola.text(b"LMS10x_FieldEval") + cola.text(b"V1.36-21.10.2010"),
    "DeviceIdent": cola.text(b"LMS10x_FieldEval") + cola.text(b"V1.36-21.10.2010"),
    "FirmwareVersion": cola.text(b"V1.80.2  "),
    "ODoprh": (0x456).to_bytes(4, "big"),
    "LocationName": cola.text(b"not defined"),
    "LIDinputstate": bytes.fromhex("0001 00000000 02020202 0000"),
}


class FakeLms111(LaserHead):
    """One scanner. Plain attributes are its faults and properties, to be set at any time."""

    def __init__(self, ranges_m_at: Callable[[float, F64, F64], F64], seed: int) -> None:
        super().__init__(ranges_m_at, seed)
        self.mute = False  # its bytes are lost, it hears
        self.late_s = 0.0
        self.refuse: dict[str, int] = {}  # name, or kind and name, of a command -> sFA code
        self.start_silent_s = 0.0  # after power-up
        self.wrong_checksum_rate = 0.0  # of all telegrams
        self.spin_up_s = 0.3  # from Run to the first sweep
        self.contamination = 0
        self.measures_at_power_up = False  # without being told to
        self.power_ons = 0x3F
        self._outbox = Outbox()
        self._stored = ScanSettings()
        self._binary = self._binary_next = True  # EIHstCola; counts from the next connection on
        self._plain = dict(PLAIN)
        self._power_up()

    def _power_up(self) -> None:
        self._clock.restart()
        self._clock_set = EPOCH  # date and time at which its clock showed 0
        self._settings = self._active = self._stored
        self._reader = cola.CommandReader()
        self._level, self._subscribed = 0, set[str]()
        self._begin_s: float | None = None  # device time of the first sweep
        self._started = self._configuring = False
        self._next_sweep = 0
        self._last_telegram, self._answered_s = b"", -math.inf
        self._fresh = True

    def reboot(self, now_s: float) -> None:
        """Power off and on: what mEEwriteall did not keep is lost."""
        self._clock.follow(now_s, self.drift_ppm)
        self._outbox.clear()
        self._restart()

    def _restart(self) -> None:
        self._power_up()
        self.clock_offset_us = 0
        self.power_ons += 1
        self._binary = self._binary_next

    def reconnected(self, now_s: float) -> None:
        """A new client: nobody is logged in or subscribed, the rest goes on."""
        self._level, self._subscribed = 0, set()
        self._reader = cola.CommandReader()
        self._outbox.clear()
        self._answered_s = -math.inf
        self._binary = self._binary_next

    def exchange(self, now_s: float, received: bytes) -> bytes:
        """Take what the host wrote; give all that the device has sent up to now_s."""
        now_s = self._clock.follow(now_s, self.drift_ppm)
        if self._fresh:
            self._fresh = False
            if self.measures_at_power_up:
                self._begin_s = self.start_silent_s + self.spin_up_s
        for due_s, payload in self._due_telegrams(self._subscribed):
            self._send(due_s, payload)
        if self._clock.device_s >= self.start_silent_s and self._binary:
            for payload in self._reader.feed(now_s, received):
                self._answer(now_s, payload)
        sent = self._outbox.take(now_s - self.late_s)
        return b"" if self.mute else sent

    # -- commands -----------------------------------------------------------------------------

    def _answer(self, now_s: float, payload: bytes) -> None:
        kind, name, arguments = cola.command(payload)
        try:
            code = self.refuse.get(f"{kind} {name}", self.refuse.get(name))
            if code is not None:
                raise RefusedError(code)
            answer = self._carried_out(kind, name, arguments)
        except RefusedError as refused:
            answer = cola.refusal(refused.code)
        due_s = max(now_s + SLOW_ANSWERS_S.get(name, ANSWER_S), self._answered_s)
        self._answered_s = due_s
        self._send(due_s, answer)

    def _carried_out(self, kind: str, name: str, arguments: bytes) -> bytes:
        """The payload of the answer."""
        prefix = {"sRN": "sRA", "sWN": "sWA", "sMN": "sAN", "sEN": "sEA"}.get(kind)
        if prefix is None:
            raise RefusedError(cola.UNKNOWN_COMMAND)
        act = {
            "sRN": self._read, "sWN": self._write, "sMN": self._call, "sEN": self._subscribe
        }[kind]  # fmt: skip
        values = act(name, arguments)
        return f"{prefix} {name} ".encode("latin-1") + values

    def _read(self, name: str, arguments: bytes) -> bytes:
        readers: dict[str, Callable[[], bytes]] = {
            "LMPscancfg": self._settings.scan_config,
            "LMPoutputRange": self._settings.output_range,
            "LMDscandatacfg": self._settings.content.to_bytes,
            "LMDscandata": self._polled,
            "STlms": self._state_in_full,
            "SCdevicestate": lambda: bytes([READY_STATE if self.state == READY else BUSY_STATE]),
            "LCMstate": lambda: bytes([self.contamination & 0xFF]),
            "ODpwrc": lambda: self.power_ons.to_bytes(4, "big"),
            "EIHstCola": lambda: bytes([self._binary_next]),
        }
        if name in readers:
            return readers[name]()
        if FIELD.fullmatch(name):
            return b"\0"  # not defined
        if name in FIXED or name in self._plain:
            return FIXED.get(name) or self._plain[name]
        raise RefusedError(cola.UNKNOWN_VARIABLE)

    def _write(self, name: str, arguments: bytes) -> bytes:
        sizes = {"LMPoutputRange": 14, "LMDscandatacfg": 13, "EIHstCola": 1}
        sizes |= {plain: len(value) for plain, value in self._plain.items()}
        if name not in sizes:
            self._read(name, b"")  # unknown, or else:
            raise RefusedError(cola.WRITE_DENIED)
        if self._level < CLIENT:
            raise RefusedError(cola.WRITE_DENIED)
        _check_size(arguments, sizes[name])
        if name == "LMPoutputRange":
            self._set_output_range(arguments)
        elif name == "LMDscandatacfg":
            content = Content.maybe_from_bytes(arguments)
            if content is None:
                raise RefusedError(cola.CONDITION_FAILED)
            self._settings = replace(self._settings, content=content)
        elif name == "EIHstCola":
            if arguments[0] > 1:
                raise RefusedError(cola.CONDITION_FAILED)
            self._binary_next = bool(arguments[0])
        else:
            self._plain[name] = arguments
        return b""

    def _call(self, name: str, arguments: bytes) -> bytes:
        methods: dict[str, tuple[int, int, Callable[[bytes], bytes]]] = {
            "SetAccessMode": (5, 0, self._log_in),  # bytes of arguments, level, method
            "Run": (0, 0, self._run),
            "mLMPsetscancfg": (18, CLIENT, self._set_scan_config),
            "LMCstartmeas": (0, CLIENT, self._start),
            "LMCstopmeas": (0, CLIENT, self._stop),
            "LMCstandby": (0, CLIENT, self._stop),
            "mEEwriteall": (0, CLIENT, self._store),
            "LSPsetdatetime": (11, CLIENT, self._set_time),
            "mSCreboot": (0, CLIENT, self._told_to_reboot),
        }
        if name not in methods:
            raise RefusedError(cola.UNKNOWN_METHOD)
        size, level, method = methods[name]
        if self._level < level:
            raise RefusedError(cola.METHOD_DENIED)
        _check_size(arguments, size)
        return method(arguments)

    def _subscribe(self, name: str, arguments: bytes) -> bytes:
        if name not in EVENTS:
            raise RefusedError(cola.UNKNOWN_EVENT)
        _check_size(arguments, 1)
        if arguments[0]:
            self._subscribed.add(name)
        else:
            self._subscribed.discard(name)
        return bytes([arguments[0] != 0])

    def _log_in(self, arguments: bytes) -> bytes:
        level, password = struct.unpack(">bI", arguments)
        if HASHES.get(level) != password:
            return b"\0"
        self._level = level
        self._configuring, self._started, self._begin_s = True, False, None
        return b"\1"

    def _run(self, arguments: bytes) -> bytes:
        self._level, self._configuring = 0, False
        self._active = self._settings
        if self._started and self._begin_s is None:
            self._begin_s = self._clock.device_s + self.spin_up_s
            self._next_sweep = 0
        return b"\1"

    def _start(self, arguments: bytes) -> bytes:
        self._started = True
        return b"\0"

    def _stop(self, arguments: bytes) -> bytes:
        self._started = False
        return b"\0"

    def _store(self, arguments: bytes) -> bytes:
        self._stored = self._settings
        return b"\1"

    def _told_to_reboot(self, arguments: bytes) -> bytes:
        self._restart()
        return b""

    def _set_scan_config(self, arguments: bytes) -> bytes:
        frequency, sectors, resolution, start, stop = struct.unpack(">IhIii", arguments)
        bad_frequency = frequency not in (mode[0] for mode in MODES)
        bad_resolution = resolution not in (mode[1] for mode in MODES)
        status = bad_frequency + 2 * bad_resolution
        if not status and (frequency, resolution) not in MODES:
            status = 2
        elif not status and not AREA_START <= start < stop <= AREA_STOP:
            status = 4
        elif not status and sectors != 1:
            status = 5
        if not status:
            self._settings = replace(self._settings, frequency=frequency, resolution=resolution)
        return bytes([status]) + self._settings.scan_config()

    def _set_output_range(self, arguments: bytes) -> None:
        count, _, start, stop = struct.unpack(">HIii", arguments)
        if count != 1 or not AREA_START <= start <= stop <= AREA_STOP:
            raise RefusedError(cola.CONDITION_FAILED)
        self._settings = replace(self._settings, start=start, stop=stop)

    def _set_time(self, arguments: bytes) -> bytes:
        try:
            when = datetime(*TIME.unpack(arguments))
        except ValueError:
            return b"\0"
        if not 1970 <= when.year < 2100:
            return b"\0"
        self._clock_set = when - timedelta(microseconds=self._uptime_us(self._clock.device_s))
        return b"\1"

    # -- what it tells ------------------------------------------------------------------------

    @property
    def state(self) -> int:
        """The code of STlms."""
        if self._begin_s is not None:
            return READY if self._clock.device_s >= self._begin_s else ROTATING
        return CONFIGURING if self._configuring else IDLE

    def _polled(self) -> bytes:
        """The last complete sweep."""
        latest = self._latest_sweep()
        if latest < 0:
            raise RefusedError(cola.CONDITION_FAILED)
        return self._scan(latest)

    def _state_in_full(self) -> bytes:
        now = self._date(self._clock.device_s)
        time, date = now.strftime("%H:%M:%S"), now.strftime("%d.%m.%Y")
        return (
            struct.pack(">HB", self.state, 0)
            + cola.text(time.encode("ascii"))
            + cola.text(date.encode("ascii"))
            + bytes(12)
        )

    def _send(self, due_s: float, payload: bytes) -> None:
        telegram = cola.frame(payload)
        if self._hit(self.wrong_checksum_rate):
            telegram = telegram[:-1] + bytes([telegram[-1] ^ 0xFF])
        self._outbox.put(due_s, telegram)


def _check_size(arguments: bytes, size: int) -> None:
    if len(arguments) != size:
        raise RefusedError(cola.TOO_SHORT if len(arguments) < size else cola.TOO_LONG)
