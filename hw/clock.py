"""A device's own time to the host's monotonic clock. Pure arithmetic; reads no clock.

What a device sends arrives late, never early. So of all samples in a window, the least delayed ones
tell the offset between both clocks, and the line under them tells the drift: no arrival lies below
it. A constant part of the delay can't be seen, and is left in.

Measured with exponential jitter of 5 ms in the mean and drift up to 200 ppm, changing slowly: from
the lock on, 99 of 100 times are right within 0.8 ms at 10 Hz, 0.65 ms at 25 Hz and above; 12 s
later within 0.75, 0.4, 0.15, 0.1 ms at 10, 25, 50, 100 Hz. What is read only at ticks is late by
up to one tick more, evenly, which no filter can see.

Refuses to smooth: times of successive samples may step by what a new sample has taught.
Source: design, section 4.
"""

import math
from collections import deque
from itertools import pairwise

BUCKET_S = 0.5  # of arrivals; each bucket keeps its least delayed sample
BUCKETS = 20
WINDOW_S = BUCKETS * BUCKET_S
SLOPE_AFTER_S = 4.0  # a shorter window's slope is mostly noise
MAX_DRIFT = 1e-3
LOCK_S, LOCK_SAMPLES = 0.8, 20  # as many as a scanner of 25 Hz has in that time
UNLOCKED_S = 0.02  # uncertainty until then
NOT_COVERED = 0.05  # share of errors beyond the uncertainty
LEAST_UNCERTAINTY_S = 1e-4
USUAL_DRIFT = 200e-6  # of a quartz, at most: taken for uncertain until the slope is known
LOCK_BELOW_S = 0.005  # of uncertainty; at 1 rad/s it moves what is 10 m away by one cell
MAX_LATE_S = 2.0  # a sample later than this comes from a clock that began anew,
MAX_EARLY_S = 0.5  # and one that much too early as well: the line follows anything less at once

Sample = tuple[float, float]  # arrival (host), arrival minus device time


class DeviceClock:
    """Host time of a device's counter that ticks every tick_s and wraps at wrap_ticks.

    Survives wraps (also unseen ones), gaps, restarts of the device, drift up to MAX_DRIFT.
    """

    def __init__(self, tick_s: float, wrap_ticks: int) -> None:
        self.restarts = 0  # how often the device's time was found to have begun anew
        self.samples = 0  # since it began
        self._tick_s, self._wrap_ticks = tick_s, wrap_ticks
        self._begin()

    def _begin(self) -> None:
        self._least: deque[Sample] = deque(maxlen=BUCKETS)
        self._bucket = -math.inf  # of the newest of them
        self._ticks = 0  # newest sample, unwrapped
        self._arrived_s = self._began_s = -math.inf
        self._line = (0.0, 0.0, 0.0)  # offset at an arrival time, that time, slope
        self._uncertainty_s = math.inf
        self.samples = 0
        self._is_settled = False  # they are enough to trust the offset,
        self.locked = False  # and it is known well enough

    @property
    def uncertainty_s(self) -> float:
        """Not exceeded by 95 of 100 host times, beyond a constant delay; inf before the first."""
        return self._uncertainty_s if self._is_settled or not self.samples else UNLOCKED_S

    def host_s(self, ticks: int, arrived_s: float) -> float:
        """Take in a sample stamped `ticks` that arrived then; the host time of its stamp."""
        passed_s, follows = arrived_s - self._arrived_s, False
        if self.samples:  # unwrapped by the time that passed, it may belong to this clock
            unwrapped = self._nearest(ticks, self._ticks + round(passed_s / self._tick_s))
            late_s, drifted_s = arrived_s - self._from_device(unwrapped), MAX_DRIFT * passed_s
            is_near = -(MAX_EARLY_S + drifted_s) <= late_s <= MAX_LATE_S + drifted_s
            follows = is_near and unwrapped >= self._ticks
        if follows:
            self._ticks = unwrapped
            if passed_s > WINDOW_S:  # nothing of the window is left
                self.samples, self._began_s = 0, arrived_s
        else:
            self.restarts += bool(self.samples)
            self._begin()
            self._ticks, self._began_s = ticks, arrived_s
        self._arrived_s = arrived_s
        self.samples += 1
        # each bucket keeps its least delayed sample; where one comes or goes the line is drawn anew
        offset_s, least, has_changed = arrived_s - self._ticks * self._tick_s, self._least, False
        while least and least[0][0] < arrived_s - WINDOW_S:
            least.popleft()
            has_changed = True
        if not least or self._bucket != arrived_s // BUCKET_S:
            least.append((arrived_s, offset_s))
            self._bucket, has_changed = arrived_s // BUCKET_S, True
        elif offset_s - self._line[2] * (arrived_s - least[-1][0]) < least[-1][1]:
            least[-1], has_changed = (arrived_s, offset_s), True
        if has_changed:
            self._draw()
        self._is_settled = self.samples >= LOCK_SAMPLES and arrived_s - self._began_s >= LOCK_S
        self.locked = self._is_settled and self._uncertainty_s < LOCK_BELOW_S
        return self._from_device(self._ticks)

    def host_s_near(self, ticks: int) -> float:
        """Host time of another stamp of the same counter, within half a wrap of the newest."""
        return self._from_device(self._nearest(ticks, self._ticks))

    def _nearest(self, ticks: int, to: int) -> int:
        """The stamp unwrapped so that it is as near as can be."""
        half = self._wrap_ticks // 2
        return to + (ticks - to + half) % self._wrap_ticks - half

    def _from_device(self, ticks: int) -> float:
        device_s = ticks * self._tick_s
        offset_s, at_s, slope = self._line
        return device_s + offset_s + slope * (device_s + offset_s - at_s)

    def _draw(self) -> None:
        """The highest line under all kept samples, by its slope over the middle of the window."""
        at_s = self._least[-1][0]
        slope, drifted_s = 0.0, USUAL_DRIFT * (at_s - self._least[0][0])
        if at_s - self._least[0][0] >= SLOPE_AFTER_S:
            drifted_s = 0.0
            slope = max(-MAX_DRIFT, min(MAX_DRIFT, _slope_under(list(self._least))))
        heights = [offset_s - slope * (t_s - at_s) for t_s, offset_s in self._least]
        offset_s = min(heights)
        self._line = (offset_s, at_s, slope)
        others = len(heights) - 1
        if not others:
            self._uncertainty_s = UNLOCKED_S
            return
        spread_s = sum(heights) / len(heights) - offset_s
        # exponential delays: P(the least > k spreads) = (1 + k)^-others; one spread more for slope
        doubt_s = spread_s * NOT_COVERED ** (-1 / others)
        self._uncertainty_s = max(doubt_s + drifted_s, LEAST_UNCERTAINTY_S)


def _slope_under(samples: list[Sample]) -> float:
    """Slope of the lower hull's edge over the middle of the samples' time.

    >>> _slope_under([(0.0, 0.0), (1.0, 9.0), (2.0, 1.0), (3.0, 9.0), (4.0, 2.0)])
    0.5
    """
    hull: list[Sample] = []
    for sample in samples:
        t_s, offset_s = sample
        while len(hull) >= 2:
            (a_s, a), (b_s, b) = hull[-2:]
            if not (b - a) * (t_s - a_s) >= (offset_s - a) * (b_s - a_s):
                break  # it turns up there
            hull.pop()
        hull.append(sample)
    middle_s = (samples[0][0] + samples[-1][0]) / 2
    for left, right in pairwise(hull):
        if left[0] <= middle_s <= right[0]:
            return (right[1] - left[1]) / (right[0] - left[0])
    return 0.0
