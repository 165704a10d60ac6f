"""Fake Roboteq AX3500 with encoder module, written from its sheet. Nothing of hw/ or core/ in it.

It offers nothing of the later Roboteq families: what it does not know it echoes and answers `-`.
Left open by the sheet and chosen here: a logging line breaks off where RS-232 mode begins; only a
loss of power, no reset, wakes an encoder module that hangs.

As a program: `python -m fakes.programs.ax3500 --link $HOME/ax3500 --mode rc --fault mute@5s-7s`.

Source: AX3500 sheet; section numbers stand where they help.
"""

import math
import random
import re
from collections.abc import Sequence

from fakes.ax3500.encoders import EncoderModule, hex_from_counter
from fakes.ax3500.line import BAUD, SerialLine
from fakes.ax3500.power import PowerStage, Wheels
from fakes.ax3500.properties import FACTORY, MODES, PROFILES, Mode, Model, Properties

CR = 0x0D
BANNER, ENCODER_BANNER = "Roboteq v1.9b 06/01/07\rs\r", "Encoder v1.7\r00\r"  # section 11
LOG_CHARACTER_S = 0.008
WATCHDOG_S = 1.0
TAKE_OVER = 10  # CR in a row that end R/C or analog mode
NO_Z_S = 1.0  # after a reset: the letter would set off firmware loading
LONGEST_LINE = 32
HEXADECIMAL = re.compile(r"([*$^])([0-9A-Fa-f]{2})(?: ([0-9A-Fa-f]{2}))?")
COUNTER = re.compile("[Qq][0-9]")
OF_ENCODERS = re.compile(r"[*$]|[?!][Qq]|\?[Zz]")
APPLY_S = 0.1  # that ^FF takes
ENCODER_BIT = 0x20  # of the identity
HIGHEST = {0x00: 3, 0x01: 0xC6, 0x07: 4, 0x08: 4, **dict.fromkeys((0x0C, 0x0F, 0x10, 0x11), 63)}


class FakeAx3500(Properties):
    """One controller, running, in the mode that ^00 says."""

    def __init__(
        self,
        wheels: Wheels,
        seed: int,
        mode: Mode = "rs232",
        *,
        model: Model = "AX3500",
        paced: bool = True,
    ) -> None:
        flash = {0x00: MODES.index(mode), **FACTORY}
        super().__init__(model=model, parameters=flash, paced=paced)
        self.baud = BAUD  # of its line
        self._stage = PowerStage(self, wheels)
        self._random = random.Random(seed)
        self.encoders = EncoderModule(self, wheels.counts)
        self._wire = SerialLine(self)
        self._text = bytearray()  # of the line that the host is writing
        self._returns = 0  # CR in a row
        self._now_s = self._reset_s = -math.inf
        self._wake_s = self._watchdog_s = self._log_s = math.inf  # next of each; inf: none
        self._log_rest = b""
        self._mode: Mode = mode
        self._stage.follows_radio = mode in ("rc", "analog")

    def command(self, one: int, two: int) -> None:
        """Sticks of the radio, -127..127: they count in R/C mode, else if `radio_overrides`."""
        self._stage.steer(one, two)

    def powers(self) -> tuple[int, int]:
        return self._stage.powers()

    def condition(self) -> int:
        return self._stage.condition()

    @property
    def mode(self) -> Mode:
        """The mode it is in; settable."""
        return self._mode

    @mode.setter
    def mode(self, mode: Mode) -> None:
        self._change_mode(mode, self._now_s)

    def exchange(self, now_s: float, received: bytes) -> bytes:
        self._look(now_s)
        self._wire.write(now_s, b"" if self.deaf else received)
        while (at_s := self._next_s()) <= now_s:
            match at_s:  # of two at the same instant the first here
                case self._wire.next_arrival_s:
                    self._hear(at_s)
                case self._wake_s:
                    self._wake(at_s)
                case self._watchdog_s:
                    self._stop(at_s)
                case _:
                    self._log(at_s)
        self._stage.apply()
        sent = self._wire.sent(now_s - self.late_s)
        return b"" if self.mute else sent

    def _next_s(self) -> float:
        return min(self._wire.next_arrival_s, self._wake_s, self._watchdog_s, self._log_s)

    def restart(self, now_s: float) -> None:
        """Power fails and comes back: whatever was on the way is lost."""
        self._look(now_s)
        self._wire.clear()
        self.encoders.hung = False
        self._reset(now_s)
        self._stage.apply()

    power_cycle = restart

    def reset(self, now_s: float) -> None:
        """What %rrrrrr does: the power stays, and so does what was on the way."""
        self._look(now_s)
        self._reset(now_s)
        self._stage.apply()

    def send_w(self) -> None:
        """A watchdog letter that means nothing, now."""
        self._send(self._now_s, "W")

    def _look(self, now_s: float) -> None:
        first, self._now_s = self._now_s == -math.inf, now_s
        self.encoders.sample(now_s)
        if first:
            self._change_mode(self._mode, now_s)

    def _change_mode(self, mode: Mode, at_s: float) -> None:
        self._mode, self._returns, self._log_rest = mode, 0, b""
        self._stage.follows_radio = mode in ("rc", "analog")
        if self._stage.follows_radio:
            self._stage.halt()
        self._text.clear()
        running = math.isfinite(at_s) and self._wake_s == math.inf
        self._log_s = at_s if running and mode in ("rc", "analog") else math.inf
        watched = running and mode == "rs232_watchdog"
        self._watchdog_s = at_s + WATCHDOG_S if watched else math.inf

    def _reset(self, at_s: float) -> None:
        self.status, self._reset_s = 0x00, at_s
        self._stage.halt()
        self._stage.adopt_motor_mode()
        self.encoders.reset(at_s)
        self._wake_s, self._stage.awake = at_s + self.boot_s, False
        self._change_mode(MODES[self.parameters[0x00]], at_s)

    def _wake(self, at_s: float) -> None:
        self._wake_s, self._stage.awake = math.inf, True
        self._change_mode(self._mode, at_s)
        says_ok = self.says_ok and self._log_s == math.inf
        self._send(
            at_s,
            BANNER + (ENCODER_BANNER if self.encoder else "") + ("OK\r" if says_ok else ""),
        )

    def _stop(self, at_s: float) -> None:
        """The watchdog: a second without a character."""
        self._stage.halt()
        self.watchdog_stops += 1
        self._watchdog_s = at_s + WATCHDOG_S
        self._send(at_s, "W")

    def _log(self, at_s: float) -> None:
        """The next character of the logging line (section 8)."""
        self._log_rest = self._log_rest or self._log_line()
        self._send(at_s, chr(self._log_rest[0]))
        self._log_rest = self._log_rest[1:]
        self._log_s = at_s + LOG_CHARACTER_S

    def _log_line(self) -> bytes:
        numbers = [command & 0xFF for command in self._stage.wanted()]
        for query in "VPAME":
            numbers += [value & 0xFF for value in self._values(query) or []]
        numbers += [0, 0, 0, 0]  # of the encoders: speeds and what is left out
        return f":{bytes(numbers[: self.log_numbers]).hex().upper()}\r".encode("ascii")

    def _hear(self, at_s: float) -> None:
        character = self._wire.take() & 0x7F
        if character == ord("Z") and at_s < self._reset_s + NO_Z_S:
            self.encoders.hung = True
        if self.reset_after:
            self.reset_after -= 1
            if not self.reset_after:
                self._reset(at_s)
        if self._wake_s < math.inf:
            return
        if self._mode in ("rc", "analog"):
            self._returns = self._returns + 1 if character == CR else 0
            if character == CR and self.echoes_take_over:
                self._send(at_s, "\r")
            if self._returns == TAKE_OVER:
                self._change_mode("rs232_watchdog", at_s)
                self._send(at_s + self.reply_delay_s, "OK\r" if self.says_ok else "")
            return
        if self._mode == "rs232_watchdog":
            self._watchdog_s = at_s + WATCHDOG_S
        if self.echoes:
            self._send(at_s, chr(character))
        if character == CR:
            text = self._text.decode("ascii")
            self._text.clear()
            delay_s = APPLY_S if text.upper() == "^FF" else self.reply_delay_s
            answer = ["-"] if len(text) > LONGEST_LINE else self._answer(text, at_s)
            self._send(at_s + delay_s, "".join(f"{line}\r" for line in answer))
        elif character not in (0x00, 0x0A) and len(self._text) <= LONGEST_LINE:
            self._text.append(character)

    def _answer(self, text: str, at_s: float) -> list[str]:
        """Do what a line says; the lines of the answer, after the echo."""
        if text == "":
            return ["-"] if self.minus_on_empty else []
        if self.refuse and text.upper() in {line.upper() for line in self.refuse}:
            return ["-"]
        if text == "%rrrrrr":
            self._reset(at_s)
            return []
        if text.upper() == "^FF":
            self._stage.adopt_motor_mode()
            self._change_mode(MODES[self.parameters[0x00]], at_s)
            return ["+"]
        if OF_ENCODERS.match(text):
            if not self.encoder or text[0] in "*$".replace(self.register_sign, ""):
                return ["-"]
            if self.encoders.hung:
                return []
        if text[0] == "?":
            return self._query(text[1:].upper(), at_s)
        if text[0] == "!":
            return ["+" if self._order(text[1:], at_s) else "-"]
        hexadecimal = HEXADECIMAL.fullmatch(text)
        if hexadecimal is None:
            return ["-"]
        sort, address, value = hexadecimal.groups()
        if value is not None:
            is_set = sort == "^" and self.set_parameter(int(address, 16), int(value, 16))
            return ["+" if is_set else "-"]
        if sort != "^":
            return self._read_reply(self.encoders.maybe_register(int(address, 16)))
        return self._read_reply(self._maybe_parameter(int(address, 16))) or ["-"]

    def _maybe_parameter(self, address: int) -> int | None:
        if address in self.never_written:
            return None
        match address:
            case 0x89:
                return self.condition()
            case 0x8A:
                return PROFILES[self.model].identity | (ENCODER_BIT if self.encoder else 0)
            case 0x8B | 0x8C:
                return self._stage.limit_byte()
        return self.parameters.get(address)

    def set_parameter(self, address: int, value: int) -> bool:
        """Write one byte, permanent at once, in effect later; False: no such one, or value."""
        if address not in self.parameters or value > HIGHEST.get(address, 0xFF):
            return False
        if address == 0x01 and (value & 0x38 or value & 0x07 == 7):
            return False
        self.parameters[address] = value
        self.never_written.discard(address)
        self.flash_writes += address < 0x80
        return True

    def _read_reply(self, value: int | None) -> list[str]:
        if value is None:
            return []
        return [f"{value:02X}", "+"] if self.plus_after_read else [f"{value:02X}"]

    def _query(self, which: str, at_s: float) -> list[str]:
        if COUNTER.fullmatch(which):
            counter = self.encoders.maybe_read(int(which[1]), at_s)
            return ["-"] if counter is None else [hex_from_counter(counter)]
        values = self._values(which)
        return ["-"] if values is None else [f"{value & 0xFF:02X}" for value in values]

    def _values(self, which: str) -> Sequence[int] | None:
        """The bytes, signed or not, that a query gives (section 4); None: no such query."""
        match which:
            case "V":
                return [abs(power) for power in self.powers()]
            case "A":
                return self._stage.amps_bytes()
            case "P" | "R":
                volts = self.analog_v[:2] if which == "P" else self.analog_v[2:]
                return [max(-127, min(127, round((volt - 2.5) / 2.5 * 127))) for volt in volts]
            case "M":
                return self._stage.thermistor_bytes()
            case "E":
                return self._stage.voltage_bytes()
            case "I":
                return [*self.inputs, 0 if self.condition() & 0x80 else 1]
        return None

    def _order(self, order: str, at_s: float) -> bool:
        """What `!` asks for; False: nothing that it knows."""
        if COUNTER.fullmatch(order):
            return self.encoders.order(int(order[1]), at_s)
        return self._stage.obey(order)

    def _send(self, at_s: float, text: str) -> None:
        text = text.replace("\r", "\r\n") if self.lf_after_cr else text
        if self.w_rate > 0:
            hits = (self._random.random() < self.w_rate for _ in text)
            text = "".join(f"W{one}" if hit else one for one, hit in zip(text, hits, strict=True))
        self._wire.send(at_s, text.encode())
