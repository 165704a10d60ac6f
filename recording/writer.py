"""The writer: a process beside the app that keeps what it is told: `-m recording.writer`.

It ends when its pipe does. Nothing that goes wrong here is felt by the app, but for a report that
the recording has ended.
"""

import contextlib
import json
import os
import select
import signal
import sys
import time
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

from recording.flight import BLOCK_S, KEPT_S, FlightRecorder
from recording.openings import Openings
from recording.records import BYE, FIRST, FLIGHT, HEAD, OF_PORTS, OF_WIRES

if TYPE_CHECKING:
    from recording.series import Series

NICE = 19  # saving a flight takes a second of a core, which is to be nobody's
APPS_SIGNALS = {  # a supervisor sends them to all of a service; its end is ours
    signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGABRT, signal.SIGUSR1, signal.SIGUSR2
}  # fmt: skip
SYNC_S = 1.0
READ_BYTES = 1 << 20


class Wanted(NamedTuple):
    """A flight that is to be saved."""

    due_s: float  # the run's clock: what comes until then belongs to it
    cause: str
    message: str


class Writer:
    """What is done with the records of one run."""

    def __init__(self, out: int, flight_s: float = KEPT_S) -> None:
        """`out`: a descriptor for reports, a line of JSON each; `flight_s`: what a flight holds."""
        self._out, self._flight_s = out, flight_s
        self._series: Series | None = None
        self._flight: FlightRecorder | None = None
        self._wanted: Wanted | None = None
        self._openings = Openings([], 0.0)
        self._sequence = 0  # of the records that move the app
        self.is_over = False  # the app has said so

    @property
    def writes(self) -> bool:
        """Whether there is a file to be synced."""
        return self._series is not None

    def take(self, t_s: float, kind: bytes, port: int, data: bytes) -> None:
        """One record from the app."""
        if kind == FIRST:
            self._begin(json.loads(data))
            return
        if kind == FLIGHT:
            why = json.loads(data)
            self._save_wanted()
            self._wanted = Wanted(t_s + why.get("after_s", 0.0), why["cause"], why["message"])
        if self._wanted is not None and t_s >= self._wanted.due_s:
            self._save_wanted()
        if kind == FLIGHT:
            return
        if kind == BYE:
            self.is_over = True
            self.end({"cause": "the run ended", "dropped": data.decode()})
            return
        if self._series is not None:
            try:
                self._series.take(t_s, kind, port, data, self._sequence)
            except OSError as error:
                self._give_up(error)
        if self._flight is not None:
            self._flight.take(t_s, kind, port, data, self._sequence)
        if kind in OF_PORTS:
            self._openings.take(t_s, kind, port, data, self._sequence)
        self._sequence += kind in OF_WIRES

    def sync(self) -> None:
        if self._series is not None:
            try:
                self._series.sync()
            except OSError as error:
                self._give_up(error)

    def save_flight(self, cause: str, message: str) -> None:
        """Now; what one was to be saved for soon is in it."""
        self._wanted = None
        if self._flight is not None:
            try:
                path = self._flight.save(cause, message, {"cause": message})
                self._report("flight_saved", file=str(path), cause=cause, reason=message)
            except OSError as error:
                self._report("flight_not_saved", False, reason=str(error))

    def end(self, end: Mapping[str, str]) -> None:
        self._save_wanted()
        if self._series is not None:
            series, self._series = self._series, None
            try:
                series.finish(end)
                self._report("recording_ended", file=series.name, reason=end["cause"])
            except OSError as error:
                series.abandon()
                self._report("recording_ended", False, reason=str(error))

    def _save_wanted(self) -> None:
        if self._wanted is not None:
            self.save_flight(self._wanted.cause, self._wanted.message)

    def _begin(self, run: Mapping[str, Any]) -> None:
        names = json.loads(run["metadata"]["ports"])
        self._openings = Openings(names, self._flight_s + 2 * BLOCK_S)
        if run["path"]:
            from recording.series import Series  # and all that files take, where there is one

            try:
                self._series = Series(run, self._openings)
                self._report("recording_begun", file=self._series.name)
            except OSError as error:
                self._report("recording_ended", False, reason=str(error))
        if run["flight"]:
            try:
                self._flight = FlightRecorder(run, self._openings, self._flight_s)
            except OSError as error:
                self._report("flight_not_kept", False, reason=str(error))

    def _give_up(self, error: OSError) -> None:
        """The disk is full, or gone: the flight recorder goes on."""
        assert self._series is not None
        self._series.abandon()
        self._series = None
        self._report("recording_ended", False, reason=str(error))

    def _report(self, event: str, is_well: bool = True, **keys: str) -> None:
        """To the app, for its log; where nobody reads it any more it is lost."""
        line = json.dumps({"event": event, "is_well": is_well, **keys}) + "\n"
        try:
            os.write(self._out, line.encode())
        except OSError:
            return


def serve(pipe: int, writer: Writer) -> None:
    """Until the pipe ends, or the app has said that it does."""
    waiting, due_s = bytearray(), time.monotonic() + SYNC_S
    while not writer.is_over:
        wait_s = max(0.0, due_s - time.monotonic()) if writer.writes else None
        ready, _, _ = select.select([pipe], [], [], wait_s)
        if ready:
            data = os.read(pipe, READ_BYTES)
            if not data:
                return
            waiting += data
            taken = 0
            while len(waiting) - taken >= HEAD.size and not writer.is_over:
                t_s, kind, port, length = HEAD.unpack_from(waiting, taken)
                end = taken + HEAD.size + length
                if end > len(waiting):
                    break
                writer.take(t_s, kind, port, bytes(waiting[taken + HEAD.size : end]))
                taken = end
            del waiting[:taken]
        if time.monotonic() >= due_s:
            writer.sync()
            due_s = time.monotonic() + SYNC_S


def main() -> int:
    for number in APPS_SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    with contextlib.suppress(OSError):  # a service may not be allowed to
        os.nice(NICE)
    writer = Writer(sys.stdout.fileno())
    serve(sys.stdin.fileno(), writer)
    if not writer.is_over:
        writer.save_flight("died", "mapod ended without a word")
        writer.end({"cause": "mapod ended without a word"})
    return 0


if __name__ == "__main__":
    sys.exit(main())
