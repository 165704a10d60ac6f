"""Puts a fake on a pseudo terminal, which the host opens by its path as it would a serial line.

The fake keeps the host's end open too, so that hosts may come and go. No pacing: a pty is fast.
A host that sets another speed than the device has (its `baud`) hears and says rubbish.
Source: Modbus sheet, section 6, for what a pty does and needs.
"""

import contextlib
import fcntl
import os
import struct
import termios
import tty
from collections import deque
from itertools import pairwise

from fakes.wires.disturbance import Disturbance, Fake, Late
from fakes.wires.sockets import NEWS_KEPT, READ_SIZE

PTY_BACKLOG = 1024  # beyond the kernel's own 4 to 16 KiB; old news to whoever opens next, so little
SPEED_EVERY_S = 0.05  # how often to look what the host has set

TCGETS2 = 0x802C542A  # tells the speed as a plain number, whatever it is (Linux, x86 and ARM)
TERMIOS2_SIZE, OUTPUT_SPEED = 44, struct.Struct("I")
BITS = 10  # of a character on the line


def maybe_speed(line: int) -> int | None:
    """Bits a second that a terminal is set to; None: it does not say."""
    try:
        settings = fcntl.ioctl(line, TCGETS2, bytes(TERMIOS2_SIZE))
    except OSError:
        return None
    return int(OUTPUT_SPEED.unpack_from(settings, TERMIOS2_SIZE - OUTPUT_SPEED.size)[0]) or None


def heard_at(data: bytes, sent_baud: int, heard_baud: int) -> bytes:
    """The bytes that a UART at heard_baud makes of a run of bytes sent at sent_baud.

    >>> heard_at(b"Q0", 9600, 9600)
    b'Q0'
    >>> heard_at(b"Q0", 9600, 115200).hex(" ")
    '00 00 00 00 00 00'
    """
    if sent_baud == heard_baud:
        return data
    line = [1]
    for byte in data:
        line += [0, *(byte >> bit & 1 for bit in range(8)), 1]
    step = sent_baud / heard_baud  # of the hearer's bit, in bits sent
    line += [1] * (int(BITS * step) + 2)  # idle
    heard, free_at = bytearray(), 0.0
    for start, (before, now) in enumerate(pairwise(line), 1):
        if not before or now or start < free_at:
            continue
        bits = (line[min(len(line) - 1, int(start + (1.5 + bit) * step))] for bit in range(8))
        heard.append(sum(value << bit for bit, value in enumerate(bits)))
        free_at = start + (BITS - 0.5) * step
    return bytes(heard)


class Terminal:
    """Both ends of a pseudo terminal, and the link to it."""

    def __init__(self, link: str, baud: int | None) -> None:
        self._link = os.path.abspath(link) if link else ""
        if self._link and os.path.lexists(self._link) and not os.path.islink(self._link):
            raise FileExistsError(f"{link} is there already and is no link")
        self.open(baud)

    @property
    def path(self) -> str:
        """Where hosts find it."""
        return self._link or self._name

    @property
    def is_open(self) -> bool:
        return self.master >= 0

    def open(self, baud: int | None) -> None:
        """A host that sets no speed has the device's."""
        self.master, self._slave = os.openpty()
        tty.setraw(self._slave)  # at once: a fresh pty echoes, and turns CR into LF
        os.set_blocking(self.master, False)
        speed = getattr(termios, f"B{baud}", None)
        if speed is not None:
            settings = termios.tcgetattr(self._slave)
            settings[4] = settings[5] = speed
            termios.tcsetattr(self._slave, termios.TCSANOW, settings)
        self._name = os.ttyname(self._slave)
        if self._link:
            fresh = f"{self._link}.{os.getpid()}"
            os.symlink(self._name, fresh)
            os.replace(fresh, self._link)  # at once: never half there

    def close(self) -> None:
        """The link goes too."""
        if self._link and os.path.islink(self._link) and os.readlink(self._link) == self._name:
            os.unlink(self._link)
        if self.is_open:
            os.close(self.master)
            os.close(self._slave)
        self.master = self._slave = -1

    def maybe_host_baud(self) -> int | None:
        return maybe_speed(self._slave)

    def read(self) -> bytes:
        try:
            return os.read(self.master, READ_SIZE) if self.is_open else b""
        except OSError:  # nothing there; or EIO, which passes
            return b""

    def write(self, data: bytes | bytearray) -> int:
        """How many bytes it took."""
        with contextlib.suppress(OSError):  # no room; or EIO, which passes
            return os.write(self.master, data) if data else 0
        return 0


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
        self._fake = fake
        self._late, self._unsent = Late(), bytearray()
        self._terminal = Terminal(link, self._own_baud)
        self._host_baud, self._look_s = self._maybe_host_baud(), float("-inf")

    @property
    def path(self) -> str:
        return self._terminal.path

    def step(self, now_s: float) -> None:
        if self.gone == self._terminal.is_open:
            self._come_or_go()
        received = self._terminal.read()
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
        self._terminal.close()

    def _come_or_go(self) -> None:
        if self.gone:
            self._terminal.close()
            self._unsent.clear()
        else:
            self._terminal.open(self._own_baud)
            self._host_baud = self._maybe_host_baud()
        self.news.append("terminal gone" if self.gone else "terminal back")

    @property
    def _own_baud(self) -> int | None:
        baud = getattr(self._fake, "baud", None)
        return baud if isinstance(baud, int) else None

    def _maybe_host_baud(self) -> int | None:
        return self._terminal.maybe_host_baud() if self._own_baud else None

    def _look_at_speed(self) -> None:
        if not self._terminal.is_open or self._own_baud is None:
            return
        baud = self._terminal.maybe_host_baud()
        if baud != self._host_baud:
            self._host_baud = baud
            self.news.append(f"host at {baud} baud, device at {self._own_baud}")

    def _garbled(self, data: bytes, *, to_host: bool) -> bytes:
        """What arrives if the two ends' speeds differ."""
        own, host = self._own_baud, self._host_baud
        if not data or not own or not host or own == host:
            return data
        return heard_at(data, own, host) if to_host else heard_at(data, host, own)

    def _send(self) -> None:
        if self.cut or not self._terminal.is_open:
            self._unsent.clear()
            return
        piece = self._unsent[: self.chunk] if self.chunk else self._unsent
        del self._unsent[: self._terminal.write(piece)]
        self.lost += len(self._unsent[PTY_BACKLOG:])
        del self._unsent[PTY_BACKLOG:]
