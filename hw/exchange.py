"""One exchange with a device: ask, wait for the answer, ask again, give up and start again.

A session is a generator: it yields the bytes to write and is sent a Tick. What all sessions do
beside their own protocol is here, in an object that a session is composed of. All its methods that
take time are generators too, for `yield from`; none of them waits or reads a clock.

Three rules make an exchange safe on a line that loses, delays and repeats:

- One command at a time, written once for each try. Nothing that arrived before a command can be its
  answer, so `ask` forgets what was not looked at yet. An answer that comes after its time is a
  danger to the next command: a protocol whose answers do not name their commands must let the line
  fall silent (`until_quiet`), or ask something whose answer does.
- The session sees every tick before anybody waits for an answer in it (`hear`): measurements that
  come in between, signs of a restart. There it may `reply` at once, or raise StartAgainError.
- An attempt that cannot go on ends with StartAgainError, which says why. `fail` keeps the reason
  and `back_off` pauses, longer each time, until `succeed` says that the device delivers.

It refuses to know a protocol: commands are bytes, and the session says which event is an answer.
"""

import math
from collections import deque
from collections.abc import Callable, Generator
from operator import attrgetter
from typing import Any, TypeVar

from hw.device import DeviceStatus, Session, Tick

Result = TypeVar("Result")
Answer = TypeVar("Answer")
Steps = Generator[bytes, Tick, Result]  # a part of a session that ends with a result


class StartAgainError(Exception):
    """The conversation cannot go on; says why, to a person."""


def silent() -> Session:
    """A session after its last words: whatever comes, nothing is asked any more."""
    while True:
        yield b""


class Exchange:
    """A session's conversation with its device.

    Args:
        hear: takes each Tick first and gives the events that an answer may be among.
        pause_s: after a failed attempt; doubles with each one after it.
        longest_pause_s: the most that it doubles to.
    """

    def __init__(
        self,
        status: DeviceStatus,
        hear: Callable[[Tick], list[Any]] = attrgetter("events"),
        *,
        pause_s: float,
        longest_pause_s: float,
    ) -> None:
        self.now_s = 0.0  # host clock, of the newest tick
        self.failure = ""  # why the last attempt ended; "" once one has succeeded
        self._status, self._hear = status, hear
        self._first_pause_s, self._longest_pause_s = pause_s, longest_pause_s
        self._pause_s = pause_s
        self._unread: deque[Any] = deque()  # events of the newest tick, not looked at yet
        self._reply = b""

    # --- one exchange

    def turn(
        self,
        out: bytes = b"",
        due_s: float = -math.inf,
        hears_s: float = -math.inf,
        each_step: bool = False,
    ) -> Steps[list[Any]]:
        """Write; the events of the next turn, which comes with bytes, or when it is due.

        Args:
            due_s: -inf: at the next tick.
            hears_s: bytes that arrive sooner may wait until then.
            each_step: it comes with the next step even if that is sooner.
        """
        status = self._status
        status.due_s, status.hears_s, status.each_step = due_s, hears_s, each_step
        out, self._reply = self._reply + out, b""
        tick = yield out
        self.now_s = tick.now_s
        self._unread.clear()
        return self._hear(tick)

    def reply(self, out: bytes) -> None:
        """From within `hear`: what goes out at this very tick, before anything else."""
        self._reply += out

    def ask(
        self,
        command: bytes,
        matches: Callable[[Any], Answer],
        wait_s: float,
        tries: int = 1,
    ) -> Steps[Answer | None]:
        """The answer to a command, written once for each try; None after the last one.

        Args:
            matches: makes an answer of an event, or None of one that is no answer.
            wait_s: for each try.
        """
        for _ in range(tries):
            self._unread.clear()
            answer = yield from self.wait_for(matches, wait_s, command)
            if answer is not None:
                return answer
        return None

    def wait_for(
        self, matches: Callable[[Any], Answer], wait_s: float, out: bytes = b""
    ) -> Steps[Answer | None]:
        """The first match among what is unread and what comes within wait_s; None: nothing.

        Events behind the match stay unread, for the next `wait_for`.
        """
        until_s = self.now_s + wait_s
        while True:
            while self._unread:
                answer = matches(self._unread.popleft())
                if answer is not None:
                    return answer
            if self.now_s >= until_s:
                return None
            self._unread.extend((yield from self.turn(out, until_s)))
            out = b""

    # --- letting time pass

    def pause(self, seconds: float) -> Steps[None]:
        """Let this time pass; what comes is heard, and no answer."""
        resume_s = self.now_s + seconds
        while self.now_s < resume_s:
            yield from self.turn()

    def until_quiet(
        self, quiet_s: float, limit_s: float, *, least_s: float = 0.0, out: bytes = b""
    ) -> Steps[None]:
        """Let late answers pass: until no event has come for quiet_s, at most limit_s in all.

        Args:
            least_s: so long in any case, even beyond the limit.
            out: written first.
        """
        began_s = heard_s = self.now_s
        while self.now_s - began_s < least_s or (
            self.now_s - heard_s < quiet_s and self.now_s - began_s < limit_s
        ):
            if (yield from self.turn(out)):
                heard_s = self.now_s
            out = b""

    # --- attempts

    def fail(self, why: StartAgainError) -> None:
        """An attempt has ended: the status says why."""
        self.failure = str(why)
        self._status.fall_back("starting", self.failure)

    def back_off(self) -> Steps[None]:
        pause_s = self._pause_s
        self._pause_s = min(2 * pause_s, self._longest_pause_s)
        yield from self.pause(pause_s)

    def succeed(self) -> None:
        """The device delivers: the next failure is the first one again."""
        self.failure, self._pause_s = "", self._first_pause_s
