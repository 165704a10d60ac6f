"""When an image was exposed, by the host's clock, and whether it comes too late to be used.

Without a stamp of the camera the arrival is all there is, and an image that was held up for long
can't be told from a fresh one. With stamps, the least delayed images tell how the camera's clock
stands to ours (hw/clock.py), and any other's delay. A new connection changes nothing of that: so
a camera that has images from before in store is not believed to be fresh, be they newer or older
than the last one that came.

A clock that began anew, or was set back, makes all its images late, and by the same: if as many
come as usual for two seconds, they are taken for fresh ones of another clock. Images out of a store
are late by more or less from one to the next, or fewer than usual: so long they are refused.
Stamps from well before the first one tell of another clock at once.
"""

from collections import deque

from hw.clock import DeviceClock
from hw.device import BadFrame
from hw.stripe.mjpeg import Jpeg

LATE_S = 0.25  # beyond the usual: a robot is elsewhere by then
TICK_S, WRAP_TICKS = 1e-6, 1 << 62  # stamps are microseconds of a calendar clock, without an end
STORED_US = 60_000_000  # longer no camera keeps images
AGAIN_S, AGAIN_PERIODS = 2.25, 9  # the longer: in that time, of another clock's images as many
AGAIN_SHARE, SAME_S = 0.8, 0.05  # as this share of the usual come, none later by more than that
USUAL_SHARE, LONGEST_PERIOD_S = 0.1, 3.0  # weight of the newest period; longer is an interruption
JITTER_S = 0.01  # of an image's way to us, where nothing measures it


class ImageTimes:
    """The times of one camera's images."""

    def __init__(self, latency_s: float) -> None:
        self._latency_s = latency_s
        self._clock = DeviceClock(TICK_S, WRAP_TICKS)
        self._first_us = self._newest_us = 0  # of this clock of the camera's
        self._period_s = 0.0  # usual, of images that are not late; 0: not known yet
        self._late: deque[tuple[float, float]] = (
            deque()
        )  # in a row: when one began to come, by what
        self._set_back = 0

    @property
    def uncertainty_s(self) -> float:
        return self._clock.uncertainty_s if self._clock.samples else JITTER_S

    @property
    def restarts(self) -> int:
        """How often the camera's clock was found to have begun anew, or to have been set back."""
        return self._set_back + self._clock.restarts

    def exposed_s(self, jpeg: Jpeg) -> float | BadFrame:
        """The instant of an image; or why that image is of no use."""
        if jpeg.stamp_us is None:
            return jpeg.began_s - self._latency_s
        if not self._clock.samples or jpeg.stamp_us < self._first_us - STORED_US:
            self._first_us = self._newest_us = jpeg.stamp_us
        else:
            late_s = jpeg.began_s - self._clock.host_s_near(jpeg.stamp_us)
            if late_s > LATE_S:
                if not self._is_another_clock(
                    jpeg.began_s, late_s
                ):  # nor may it tell ours anything
                    return BadFrame(f"an image that comes {late_s:.2g} s late", jpeg.data)
                self._set_back += 1 + self._clock.restarts
                self._clock = DeviceClock(TICK_S, WRAP_TICKS)
                self._first_us = self._newest_us = jpeg.stamp_us
        self._late.clear()
        self._learn_period(jpeg.stamp_us)
        return self._clock.host_s(jpeg.stamp_us, jpeg.began_s) - self._latency_s

    def _learn_period(self, stamp_us: int) -> None:
        passed_s, self._newest_us = (stamp_us - self._newest_us) * TICK_S, stamp_us
        if 0.0 < passed_s < LONGEST_PERIOD_S:
            weight = USUAL_SHARE if self._period_s else 1.0
            self._period_s += weight * (passed_s - self._period_s)

    def _is_another_clock(self, began_s: float, late_s: float) -> bool:
        """Whether late images have come for so long, and so evenly, that none is out of a store."""
        late = self._late
        late.append((began_s, late_s))
        period_s = self._period_s or (began_s - late[0][0]) / max(1, len(late) - 1)
        again_s = max(AGAIN_S, AGAIN_PERIODS * period_s)
        while late[0][0] < began_s - again_s:
            late.popleft()
        least_s = min(by_s for _, by_s in late)
        same = sum(by_s <= least_s + SAME_S for _, by_s in late)
        return same * period_s >= AGAIN_SHARE * again_s
