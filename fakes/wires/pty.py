"""Puts a fake on a pseudo terminal, which the host opens by its path as it would a serial line.

The fake keeps the host's end open too, so that hosts may come and go. No pacing: a pty is fast.
A host that sets another speed than the device has (its `baud`) hears and says rubbish.
Source: Modbus sheet, section 6, for what a pty does and needs.
"""

import contextlib
import os
import termios
import tty
from collections import deque

from fakes.wires.baud import heard_at, maybe_speed
from fakes.wires.disturbance import Disturbance, Fake, Late
from fakes.wires.sockets import NEWS_KEPT, READ_SIZE

PTY_BACKLOG = 1024  # beyond the kernel's own 4 to 16 KiB; old news to whoever opens next, so little
SPEED_EVERY_S = 0.05  # how often to look what the host has set


class PtyWire(Disturbance):
    """A fake on a pty, at `path`: a link of a name to choose, or what the system calls it.

    `cut`: nothing passes, as with a pulled plug of the serial line, which stays open. `gone`: the
    terminal itself is away, as a USB adapter that was pulled; back at the same link afterwards.
    """

    def __init__(self, fake: Fake, link: str = "", *, seed: int = 0) -> None:
        super().__init__(seed)
        self.chunk = 0  # the device's bytes come in pieces of at most so many; 0: as sent
        self.gone = False  # the USB adapter is pulled
        self.lost = 0  # bytes that nobody read
        self.news: deque[str] = deque(maxlen=NEWS_KEPT)  # what happened, in words; take it out
        self._fake, self._link = fake, os.path.abspath(link) if link else ""
        if self._link and os.path.lexists(self._link) and not os.path.islink(self._link):
            raise FileExistsError(f"{link} is there already and is no link")
        self._late, self._unsent = Late(), bytearray()
        self._master = self._slave = -1
        self._host_baud = self._own_baud
        self._look_s = float("-inf")
        self._open()

    @property
    def path(self) -> str:
        return self._link or self._name

    def step(self, now_s: float) -> None:
        if self.gone != (self._master < 0):
            self._close() if self.gone else self._open()
            self.news.append("terminal gone" if self.gone else "terminal back")
        received = self._receive()
        if received or now_s >= self._look_s:
            self._look_s = now_s + SPEED_EVERY_S
            self._look_at_speed()
        if self.cut or not received:
            received = b""
        received = self._garbled(self.heard(received), to_host=False)
        self.send(now_s, self._fake.exchange(now_s, received), self._late)
        for data in self._late.take(now_s):
            self._unsent += self._garbled(data, to_host=True)
        self._send()

    def close(self) -> None:
        """Close both ends; the link goes too."""
        self._close()

    def _open(self) -> None:
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)  # at once: a fresh pty echoes, and turns CR into LF
        os.set_blocking(self._master, False)
        speed = getattr(termios, f"B{self._own_baud}", None)
        if speed is not None:  # a host that sets none has the right one
            settings = termios.tcgetattr(self._slave)
            settings[4] = settings[5] = speed
            termios.tcsetattr(self._slave, termios.TCSANOW, settings)
        self._name = os.ttyname(self._slave)
        self._host_baud = maybe_speed(self._slave) if self._own_baud else None
        if self._link:
            fresh = f"{self._link}.{os.getpid()}"
            os.symlink(self._name, fresh)
            os.replace(fresh, self._link)  # at once: never half there

    def _close(self) -> None:
        if self._link and os.path.islink(self._link) and os.readlink(self._link) == self._name:
            os.unlink(self._link)
        for end in (self._master, self._slave):
            if end >= 0:
                os.close(end)
        self._master = self._slave = -1
        self._unsent.clear()

    @property
    def _own_baud(self) -> int | None:
        baud = getattr(self._fake, "baud", None)
        return baud if isinstance(baud, int) else None

    def _look_at_speed(self) -> None:
        if self._slave < 0 or self._own_baud is None:
            return
        baud = maybe_speed(self._slave)
        if baud != self._host_baud:
            self._host_baud = baud
            self.news.append(f"host at {baud} baud, device at {self._own_baud}")

    def _garbled(self, data: bytes, *, to_host: bool) -> bytes:
        """What arrives if the two ends' speeds differ."""
        own, host = self._own_baud, self._host_baud
        if not data or not own or not host or own == host:
            return data
        return heard_at(data, own, host) if to_host else heard_at(data, host, own)

    def _receive(self) -> bytes:
        if self._master < 0:
            return b""
        try:
            return os.read(self._master, READ_SIZE)
        except OSError:  # nothing there; or EIO, which passes
            return b""

    def _send(self) -> None:
        if self.cut or self._master < 0:
            self._unsent.clear()
            return
        with contextlib.suppress(OSError):  # no room; or EIO, which passes
            piece = self._unsent[: self.chunk] if self.chunk else self._unsent
            del self._unsent[: os.write(self._master, piece) if piece else 0]
        self.lost += len(self._unsent[PTY_BACKLOG:])
        del self._unsent[PTY_BACKLOG:]
