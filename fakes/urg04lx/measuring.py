"""What the fake URG-04LX does about scans: laser on and off, single scans, and a stream of them.

A scan that is complete while the line still carries another is not sent, and not counted.
Source: urg04lx sheet, sections 3 and 5.
"""

import math

from fakes.urg04lx.faults import Faults
from fakes.urg04lx.head import Head
from fakes.urg04lx.line import Line
from fakes.urg04lx.models import Model
from fakes.urg04lx.scip import (
    BUFFER,
    DATA,
    LASER_OFF,
    OK,
    RESUMED,
    SCANS,
    Carried,
    Request,
    StatusError,
    message,
)
from fakes.urg04lx.series import Series, asked

CHECKING, TROUBLE = range(21, 50), range(50, 98)  # statuses


class Measuring:
    """Head and stream of one scanner; what its methods give is a status and lines."""

    def __init__(self, faults: Faults, model: Model, head: Head, line: Line) -> None:
        self._faults, self._model, self._head, self._line = faults, model, head, line
        self._series: Series | None = None
        self._free_s = -math.inf  # when its last scan has left

    @property
    def is_streaming(self) -> bool:
        return self._series is not None

    @property
    def is_broken(self) -> bool:
        return self._faults.trouble in TROUBLE

    @property
    def is_on_its_way(self) -> bool:
        """The first scan since the laser went on is not complete yet."""
        return self._series is None and self._head.is_lit and self._head.latest is None

    def light(self) -> Carried:
        if self._faults.laser_fails or self.is_broken:
            return b"01", []
        if self._head.is_lit:
            return b"02", []
        self._head.light()
        return OK, []

    def stop(self) -> Carried:
        self._series = None
        self._head.dark()
        return OK, []

    def turn(self, slower: float) -> None:
        """Another speed, a share below the nominal; laser and stream go on."""
        was_lit = self._head.is_lit
        self._head.turn(slower)
        if was_lit:
            self._head.light()
        if self._series:
            self._series.next_scan = self._head.next_scan

    def scan(self, one: Request) -> Carried:
        """The latest.

        Raises:
            StatusError: there is none, or a stream runs.
        """
        wanted = asked(one, self._model)
        self._check_free()
        latest = self._head.latest
        if latest is None:
            raise StatusError(LASER_OFF)
        self._check_trouble()
        stamp_ms, values = self._head.scan(latest)
        return OK, wanted.lines(stamp_ms, values, SCANS[one.command], self._model.dmin)

    def stream(self, one: Request) -> Carried:
        """Scans from the next complete one on; it switches the laser on itself.

        Raises:
            StatusError: as `scan`.
        """
        wanted = asked(one, self._model)
        self._check_free()
        self._check_trouble()
        if self._faults.laser_fails:
            raise StatusError(LASER_OFF)
        if not self._head.is_lit:
            self._head.light()
        self._series = Series(one, wanted, self._head.next_scan)
        return OK, []

    def _check_free(self) -> None:
        if self._series:
            raise StatusError(BUFFER)

    def _check_trouble(self) -> None:
        if self._faults.trouble in CHECKING or self.is_broken:
            raise StatusError(b"%02d" % self._faults.trouble)

    def send_scans(self, now_s: float) -> None:
        """All that the stream has to say up to now."""
        series, head = self._series, self._head
        if series is None or self._is_held_up(now_s, series):
            return
        for scan in range(max(series.next_scan, head.oldest), head.next_scan):
            done_s = head.done_s(scan)
            if scan < series.next_scan or self._free_s > done_s:
                continue
            stamp_ms, values = head.scan(scan)
            series.sent(scan)
            lines = series.wanted.lines(stamp_ms, values, series.width, self._model.dmin)
            self._line.send(done_s, message(series.echo, DATA, lines))
            self._free_s = self._line.free_s
            if series.is_over:
                self.stop()
                return

    def _is_held_up(self, now_s: float, series: Series) -> bool:
        """By trouble, which it tells of once."""
        trouble = self._faults.trouble
        if self.is_broken:
            self._line.send(now_s, message(series.echo, b"%02d" % trouble, []))
            self.stop()
            return True
        was_checking, series.is_checking = series.is_checking, trouble in CHECKING
        if was_checking != series.is_checking:
            status = b"%02d" % trouble if series.is_checking else RESUMED
            self._line.send(now_s, message(series.echo, status, []))
            series.next_scan = self._head.next_scan
        return series.is_checking
