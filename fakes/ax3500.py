"""Fake Roboteq AX3500 with encoder module, written from its sheet. Nothing of hw/ or core/ in it.

It offers nothing of the later Roboteq families: what it does not know it echoes and answers `-`.
Left open by the sheet and chosen here, most of it as attributes: the boot takes 0.7 s; a logging
line breaks off where RS-232 mode begins; in mixed mode channel 1 gets sum, channel 2 difference.

Source: AX3500 sheet; section numbers stand where they help.
"""

import math
import random
import re
from collections.abc import Sequence
from typing import Literal, Protocol

from fakes.ax3500_encoders import EncoderModule, hex_from_counter
from fakes.ax3500_line import SerialLine

Mode = Literal["rc", "rs232", "rs232_watchdog", "analog"]
MODES: tuple[Mode, ...] = ("rc", "rs232", "rs232_watchdog", "analog")  # as ^00 counts them
CR = 0x0D
PROMPT = "Roboteq v1.9b 06/01/07\rs\rEncoder v1.7\r00\r"  # section 11
LOG_CHARACTER_S = 0.008
WATCHDOG_S = 1.0
TAKE_OVER = 10  # CR in a row that end R/C or analog mode
NO_Z_S = 1.0  # after a reset: the letter would set off firmware loading
LONGEST_LINE = 32
APPLY_S = 0.1  # that ^FF takes

STATUS, IDENTITY, LIMIT_ONE, LIMIT_TWO = 0x89, 0x8A, 0x8B, 0x8C
FACTORY = {  # parameter -> value, section 7
    **dict.fromkeys((0x01, 0x02, 0x07, 0x08, 0x0B), 0x00),
    0x03: 0x20,
    0x04: 0x01,
    **dict.fromkeys((0x0C, 0x0F, 0x10, 0x11), 0x10),
    0x80: 0x01,
    0x81: 0x01,
    0x88: 0x10,
    **dict.fromkeys(range(0x82, 0x88), 0x10),
}
HIGHEST = {0x00: 3, 0x01: 0xC6, 0x07: 4, 0x08: 4, **dict.fromkeys((0x0C, 0x0F, 0x10, 0x11), 63)}
MIXED = (1, 5)  # of ^01, bits 2:0

# thermistor bytes at -40, -35 .. 150 C
THERMISTOR = bytes.fromhex(
    "F8 F6 F3 F0 EB E6 E0 D9 D0 C7 BC B1 A5 99 8C 80 74 68 5D"
    "53 4A 41 3A 33 2D 28 23 1F 1B 18 15 13 11 0F 0D 0C 0B 09 08"
)


class Wheels(Protocol):
    """What hangs on the controller."""

    def counts(self) -> tuple[float, float]:
        """Encoder counts of channel 1 and 2, now; any real numbers."""

    def set_power(self, one: float, two: float) -> None:
        """Power of both channels, -1..1."""


class FakeAx3500:
    """One controller, running, in the mode that ^00 says; faults and properties as attributes."""

    def __init__(
        self, wheels: Wheels, seed: int, mode: Mode = "rs232", *, paced: bool = True
    ) -> None:
        self.counter_offset = (0, 0)  # moves the counters, say close to their ends
        self.rollover: Literal["wrap", "zero"] = "wrap"
        self.mute = False  # hears and counts, says nothing
        self.reply_delay_s = 0.001  # from a command's CR to its answer
        self.boot_s = 0.7  # deaf after a reset
        self.w_rate = 0.0  # chance of a W in front of each character sent
        self.plus_after_read = True  # after ^nn and *nn
        self.minus_on_empty = False  # to a lone CR
        self.echoes_take_over = False  # whether the ten CR come back
        self.log_numbers = 13  # in a logging line: 12, 13, 14 or 16
        self.status = 0x00  # ^89: any bit takes the power away
        self.never_written: set[int] = set()  # parameters that cannot be read until written
        self.battery_v, self.internal_v = 24.06, 12.02
        self.amps, self.celsius = (0.0, 0.0), (25.0, 25.0)
        self.analog_v = (2.5, 2.5, 2.5, 2.5)  # inputs 1..4
        self.inputs = (0, 0)  # E and F
        self.outputs = {"C": False}
        self.parameters = {0x00: MODES.index(mode), **FACTORY}  # flash
        self.flash_writes = 0
        self.watchdog_stops = 0
        self.encoders = EncoderModule(wheels.counts)
        self._motor_mode = self.parameters[0x01]  # flash takes effect at a reset or ^FF
        self._wheels, self._random = wheels, random.Random(seed)
        self._wire = SerialLine()
        self._wire.paced = paced
        self._commands, self._applied = [0, 0], (0, 0)
        self._text = bytearray()  # of the line that the host is writing
        self._returns = 0  # CR in a row
        self._now_s = self._reset_s = -math.inf
        self._wake_s = self._watchdog_s = self._log_s = math.inf  # next of each; inf: none
        self._log_rest = b""
        self._mode: Mode = mode

    @property
    def mode(self) -> Mode:
        """The mode it is in; settable."""
        return self._mode

    @mode.setter
    def mode(self, mode: Mode) -> None:
        self._change_mode(mode, self._now_s)

    @property
    def paced(self) -> bool:
        """Whether characters take their time on the wire; settable."""
        return self._wire.paced

    @paced.setter
    def paced(self, paced: bool) -> None:
        self._wire.paced = paced

    def exchange(self, now_s: float, received: bytes) -> bytes:
        """Take what the host wrote; give all that the controller has sent up to now_s."""
        self._look(now_s)
        self._wire.write(now_s, received)
        while True:
            at_s, happen = min(
                (self._wire.next_arrival_s, self._hear),
                (self._wake_s, self._wake),
                (self._watchdog_s, self._stop),
                (self._log_s, self._log),
                key=lambda event: event[0],
            )
            if at_s > now_s:
                break
            happen(at_s)
        self._apply()
        sent = self._wire.sent(now_s)
        return b"" if self.mute else sent

    def restart(self, now_s: float) -> None:
        """Power fails and comes back: whatever was on the way is lost."""
        self._look(now_s)
        self._wire.clear()
        self._reset(now_s)
        self._apply()

    def command(self, one: int, two: int) -> None:
        """Motor commands of another commander, a radio say; -127..127, the same path as `!A`."""
        self._commands = [max(-127, min(127, int(one))), max(-127, min(127, int(two)))]
        self._apply()

    def send_w(self) -> None:
        """A watchdog letter that means nothing, now."""
        self._send(self._now_s, "W")

    def _look(self, now_s: float) -> None:
        first, self._now_s = self._now_s == -math.inf, now_s
        self.encoders.offset, self.encoders.rollover = self.counter_offset, self.rollover
        self.encoders.sample(now_s)
        if first:
            self._change_mode(self._mode, now_s)

    def _change_mode(self, mode: Mode, at_s: float) -> None:
        self._mode, self._returns, self._log_rest = mode, 0, b""
        self._text.clear()
        running = math.isfinite(at_s) and self._wake_s == math.inf
        self._log_s = at_s if running and mode in ("rc", "analog") else math.inf
        watched = running and mode == "rs232_watchdog"
        self._watchdog_s = at_s + WATCHDOG_S if watched else math.inf

    def _reset(self, at_s: float) -> None:
        self._commands, self.status, self._reset_s = [0, 0], 0x00, at_s
        self._motor_mode = self.parameters[0x01]
        self.encoders.reset(at_s)
        self._wake_s = at_s + self.boot_s
        self._change_mode(MODES[self.parameters[0x00]], at_s)

    def _wake(self, at_s: float) -> None:
        self._wake_s = math.inf
        self._change_mode(self._mode, at_s)
        self._send(at_s, PROMPT if self._log_s < math.inf else f"{PROMPT}OK\r")

    def _stop(self, at_s: float) -> None:
        """The watchdog: a second without a character."""
        self._commands = [0, 0]
        self.watchdog_stops += 1
        self._watchdog_s = at_s + WATCHDOG_S
        self._send(at_s, "W")

    def _log(self, at_s: float) -> None:
        """The next character of the logging line (section 8)."""
        self._log_rest = self._log_rest or self._log_line(at_s)
        self._send(at_s, chr(self._log_rest[0]))
        self._log_rest = self._log_rest[1:]
        self._log_s = at_s + LOG_CHARACTER_S

    def _log_line(self, at_s: float) -> bytes:
        numbers = [command & 0xFF for command in self._commands]
        for query in "VPAME":
            numbers += self._values(query, at_s) or []
        numbers += [*(speed & 0xFF for speed in self.encoders.speeds()), 0, 0]
        return f":{bytes(numbers[: self.log_numbers]).hex().upper()}\r".encode("ascii")

    def _hear(self, at_s: float) -> None:
        """One character has arrived."""
        character = self._wire.take() & 0x7F
        if character == ord("Z") and at_s < self._reset_s + NO_Z_S:
            self.encoders.hung = True
        if self._wake_s < math.inf:
            return
        if self._mode in ("rc", "analog"):
            self._returns = self._returns + 1 if character == CR else 0
            if character == CR and self.echoes_take_over:
                self._send(at_s, "\r")
            if self._returns == TAKE_OVER:
                self._change_mode("rs232_watchdog", at_s)
                self._send(at_s + self.reply_delay_s, "OK\r")
            return
        if self._mode == "rs232_watchdog":
            self._watchdog_s = at_s + WATCHDOG_S
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
        hexadecimal = re.fullmatch(r"([*^])([0-9A-Fa-f]{2})(?: ([0-9A-Fa-f]{2}))?", text)
        if text == "":
            return ["-"] if self.minus_on_empty else []
        if text == "%rrrrrr":
            self._reset(at_s)
            return []
        if text.upper() == "^FF":
            self._motor_mode = self.parameters[0x01]
            self._change_mode(MODES[self.parameters[0x00]], at_s)
            return ["+"]
        if self.encoders.hung and re.match(r"\*|[?!][Qq]|\?[ZzKkDd]", text):
            return []
        if text[0] == "?":
            return self._query(text[1:].upper(), at_s)
        if text[0] == "!":
            return ["+" if self._order(text[1:], at_s) else "-"]
        if hexadecimal is None:
            return ["-"]
        sort, address, value = hexadecimal.groups()
        if value is not None:
            write = self._write if sort == "^" else self.encoders.set_register
            return ["+" if write(int(address, 16), int(value, 16)) else "-"]
        if sort == "*":
            return self._read_reply(self.encoders.maybe_register(int(address, 16), at_s))
        return self._read_reply(self._maybe_parameter(int(address, 16))) or ["-"]

    def _read_reply(self, value: int | None) -> list[str]:
        if value is None:
            return []
        return [f"{value:02X}", "+"] if self.plus_after_read else [f"{value:02X}"]

    def _query(self, which: str, at_s: float) -> list[str]:
        if re.fullmatch("Q[0-9]", which):
            counter = self.encoders.maybe_read(int(which[1]), at_s)
            return ["-"] if counter is None else [hex_from_counter(counter)]
        values = self._values(which, at_s)
        return ["-"] if values is None else [f"{value & 0xFF:02X}" for value in values]

    def _values(self, which: str, at_s: float) -> Sequence[int] | None:
        """The bytes, signed or not, that a query gives (section 4); None: no such query."""
        match which:
            case "V":
                return [abs(power) for power in self._powers()]
            case "A":
                return [_byte(2.0 * amps) for amps in self.amps]
            case "P" | "R":
                volts = self.analog_v[:2] if which == "P" else self.analog_v[2:]
                return [max(-127, min(127, round((volt - 2.5) / 2.5 * 127))) for volt in volts]
            case "M":
                return [thermistor_from_celsius(celsius) for celsius in self.celsius]
            case "E":
                return [_byte(self.battery_v * 256 / 55.0), _byte(self.internal_v * 256 / 28.5)]
            case "I":
                return [*self.inputs, 0 if self.status & 0x80 else 1]
            case "K" | "Z":
                return self.encoders.speeds()
            case "D":
                return self.encoders.distances(at_s)
            case "W":
                return [self.encoders.maybe_register(0x85, at_s) or 0]
        return None

    def _order(self, order: str, at_s: float) -> bool:
        """What `!` asks for; False: nothing that it knows."""
        if order in ("C", "c"):
            self.outputs["C"] = order == "C"
        elif re.fullmatch("[Qq][0-9]", order):
            return self.encoders.order(int(order[1]), at_s)
        elif re.fullmatch("[ABab][0-7][0-9A-Fa-f]", order):
            power = int(order[1:], 16)
            self._commands["AB".index(order[0].upper())] = power if order[0] in "AB" else -power
        else:
            return False
        return True

    def _maybe_parameter(self, address: int) -> int | None:
        if address in self.never_written:
            return None
        limit = _byte(2.0 * 60.0)
        now = {STATUS: self.status, IDENTITY: 0x68, LIMIT_ONE: limit, LIMIT_TWO: limit}
        return now.get(address, self.parameters.get(address))

    def _write(self, address: int, value: int) -> bool:
        if address not in self.parameters or value > HIGHEST.get(address, 0xFF):
            return False
        if address == 0x01 and (value & 0x38 or value & 0x07 == 7):
            return False
        self.parameters[address] = value
        self.never_written.discard(address)
        self.flash_writes += address < 0x80
        return True

    def _powers(self) -> tuple[int, int]:
        """What the motors get, -127..127."""
        one, two = self._commands
        if self.status:
            return 0, 0
        if self._motor_mode & 0x07 in MIXED:
            one, two = one + two, one - two
        return max(-127, min(127, one)), max(-127, min(127, two))

    def _apply(self) -> None:
        powers = self._powers()
        if powers != self._applied:
            self._applied = powers
            self._wheels.set_power(powers[0] / 127, powers[1] / 127)

    def _send(self, at_s: float, text: str) -> None:
        for character in text:
            stray = self.w_rate > 0 and self._random.random() < self.w_rate
            self._wire.send(at_s, f"W{character}".encode("ascii") if stray else character.encode())


def thermistor_from_celsius(celsius: float) -> int:
    """The byte of `?M`, linear between the table's points."""
    place = max(0.0, min(len(THERMISTOR) - 1.0, (celsius + 40.0) / 5.0))
    low = min(int(place), len(THERMISTOR) - 2)
    return round(THERMISTOR[low] + (place - low) * (THERMISTOR[low + 1] - THERMISTOR[low]))


def _byte(value: float) -> int:
    return max(0, min(255, round(value)))
