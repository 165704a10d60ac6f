"""A receiver behind a port as an examinee: real time, and nothing seen but what it sends."""

import select
import time

from hw.ports.wires import open_port, parse_url
from tools.conformance.wire import U8, Splitter

TCP_BAUD = 921_600
OPEN_S = 5.0  # until a port must be open
NAP_S = 0.002  # between two looks at a line that still has bytes to carry


class NotOpenError(Exception):
    """The port does not open."""


class OverPort:
    """An examinee behind udp://, tcp:// or serial://.

    Args:
        gap_s: between two datagrams, for receivers that have room for few.
        baud: no faster than a line of that rate carries bytes over tcp; a serial port has its own.

    Raises:
        NotOpenError: not within OPEN_S.
        PortUrlError: no such URL.
    """

    in_process = False

    def __init__(self, url: str, gap_s: float = 0.0005, baud: int = TCP_BAUD) -> None:
        self._port, self._gap_s = open_port(url), gap_s
        self._byte_s = 10 / (parse_url(url).baud or baud)
        self.datagrams = self._port.datagrams
        self._splitter = Splitter()
        end_s = time.monotonic() + OPEN_S
        while not self._port.poll(time.monotonic()):
            if time.monotonic() > end_s:
                self._port.close()
                raise NotOpenError(self._port.cause)
            time.sleep(NAP_S)

    def now_s(self) -> float:
        return time.monotonic()

    def send(self, data: bytes) -> None:
        """Waits until the line has taken it; a little longer after a datagram."""
        self._port.write(data)
        time.sleep(self._gap_s if self.datagrams else len(data) * self._byte_s)
        while self._port.poll(time.monotonic()) and self._port.backlog > 0:
            time.sleep(NAP_S)

    def listen(self, seconds: float) -> list[bytes]:
        """Waits until something comes."""
        end_s = time.monotonic() + seconds
        while True:
            if self._port.poll(time.monotonic()) and (frames := self._frames()):
                return frames
            left_s = end_s - time.monotonic()
            if left_s <= 0:
                return []
            if self._port.fileno() >= 0:
                select.select([self._port.fileno()], [], [], left_s)
            else:
                time.sleep(min(left_s, NAP_S))

    def _frames(self) -> list[bytes]:
        """What has come; bytes that are no COBS count as an empty frame, which nobody can read."""
        pieces = self._port.read()
        if self.datagrams:
            return pieces
        return [whole or b"" for piece in pieces for whole in self._splitter.feed(piece)]

    def window(self) -> U8 | None:
        return None

    def restart(self) -> bool:
        return False

    def close(self) -> None:
        self._port.close()
