"""One host's connection to the fake LMS111: its login, its subscriptions, its dialect, its answers.

The device behind it - settings, mirror, clock - is shared. One answer a command, in order; each
answer and each scan is one piece.

Source: lms111 sheet, sections 1 and 2.
"""

import math
from collections.abc import Callable
from typing import Protocol

from fakes.lms1xx import cola
from fakes.lms1xx.cola import RefusedError
from fakes.lms1xx.cola_values import Value, packed, read, unpacked, written
from fakes.wires.timing import Outbox

ANSWER_S = 0.0012
SLOW_ANSWERS_S = {"SetAccessMode": 0.0028, "LMCstartmeas": 0.014}
PREFIXES = {"sRN": "sRA", "sWN": "sWA", "sMN": "sAN", "sEN": "sEA"}

Take = Callable[[str], tuple[int, ...]]  # the arguments of a command, by the kinds it has


class Scanner(Protocol):
    """What a connection needs of the device."""

    mute: bool
    deaf: bool
    late_s: float
    slow_answer_s: float
    answers_lost: int
    cut_next: bool
    refuse: dict[str, int]

    def advance(self, now_s: float) -> float:
        """Let the device do all that is due; the instant that it has reached."""

    @property
    def answers(self) -> bool:
        """Whether it has started far enough to answer."""

    def carry_out(self, client: "Client", kind: str, name: str, take: Take) -> list[Value]:
        """Do what a command says; the values of its answer."""

    def has_wrong_checksum(self) -> bool:
        """Whether the next telegram is to be damaged."""

    def leave(self, client: "Client") -> None:
        """One host less."""


class Client:
    """One connection; `exchange` is its wire."""

    def __init__(self, device: Scanner, binary: bool) -> None:
        self.gone = False  # the device has thrown it out; its wire closes then
        self._device = device
        self.begin(binary)

    def begin(self, binary: bool) -> None:
        """As newly connected, or as after a loss of power: nothing that was under way is sent."""
        self.level = 0  # of its login
        self.subscribed: set[str] = set()
        self.binary = binary
        self._reader = cola.CommandReader() if binary else cola.TextReader()
        self._outbox = Outbox()
        self._answered_s = -math.inf

    def left(self, now_s: float) -> None:
        """This host has gone."""
        self._device.leave(self)

    def exchange(self, now_s: float, received: bytes) -> bytes:
        """Take what this host wrote; give all that the device has sent it up to now_s."""
        now_s = self._device.advance(now_s)
        if self._device.answers and not self._device.deaf:
            for payload in self._reader.feed(now_s, received):
                self._answer(now_s, payload)
        sent = self._outbox.take(now_s - self._device.late_s)
        return b"" if self._device.mute else sent

    def tell(self, due_s: float, name: str, values: list[Value]) -> None:
        """An event that it has subscribed to."""
        if name in self.subscribed:
            payload = self._payload(f"sSN {name} ", values, self.binary)
            self._send(due_s, payload, self.binary)

    def _answer(self, now_s: float, payload: bytes) -> None:
        kind, name, arguments = cola.command(payload)

        def take(kinds: str) -> tuple[int, ...]:
            return unpacked(kinds, arguments) if self.binary else read(kinds, arguments)

        device, binary = self._device, self.binary  # a reboot may change the dialect
        try:
            code = device.refuse.get(f"{kind} {name}", device.refuse.get(name))
            if code is not None:
                raise RefusedError(code)
            if not binary and not (payload.startswith(b"s") and cola.is_printable(payload)):
                raise RefusedError(cola.INVALID_CHARACTER)
            if kind not in PREFIXES:
                raise RefusedError(cola.UNKNOWN_COMMAND)
            values = device.carry_out(self, kind, name, take)
            answer = self._payload(f"{PREFIXES[kind]} {name} ", values, binary)
        except RefusedError as refused:
            answer = cola.refusal(refused.code, binary)
        if device.answers_lost > 0:
            device.answers_lost -= 1
            return
        wait_s = SLOW_ANSWERS_S.get(name, ANSWER_S) + device.slow_answer_s
        self._answered_s = max(now_s + wait_s, self._answered_s)
        self._send(self._answered_s, answer, binary)

    def _payload(self, head: str, values: list[Value], binary: bool) -> bytes:
        if binary:
            return head.encode("latin-1") + packed(values)
        return head.encode("latin-1") + written(values) if values else head.rstrip().encode()

    def _send(self, due_s: float, payload: bytes, binary: bool) -> None:
        telegram = cola.frame(payload) if binary else cola.text_frame(payload)
        if self._device.has_wrong_checksum():
            telegram = telegram[:-1] + bytes([telegram[-1] ^ 0xFF])
        if self._device.cut_next:
            self._device.cut_next = False
            telegram = telegram[: len(telegram) // 2]
        self._outbox.put(due_s, telegram)
