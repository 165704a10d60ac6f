"""A Kinect's frames to depth images in millimetres along the optical axis.

    m = ((raw - 4 shift) / 4 - 0.375) pixel          z = m reference / (emitter - m) + reference

z is cut to whole millimetres. Its step grows with its square: 3 mm at 1 m, 12 mm at 2 m.
Source: kinect sheet, section 2.
"""

import math

import numpy as np

from core.records import U16, DepthImage
from hw.depth_images.options import KINECT_PX, KinectOptions
from hw.depth_images.parts import Part
from hw.depth_images.rays import camera_of
from hw.device import BadFrame

RAW_KIND, MM_KIND = "depth/raw-11", "depth/mm"
RAWS, MOST_MM = 2048, 10_000  # the greatest raw value is "no value"
FRAME_BYTES = 2 * KINECT_PX[0] * KINECT_PX[1]


def mm_of_raws(options: KinectOptions) -> U16:
    """(RAWS,) millimetres of each raw value; 0: none."""
    told = np.zeros(RAWS, np.uint16)
    for raw in range(RAWS - 1):
        m = ((raw - 4.0 * options.shift) / 4.0 - 0.375) * options.pixel_m
        away = options.emitter_m - m
        if away > 0.0:
            mm = math.floor(1000.0 * (m * options.reference_m / away + options.reference_m))
            told[raw] = mm if 0 < mm <= MOST_MM else 0
    return told


class KinectFrames:
    """Makes images of the parts that a Kinect's port gives."""

    def __init__(self, options: KinectOptions) -> None:
        self._camera, self._mm = camera_of(options.lens), mm_of_raws(options)

    def take(self, part: Part) -> DepthImage | BadFrame:
        """The image, its time that of the part; or why it is of no use."""
        if len(part.data) != FRAME_BYTES:
            return BadFrame(f"a frame of {len(part.data)} bytes, a Kinect's has {FRAME_BYTES}", b"")
        given = np.frombuffer(part.data, "<u2")
        if part.kind == RAW_KIND:
            if given.max() >= RAWS:
                return BadFrame(f"a raw value of {given.max()}, allowed are 0 .. {RAWS - 1}", b"")
            numbers = self._mm[given]
        elif part.kind == MM_KIND:
            if given.max() > MOST_MM:
                return BadFrame(f"a depth of {given.max()} mm, allowed are 0 .. {MOST_MM}", b"")
            numbers = given.astype(np.uint16)
        else:
            return BadFrame(f"frames of kind {part.kind[:40]!r} are no Kinect's", b"")
        numbers = numbers.reshape(KINECT_PX[::-1])
        numbers.setflags(write=False)
        assert part.stamp_s is not None, "the device looks at it first"
        return DepthImage(part.stamp_s, numbers, self._camera, part.number, part.arrived_s)
