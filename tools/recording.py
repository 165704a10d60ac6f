"""A live run on disk: every byte of every port with the host's time and its direction; and back.

One file. First a line of JSON: `mapod_recording` (2, this form), `version` of mapod, `config` (the
text of mapod.toml) and `ports` (names; the planner's receivers all have the same). Then records,
little-endian: seconds of the host's monotonic clock (f64), kind (one character), port (u8, its
place in `ports`; of T, a bit for each that was readable), length (u32), and so many bytes:

    S  the app steps              O  the port's connection opened    I  bytes that came in
    T  it takes a turn            L  it was lost; the cause as text  W  bytes written

A datagram is a record of its own. The planner's key is not kept. Nothing here waits for a disk: a
thread writes, and a disk that is too slow ends the recording, not the run.
"""

import json
import queue
import struct
import threading
import time
from collections import deque
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from app import App
from hw.device import Port, Reopens

FORM = 2
HEAD = struct.Struct("<dcBI")
KINDS = STEP, TURN, OPENED, LOST, IN, OUT = b"S", b"T", b"O", b"L", b"I", b"W"
MOST_WAITING = 100_000  # records that the disk may be behind: some ten seconds
LONGEST = 1 << 20  # bytes of a record


class RecordingError(Exception):
    """The file is no recording; the text says why."""


@dataclass(frozen=True, slots=True)
class Record:
    """One thing that happened."""

    t_s: float
    kind: bytes
    port: int
    data: bytes


# Writing


class Recorder:
    """Writes a run down: `port` and `app` give stand-ins that do the same, and tell."""

    def __init__(
        self, path: Path, version: str, config: str, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.trouble = ""  # why the recording ended before the run
        self._file = path.open("wb")
        self._first = {"mapod_recording": FORM, "version": version, "config": config}
        self._ports: list[str] = []
        self._clock = clock
        self.at_start: Callable[[], None] = lambda: None  # called before the first step
        self._queue: queue.Queue[bytes | None] = queue.Queue(MOST_WAITING)
        self._thread = threading.Thread(target=self._write, daemon=True)

    def port(self, name: str, port: Port) -> Port:
        """The port, which tells of all that happens to it."""
        self._ports.append(name)
        return cast(Port, RecordedPort(port, len(self._ports) - 1, self.note, self._clock))

    def app(self, app: App) -> App:
        """The app, which tells when it is called. No port comes after that."""
        self._put(json.dumps(self._first | {"ports": self._ports}).encode() + b"\n")
        self._thread.start()
        self.at_start()
        return cast(App, RecordedApp(app, self.note, self._clock))

    def note(self, t_s: float, kind: bytes, port: int = 0, data: bytes = b"") -> None:
        self._put(HEAD.pack(t_s, kind, port, len(data)) + data)

    def close(self) -> None:
        if self._thread.is_alive():
            self._queue.put(None)
            self._thread.join()
        try:
            self._file.close()
        except OSError as error:
            self._note_trouble(error)

    def _put(self, data: bytes) -> None:
        if self.trouble:
            return
        try:
            self._queue.put_nowait(data)
        except queue.Full:
            self.trouble = "the disk is too slow"

    def _write(self) -> None:
        while (data := self._queue.get()) is not None:
            try:
                self._file.write(data)
            except OSError as error:
                self._note_trouble(error)

    def _note_trouble(self, error: OSError) -> None:
        self.trouble = self.trouble or f"the disk: {error.strerror}"


class RecordedPort:
    """A port, and a record of each connection, loss and piece."""

    def __init__(
        self, port: Port, number: int, note: Callable[..., None], clock: Callable[[], float]
    ) -> None:
        self._port, self._number, self._note, self._clock = port, number, note, clock
        self._seen = (0, False)  # connections so far, and whether there is one

    def __getattr__(self, name: str) -> Any:
        """All else is the port's own: datagrams, cause, opened, backlog, fileno, close."""
        return getattr(self._port, name)

    @property
    def silence_s(self) -> float:
        """The port's own patience; infinite where it cannot reopen."""
        return float(getattr(self._port, "silence_s", float("inf")))

    def reopen(self, cause: str) -> None:
        if isinstance(self._port, Reopens):
            self._port.reopen(cause)

    def poll(self, now_s: float) -> bool:
        is_open = self._port.poll(now_s)
        seen = (self._port.opened, is_open)
        if seen != self._seen:
            if seen[0] != self._seen[0]:
                self._note(now_s, OPENED, self._number)
            if not is_open:
                self._note(now_s, LOST, self._number, self._port.cause.encode())
            self._seen = seen
        return is_open

    def read(self) -> list[bytes]:
        pieces = self._port.read()
        for piece in pieces:
            self._note(self._clock(), IN, self._number, piece)
        return pieces

    def write(self, data: bytes) -> None:
        if data:
            self._note(self._clock(), OUT, self._number, data)
        self._port.write(data)


class RecordedApp:
    """An app, and a record of each call that moves it on."""

    def __init__(self, app: App, note: Callable[..., None], clock: Callable[[], float]) -> None:
        self._app, self._note, self._clock = app, note, clock

    def __getattr__(self, name: str) -> Any:
        return getattr(self._app, name)

    def step(self, now_s: float) -> None:
        self._note(now_s, STEP)
        self._app.step(now_s)

    def turn(self, now_s: float, readable: Collection[Port] = ()) -> None:
        ports = (*self._app.ports.of_devices, self._app.ports.planner, *self._app.ports.receivers)
        self._note(now_s, TURN, sum(1 << k for k, port in enumerate(ports) if port in readable))
        self._app.turn(now_s, readable)


# Reading


class Recording:
    """A recording. Raises OSError, RecordingError: it can't be read; it is none."""

    def __init__(self, path: Path) -> None:
        self._path = path
        try:
            with path.open("rb") as file:
                line = file.readline(LONGEST)
            self._at, first = len(line), json.loads(line)
            if first["mapod_recording"] != FORM:
                raise RecordingError(f"a recording of form {first['mapod_recording']}, not {FORM}")
            self.version, self.config = str(first["version"]), str(first["config"])
            self.ports = [str(name) for name in first["ports"]]
        except (ValueError, KeyError, TypeError):
            raise RecordingError("not a recording of mapod") from None

    def records(self) -> Iterator[Record]:
        """In order, without a last one that is not whole. Raises RecordingError: it is damaged."""
        with self._path.open("rb") as file:
            file.seek(self._at)
            while len(head := file.read(HEAD.size)) == HEAD.size:
                t_s, kind, port, length = HEAD.unpack(head)
                if (
                    kind not in KINDS
                    or (port >= len(self.ports) and kind != TURN)
                    or length > LONGEST
                ):
                    raise RecordingError(f"the recording is damaged before byte {file.tell()}")
                data = file.read(length)
                if len(data) < length:
                    return
                yield Record(t_s, kind, port, data)


class PlayedPort:
    """A port that gives what a recorded one gave; what is written to it goes nowhere."""

    def __init__(self, datagrams: bool) -> None:
        self.datagrams, self.cause, self.opened, self.backlog = datagrams, "not opened yet", 0, 0
        self.written: deque[bytes] = deque()
        self._arrived: list[bytes] = []
        self._is_open = False

    def play(self, record: Record) -> None:
        if record.kind == OPENED:
            self.opened, self.cause, self._is_open = self.opened + 1, "", True
        elif record.kind == LOST:
            self.cause, self._is_open = record.data.decode(errors="replace"), False
        elif record.kind == IN:
            self._arrived.append(record.data)

    def fileno(self) -> int:
        return -1

    def poll(self, now_s: float) -> bool:
        return self._is_open

    def read(self) -> list[bytes]:
        pieces, self._arrived = self._arrived, []
        return pieces

    def write(self, data: bytes) -> None:
        if self._is_open:
            self.written.append(data)

    def close(self) -> None:
        """Nothing to let go of."""
