"""When an image was exposed, by the host's clock, and whether it comes too late to be used.

Without a stamp of the camera the arrival is all there is, and an image that was held up for long
can't be told from a fresh one. With stamps, the least delayed images tell how the camera's clock
stands to ours (hw/clock.py), and any other's delay. A new connection changes nothing of that: so
a camera that has images from before in store is not believed to be fresh, be they newer or older
than the last one that came. Only images that seem later than any store is long tell of a clock that
began anew or was set back: two in a row, for a stamp may be damaged. One that was set back by less
seems late until mapod starts anew: a store that never empties looks alike.
"""

from hw.clock import DeviceClock
from hw.device import BadFrame
from hw.stripe.mjpeg import Jpeg

LATE_S = 0.25  # beyond the usual: a robot is elsewhere by then
TICK_S, WRAP_TICKS = 1e-6, 1 << 62  # stamps are microseconds of a calendar clock, without an end
STORED_S = 60.0  # longer no camera keeps images
JITTER_S = 0.01  # of an image's way to us, where nothing measures it


class ImageTimes:
    """The times of one camera's images."""

    def __init__(self, latency_s: float) -> None:
        self._latency_s = latency_s
        self._clock = DeviceClock(TICK_S, WRAP_TICKS)
        self._clocks = self._too_late = 0  # of the camera's, but the first; images in a row

    @property
    def uncertainty_s(self) -> float:
        return self._clock.uncertainty_s if self._clock.samples else JITTER_S

    @property
    def restarts(self) -> int:
        """How often the camera's clock was found to have begun anew, or to have been set back."""
        return self._clocks + self._clock.restarts

    def exposed_s(self, jpeg: Jpeg) -> float | BadFrame:
        """The instant of an image; or why that image is of no use."""
        if jpeg.stamp_us is None:
            return jpeg.began_s - self._latency_s
        if self._clock.samples:
            late_s = jpeg.began_s - self._clock.host_s_near(jpeg.stamp_us)
            self._too_late = self._too_late + 1 if late_s > STORED_S else 0
            if self._too_late > 1:
                self._clocks += 1 + self._clock.restarts
                self._clock, self._too_late = DeviceClock(TICK_S, WRAP_TICKS), 0
            elif late_s > LATE_S:  # nor may it tell the clock anything
                return BadFrame(f"an image that comes {late_s:.2g} s late", jpeg.data)
        return self._clock.host_s(jpeg.stamp_us, jpeg.began_s) - self._latency_s
