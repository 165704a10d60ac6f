"""When a frame was exposed, by the host's clock; which frame follows which.

The camera stamps frames by a calendar clock that may be set while it runs, so frames are ordered by
their numbers. A stamp that fits neither to the number of frames since the one before nor to their
arrival tells that the clock was set: then time goes on by the frames' period. What is left is a
clock without jumps, for the filter that all devices have (hw/clock.py).
Source: visionary sheet, section 5.
"""

import math

from hw.clock import DeviceClock
from hw.device import BadFrame

LATE_S = 0.25  # beyond the usual: a robot is elsewhere by then
TICK_S, WRAP_TICKS = 1e-3, 1 << 62  # stamps are milliseconds, without an end
UNEVEN_SHARE, UNEVEN_MS = 0.5, 20  # by which a step of the stamps may differ from its frames' time
EARLY_S = 0.1  # a first frame that comes so much sooner than it can: its clock was set meanwhile
MOST_LATE_S = 5.0  # longer no frame is under way: its clock was set meanwhile
FORGET_S = 10.0  # so long late frames are refused; then the clock was set, or the way is longer now


class FrameTimes:
    """The times of one camera's frames.

    Args:
        period_ms: between frames, as it is set.
    """

    def __init__(self, period_ms: float, latency_s: float) -> None:
        self.settings = 0  # how often the camera's clock was set while it ran
        self._period_ms, self._latency_s = period_ms, latency_s
        self._clock = DeviceClock(TICK_S, WRAP_TICKS)
        self._stamp_ms = self._shift_ms = 0  # the newest, as told; and what it is corrected by
        self._came_s, self._is_first = 0.0, True
        self._late_since_s = math.inf  # frames are

    def begin(self, period_ms: float) -> None:
        """Frames begin anew, after a pause of unknown length."""
        self._period_ms = period_ms
        self.lose_count()

    def lose_count(self) -> None:
        """How many frames were captured before the next one is not known."""
        self._is_first = True

    def restart(self) -> None:
        """The camera has begun anew, and its clock may have."""
        self._clock, self._is_first = DeviceClock(TICK_S, WRAP_TICKS), True
        self._late_since_s = math.inf

    @property
    def locked(self) -> bool:
        return self._clock.locked

    @property
    def uncertainty_s(self) -> float:
        return self._clock.uncertainty_s

    def exposed_s(self, stamp_ms: int, frames: int, began_s: float) -> float | BadFrame:
        """The instant of a frame's exposure; or why it is of no use.

        Args:
            frames: since the one before, at least 1.
            began_s: host clock, when its first bytes were read.
        """
        self._follow(stamp_ms, frames, began_s)
        ticks, clock = stamp_ms + self._shift_ms, self._clock
        if clock.samples:
            late_s = began_s - clock.host_s_near(ticks)
            is_late = LATE_S < late_s < MOST_LATE_S
            if is_late:
                self._late_since_s = min(self._late_since_s, began_s)
                if began_s - self._late_since_s < FORGET_S:  # nor may it tell the clock anything
                    return BadFrame(f"a frame that comes {late_s:.2g} s late", b"")
            if is_late or late_s >= MOST_LATE_S or (self._is_first and late_s < -EARLY_S):
                self._clock = clock = DeviceClock(TICK_S, WRAP_TICKS)
        self._is_first, self._late_since_s = False, math.inf
        return clock.host_s(ticks, began_s) - self._latency_s

    def _follow(self, stamp_ms: int, frames: int, began_s: float) -> None:
        """Whether the stamp fits to the newest one; corrected where it does not."""
        step_ms, expected_ms = stamp_ms - self._stamp_ms, frames * self._period_ms
        passed_ms = 1000.0 * (began_s - self._came_s)
        self._stamp_ms, self._came_s = stamp_ms, began_s
        allowed_ms = UNEVEN_MS + UNEVEN_SHARE * expected_ms
        if self._is_first or abs(step_ms - expected_ms) <= allowed_ms:
            return
        if step_ms > 0 and abs(step_ms - passed_ms) <= allowed_ms:  # it exposes longer, or shorter
            self._period_ms = step_ms / frames
            return
        self.settings += 1
        self._shift_ms += round(expected_ms) - step_ms
