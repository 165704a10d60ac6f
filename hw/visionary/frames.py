"""BLOBs to depth images: what is kept from frame to frame, and which frames are of no use.

A frame is refused, with the reason in words, if its description or its size can't be right, if it
shows the same picture or has the same number as the one before, or if it comes late. Of a camera
whose checksums were right once, one that is not is damage.
"""

from core.records import U16, DepthCamera, DepthImage
from hw.device import BadFrame
from hw.visionary.blob import Blob
from hw.visionary.depth import FrameHead, head_of, no_numbers, numbers_of
from hw.visionary.description import Description, description_of
from hw.visionary.rays import camera_of
from hw.visionary.times import FrameTimes

FIRST_FRAMES = 1  # after a start: not within the camera's precision
SAME_NUMBER = "the same frame again: the camera's picture stands still"
SAME_PICTURE = "the same picture in another frame: the camera's picture stands still"
OLDER = "a frame with a lower number than the one before"


class Passed:
    """A frame that is as it should be, and no measurement: of the first ones after a start."""


class FrameMaker:
    """Makes images of the frames of one camera."""

    def __init__(self, times: FrameTimes, min_confidence: int) -> None:
        self.missed = self.wrong_checksums = 0
        self.valid_share = 0.0  # of the newest frame's pixels
        self.status = self.quality = 0  # that the camera tells in it
        self._times, self._min_confidence = times, min_confidence
        self._xml, self._change = b"", -1
        self._told: Description | str = "no description yet"
        self._camera: DepthCamera | str | None = None  # of that description
        self._before: U16 = no_numbers(0, 0)
        self._number = self._last = -1  # newest; and that before the newest start
        self._to_drop, self._has_right_checksums = FIRST_FRAMES, False

    def begin(self) -> None:
        """The camera was told to start: its first frames are not precise, any number may follow."""
        self._to_drop, self._last = FIRST_FRAMES, max(self._number, self._last)
        self._number = -1
        self._xml, self._change = b"", -1  # read it again: the newest may have been damaged

    def take(self, blob: Blob) -> DepthImage | Passed | BadFrame:
        """The image of a frame; or why there is none."""
        told = self._described(blob)
        if isinstance(told, str):
            return BadFrame(told, b"")
        head = head_of(blob.binary, told)
        if isinstance(head, BadFrame):
            return head
        if not head.is_crc_right:
            self.wrong_checksums += 1
            if self._has_right_checksums:
                return BadFrame("a frame with a wrong checksum", b"")
        self._has_right_checksums |= head.is_crc_right
        if self._camera is None:  # not sooner: of a size that is not there it would take long
            self._camera = camera_of(told)
        if isinstance(self._camera, str):
            return BadFrame(self._camera, b"")
        return self._image(blob, head, told, self._camera)

    def _image(
        self, blob: Blob, head: FrameHead, told: Description, camera: DepthCamera
    ) -> DepthImage | Passed | BadFrame:
        frames = self._counted(head.number)
        if frames < 1:
            self._times.lose_count()
            return BadFrame(SAME_NUMBER if frames == 0 else OLDER, b"")
        if self._before.shape != (told.height, told.width):
            self._before = no_numbers(told.height, told.width)
        numbers, count, changed = numbers_of(
            blob.binary, head, told, self._min_confidence, self._before
        )
        self._before, self.valid_share = numbers, count / numbers.size
        self.status, self.quality = head.status, head.quality
        exposed_s = self._times.exposed_s(head.stamp_ms, frames, blob.began_s)
        if isinstance(exposed_s, BadFrame):
            return exposed_s
        if count and not changed:
            return BadFrame(SAME_PICTURE, b"")
        if self._to_drop:
            self._to_drop -= 1
            return Passed()
        return DepthImage(exposed_s, numbers, camera, self._number, blob.arrived_s)

    def _counted(self, number: int) -> int:
        """Frames since the one before; below 1 for the same or an older one."""
        if number < 0:  # it is not told
            self._number += 1
            return 1
        if self._number < 0:  # the first one after a start
            if number < self._last:
                self._times.restart()
            self._last, self._number = -1, number
            return 1
        step = number - self._number
        if step >= 1:
            self.missed += step - 1
            self._number = number
        return step

    def _described(self, blob: Blob) -> Description | str:
        """What holds for this frame; parsed where its XML has changed alone."""
        if blob.xml == self._xml and blob.change == self._change:
            return self._told
        xml = bytes(blob.xml)
        told = description_of(xml)
        if blob.change == self._change and told != self._told and not isinstance(self._told, str):
            return "a description that changes, and its counter does not"
        self._xml, self._change = xml, blob.change
        if told != self._told:  # else the camera stays the same object
            self._told, self._camera = told, None
        return self._told
