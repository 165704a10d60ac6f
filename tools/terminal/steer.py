"""A person drives the robot with the keys of a terminal, over a planner link.

A key counts as held for as long as the terminal repeats it: half a second after the last repetition
the robot is told to stop, and any other key stops it at once. Should this program die, the request
runs out within 0.3 s.
"""

import contextlib
import math
import os
import select
import termios
import tty
from collections.abc import Iterator

from mapod_link.receiver import Receiver

PERIOD_S, VALID_S = 0.1, 0.3
HELD_S = 0.5  # terminals wait about so long before they repeat a key
STOPS = 3  # told so often, for one may get lost
STANDS_MPS, STANDS_RADPS = 0.02, 0.03
PATIENCE_S = 1.0  # for a robot to set out
WAYS = {"forward": (1.0, 0.0), "back": (-1.0, 0.0), "left": (0.0, 1.0), "right": (0.0, -1.0)}
KEYS = {
    b"w": "forward", b"s": "back", b"a": "left", b"d": "right",
    b"\x1b[A": "forward", b"\x1b[B": "back", b"\x1b[D": "left", b"\x1b[C": "right",
    b"\x1bOA": "forward", b"\x1bOB": "back", b"\x1bOD": "left", b"\x1bOC": "right",
}  # fmt: skip
HELP = "hold w a s d or an arrow key to drive, any other key stops"


def ways_from_keys(data: bytes) -> list[str]:
    """What each key in what a terminal sent means; "" for one that has no meaning."""
    ways = []
    while data:
        size = 3 if data[:2] in (b"\x1b[", b"\x1bO") else 1
        ways.append(KEYS.get(data[:size].lower() if size == 1 else data[:size], ""))
        data = data[size:]
    return ways


@contextlib.contextmanager
def keys_of(fd: int) -> Iterator[int]:
    """A terminal that gives keys at once, unseen, meanwhile. Raises ValueError: it is none."""
    if not os.isatty(fd):
        raise ValueError("driving needs a terminal with a keyboard")
    before = termios.tcgetattr(fd)
    tty.setcbreak(fd)  # Ctrl-C still ends the program
    try:
        yield fd
    finally:
        termios.tcsetattr(fd, termios.TCSAFLUSH, before)


class Steering:
    """Turns held keys into drive requests of a planner."""

    def __init__(self, planner: Receiver, fd: int, v_mps: float, w_radps: float) -> None:
        self._planner, self._fd = planner, fd
        self._v_mps, self._w_radps = v_mps, w_radps
        self._way = ""
        self._key_s = self._sent_s = self._begun_s = -math.inf
        self._stops = 0  # still to be told

    def step(self, now_s: float) -> None:
        self.take(now_s, self._typed())
        if now_s - self._sent_s < PERIOD_S:
            return
        if self._way:
            v_share, w_share = WAYS[self._way]
            self._ask(now_s, v_share * self._v_mps, w_share * self._w_radps, VALID_S)
        elif self._stops:
            self._stops -= 1
            self._ask(now_s, 0.0, 0.0, 0.0)

    def take(self, now_s: float, typed: bytes) -> None:
        before = self._way
        for way in ways_from_keys(typed):
            self._way, self._key_s = way, now_s
        if now_s - self._key_s > HELD_S:
            self._way = ""
        if self._way == before:
            return
        self._begun_s, self._sent_s = now_s, -math.inf
        self._stops = 0 if self._way else STOPS

    def stop(self, now_s: float) -> None:
        if self._way or self._stops:
            self._way, self._stops = "", 0
            self._ask(now_s, 0.0, 0.0, 0.0)

    def words(self, now_s: float) -> str:
        if not self._way:
            return HELP
        asked = f"{self._way}, {self._v_mps:g} m/s"
        if self._way in ("left", "right"):
            asked = f"turn {self._way}, {self._w_radps:g} rad/s"
        pose = self._planner.pose
        if self._planner.geom is None or pose is None:
            return f"{asked}: nobody hears it, no map has arrived"
        stands = abs(pose.v_mps) < STANDS_MPS and abs(pose.w_radps) < STANDS_RADPS
        if now_s - self._begun_s < PATIENCE_S or not stands:
            return asked
        why = self._planner.advice(now_s)[1]
        return f"{asked}: the robot stands; {why or 'the log of mapod tells why'}"

    def _ask(self, now_s: float, v_mps: float, w_radps: float, valid_s: float) -> None:
        self._sent_s = now_s
        self._planner.drive(now_s, v_mps, w_radps, valid_s)

    def _typed(self) -> bytes:
        ready, _, _ = select.select([self._fd], [], [], 0.0)
        return os.read(self._fd, 256) if ready else b""
