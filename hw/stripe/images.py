"""JPEG and PNG to images, by OpenCV, which only who has such a scanner needs.

OpenCV is an extra, `camera`, and is loaded when the first decoder is made.
"""

from typing import Any

import numpy as np

from core.records import U8
from hw.device import BadFrame
from hw.stripe.jpeg import fault_of_image, warm, with_tables
from hw.stripe.mjpeg import maybe_size

MISSING = "images need OpenCV, which is not installed: pip install 'mapod[camera]'"


def maybe_opencv() -> Any:
    """The library, or None where it is not installed."""
    try:
        import cv2
    except ImportError:
        return None
    cv2.setNumThreads(1)  # it would start some of its own
    return cv2


class Decoder:
    """Makes images of one size of their files' bytes.

    Args:
        image_px: width and height that are expected.
    """

    def __init__(self, image_px: tuple[int, int]) -> None:
        self._image_px, self._opencv = image_px, maybe_opencv()
        warm()

    @property
    def is_missing(self) -> bool:
        """Whether OpenCV is: then nothing is decoded."""
        return self._opencv is None

    def image(self, data: bytes) -> U8 | BadFrame:
        """The image (h, w, 3), blue green red.

        A JPEG of another size, or one that is not whole, is not decoded at all.
        """
        is_jpeg = data.startswith(b"\xff\xd8")
        size = maybe_size(data) if is_jpeg else self._image_px
        if size is None:
            return BadFrame("a JPEG that tells no size", data)
        if size != self._image_px:
            return BadFrame(self._wrong(size), data)
        data = with_tables(data) if is_jpeg else data
        if is_jpeg and (why := fault_of_image(data)):
            return BadFrame(why, data)
        cv2 = self._opencv
        try:
            decoded = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
        except cv2.error:
            decoded = None
        if decoded is None:
            return BadFrame("an image that can't be decoded", data)
        h, w = decoded.shape[:2]
        if (w, h) != self._image_px:
            return BadFrame(self._wrong((w, h)), data)
        return np.asarray(decoded, np.uint8)

    def _wrong(self, size: tuple[int, int]) -> str:
        w, h = self._image_px
        return f"the camera's images are {size[0]} x {size[1]} px, scanner.image_px has {w} x {h}"
