"""A Kinect of this machine, by libfreenect in a process of its own, as a web camera's answer.

The library may end the process that it is in, or hang; so it is started, heard through a pipe, and
ended with the connection (kinect_reader.py). A thread starts and ends it, for that may take a
while. A dump that libfreenect's own recorder has made is played by its `fakenect`.
"""

import contextlib
import fcntl
import os
import signal
import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path
from typing import IO

from hw.ports.opening import Opening
from hw.ports.reopening import ReopeningPort
from hw.ports.url import PortUrl
from hw.runtime.threads import Worker

LIBRARY, INDEX = "libfreenect.so.0.5", "INDEX.txt"
PLAYERS = "usr/lib/*/fakenect"  # of Debian's package, below /
READER = Path(__file__).with_name("kinect_reader.py")
PIPE_BYTES, READ_BYTES = 1 << 20, 1 << 18
MOST_SAID = 4096  # of what it tells when it ends
MOST_A_READ = 4 << 20
START_S = 10.0  # for the camera to start


class Reader:
    """The process, and the pipe that its frames come through."""

    def __init__(self, arguments: list[str], more: dict[str, str]) -> None:
        self._said: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115  closed with the process
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-I", "-S", str(READER), *arguments],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=self._said,
                bufsize=0,
                env={**os.environ, **more},
                start_new_session=True,
            )
        except OSError:
            self._said.close()
            raise
        assert self._process.stdout is not None
        self._pipe = self._process.stdout
        os.set_blocking(self.fd, False)
        with contextlib.suppress(OSError):  # as much as this user may have stays as it is
            fcntl.fcntl(self.fd, fcntl.F_SETPIPE_SZ, PIPE_BYTES)

    @property
    def fd(self) -> int:
        return self._pipe.fileno()

    def why(self) -> str:
        """It has closed its end: the last line that it said."""
        size = self._said.seek(0, os.SEEK_END)
        self._said.seek(max(0, size - MOST_SAID))
        lines = self._said.read(MOST_SAID).decode("utf-8", "replace").split("\n")
        told = [line.strip() for line in lines if line.strip()]
        return told[-1][:300] if told else "libfreenect has ended without a word"

    def close(self) -> None:
        """End it. May wait."""
        with contextlib.suppress(ProcessLookupError):
            self._process.send_signal(signal.SIGKILL)
        self._process.wait()
        self._pipe.close()
        self._said.close()


def started(url: PortUrl) -> Reader:
    """The process for a URL.

    Raises:
        OSError: the dump is not there; no process can be started.
        ValueError: no player is installed.
    """
    if url.kind == "kinect":
        return Reader([LIBRARY, str(url.number), "raw" if url.is_raw else "mm"], {})
    dump = Path(url.path)
    (dump / INDEX).stat()
    players = [str(found / LIBRARY) for found in Path("/").glob(PLAYERS)]
    if not players:
        raise ValueError("a dump needs libfreenect's player: apt install libfreenect0.5")
    return Reader([players[0], "0", "raw"], {"FAKENECT_PATH": str(dump)})


class KinectPort(ReopeningPort):
    """A Kinect; or a dump of one, which is played once. What is written to it goes nowhere.

    It is open once the camera has started.
    """

    def __init__(self, url: PortUrl) -> None:
        super().__init__(f"Kinect {url.number}" if url.kind == "kinect" else url.path)
        self._url, self._worker = url, Worker()
        self._opening = Opening(self._worker, partial(started, url))
        self._reader: Reader | None = None  # while open, or waiting for its first bytes
        self._begun_s, self._first, self._is_over = 0.0, b"", False

    def poll(self, now_s: float) -> bool:
        return not self._is_over and super().poll(now_s)

    def _try_open(self) -> bool:
        if self._reader is None:
            self._reader, self._begun_s = self._opening.maybe_opened(), self._now_s
            if self._reader is None:
                return False
        try:
            self._first = os.read(self._reader.fd, READ_BYTES)
        except BlockingIOError:
            if self._now_s - self._begun_s > START_S:
                raise ValueError(f"does not start within {START_S:g} s") from None
            return False
        if not self._first:
            raise ValueError(self._reader.why())
        return True

    def _read_into(self, pieces: list[bytes]) -> None:
        assert self._reader is not None
        if self._first:
            pieces.append(self._first)
            self._first = b""
        read = 0
        while read < MOST_A_READ:
            piece = os.read(self._reader.fd, READ_BYTES)
            if not piece:
                self._is_over = self._url.kind == "fakenect"
                self._lose(f"{self._where}: {self._reader.why()}")
                return
            pieces.append(piece)
            read += len(piece)

    def reopen(self, cause: str) -> None:
        """A dump goes on at its next frame, however long that takes."""
        if self._url.kind == "kinect":
            super().reopen(cause)

    def _send(self, data: bytes) -> int:
        return len(data)

    def _let_go(self) -> None:
        reader, self._reader = self._reader, None
        if reader is not None:
            self._worker.submit(reader.close)

    def close(self) -> None:
        """Let go of it for good, without waiting until its process has ended."""
        self._opening.give_up(Reader.close)
        super().close()
        self._worker.finish()

    def _descriptor(self) -> int:
        return -1 if self._reader is None else self._reader.fd
