"""A receiver of the planner link behind a UDP or TCP port, served by a thread, for tests."""

import contextlib
import select
import socket
import threading
import time
from typing import Any

from tools.conformance.wire import cobs


class ServedReceiver:
    """Answers whoever speaks to it, until the context ends. `url` is where."""

    def __init__(self, receiver: Any, datagrams: bool = True) -> None:
        self._receiver, self._datagrams = receiver, datagrams
        kind = socket.SOCK_DGRAM if datagrams else socket.SOCK_STREAM
        self._socket = socket.socket(socket.AF_INET, kind)
        self._socket.bind(("127.0.0.1", 0))
        self._wire = self._socket
        self._peer: tuple[str, int] | None = None
        if not datagrams:
            self._socket.listen(1)
        scheme = "udp" if datagrams else "tcp"
        self.url = f"{scheme}://127.0.0.1:{self._socket.getsockname()[1]}"
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._serve)

    def __enter__(self) -> "ServedReceiver":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()
        self._wire.close()
        self._socket.close()

    def _serve(self) -> None:
        while not self._ended.is_set():
            readable, _, _ = select.select([self._wire], [], [], 0.01)
            with contextlib.suppress(ConnectionError):
                if readable:
                    self._take()
                for frame in self._receiver.poll(time.monotonic()):
                    self._say(frame)

    def _take(self) -> None:
        if self._datagrams:
            data, self._peer = self._socket.recvfrom(2048)
            self._receiver.feed_datagram(time.monotonic(), data)
        elif self._wire is self._socket:
            self._wire, self._peer = self._socket.accept()
        elif data := self._wire.recv(4096):
            self._receiver.feed_stream(time.monotonic(), data)
        else:
            self._wire.close()
            self._wire = self._socket

    def _say(self, frame: bytes) -> None:
        if self._datagrams and self._peer:
            self._socket.sendto(frame, self._peer)
        elif self._wire is not self._socket:
            self._wire.sendall(cobs(frame) + b"\0")
