"""When an image was exposed, by the host's clock, and whether it comes too late to be used.

Without a stamp of the camera the arrival is all there is, and an image that was held up for long
can't be told from a fresh one. With stamps, the least delayed images tell how the camera's clock
stands to ours (hw/clock.py), and any other's delay. A new connection changes nothing of that: so
a camera that has images from before in store is not believed to be fresh, be they newer or older
than the last one that came. Only stamps from well before the first one tell of a clock that began
anew.
"""

from hw.clock import DeviceClock
from hw.device import BadFrame
from hw.stripe.mjpeg import Jpeg

LATE_S = 0.25  # beyond the usual: a robot is elsewhere by then
TICK_S, WRAP_TICKS = 1e-6, 1 << 62  # stamps are microseconds of a calendar clock, without an end
STORED_US = 60_000_000  # longer no camera keeps images
JITTER_S = 0.01  # of an image's way to us, where nothing measures it


class ImageTimes:
    """The times of one camera's images."""

    def __init__(self, latency_s: float) -> None:
        self._latency_s = latency_s
        self._clock = DeviceClock(TICK_S, WRAP_TICKS)
        self._first_us = 0  # of this clock of the camera's

    @property
    def uncertainty_s(self) -> float:
        return self._clock.uncertainty_s if self._clock.samples else JITTER_S

    def exposed_s(self, jpeg: Jpeg) -> float | BadFrame:
        """The instant of an image; or why that image is of no use."""
        if jpeg.stamp_us is None:
            return jpeg.began_s - self._latency_s
        clock = self._clock
        if not clock.samples or jpeg.stamp_us < self._first_us - STORED_US:
            self._first_us = jpeg.stamp_us
        else:
            late_s = jpeg.began_s - clock.host_s_near(jpeg.stamp_us)
            if late_s > LATE_S:  # nor may it tell the clock anything
                return BadFrame(f"an image that comes {late_s:.2g} s late", jpeg.data)
        return clock.host_s(jpeg.stamp_us, jpeg.began_s) - self._latency_s
