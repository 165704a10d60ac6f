"""Tells systemd that the app is ready, alive, in which state, and that it ends.

Without NOTIFY_SOCKET in the environment nothing is told. No call waits or raises: what the socket
does not take at once is lost, and told anew at the next beat. Source: sd_notify(3).
"""

import os
import socket
from collections.abc import Callable, Mapping

BEAT_S = 0.5  # between two looks at the state; shorter where the watchdog asks for it
BEATS = 4  # at least, in a period of the watchdog: three of them may be lost
LONGEST = 1000  # characters of the state: a message has at most 4096 bytes


class Notifier:
    """The app's end of systemd's notify socket. The loop calls `turn_over`, and nobody else.

    Args:
        environment: NOTIFY_SOCKET, WATCHDOG_USEC and WATCHDOG_PID of it are read.
        describe: what STATUS says, at an instant of the host clock.
    """

    def __init__(self, environment: Mapping[str, str], describe: Callable[[float], str]) -> None:
        self._address = maybe_address(environment.get("NOTIFY_SOCKET", ""))
        self._describe = describe
        period_s = watchdog_s(environment)
        self._feeds, self._beat_s = period_s > 0, min(period_s / BEATS or BEAT_S, BEAT_S)
        self._is_ready, self._told = False, ""
        self._due_s = float("inf") if self._address is None else float("-inf")
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setblocking(False)

    def turn_over(self, now_s: float) -> None:
        """The loop has made a turn, and looked at every input in it: the first means ready."""
        if now_s < self._due_s:
            return
        self._due_s = now_s + self._beat_s
        state = " ".join(self._describe(now_s).split())[:LONGEST]
        lines = [] if self._is_ready else ["READY=1"]
        lines += ["WATCHDOG=1"] if self._feeds else []
        lines += [f"STATUS={state}"] if state != self._told else []
        if lines and self._send(lines):
            self._is_ready, self._told = True, state

    def stopping(self) -> None:
        """The app ends, as it was told to."""
        self._send(["STOPPING=1"])

    def close(self) -> None:
        self._socket.close()

    def _send(self, lines: list[str]) -> bool:
        if self._address is None:
            return False
        try:
            self._socket.sendto("\n".join(lines).encode(), self._address)
        except OSError:
            return False
        return True


def maybe_address(given: str) -> bytes | None:
    """Of a UNIX socket: a path, or "@" and a name that is no file."""
    if given[:1] not in ("/", "@"):
        return None
    path = os.fsencode(given)
    return b"\0" + path[1:] if given[0] == "@" else path


def watchdog_s(environment: Mapping[str, str]) -> float:
    """The period in which this process must be heard; 0 if nobody asks for it."""
    period_us, pid = environment.get("WATCHDOG_USEC", ""), environment.get("WATCHDOG_PID", "")
    is_meant = pid in ("", str(os.getpid()))
    return int(period_us) / 1e6 if period_us.isdecimal() and is_meant else 0.0
