"""What can be set about a fake Kinect at any time: its faults, and what it is like."""

from typing import Literal

Form = Literal["raw", "mm", "png"]


class Faults:
    """Plain attributes of the device, which its parts look at when they act."""

    def __init__(self) -> None:
        self.mute = False  # its bytes are lost
        self.frozen = False  # the same picture again and again
        self.all_invalid = False  # no pixel is a measurement
        self.small = False  # half as many rows and columns
        self.untimed = False  # frames without a time
        self.unnumbered = False  # and without a number
        self.damaged_rate = 0.0  # of frames: some bytes of one are other ones
        self.cut_rate = 0.0  # of frames: the second half of one is missing
        self.wild = False  # values that no such camera sends
        self.wrong_matrix = False  # its camera.toml tells a focal length ten times too long
        self.no_camera = False  # it has none
        self.stamp_late_s = 0.0  # by which stamps are older than they should be
        self.period_s = 1.0 / 30.0
        self.latency_s = 0.04  # from the middle of exposure to its stamp
        self.noise = 1.0  # times what such a camera has; 0: none
        self.mount_m = (0.20, 0.0, 0.60)  # its lens on the body
        self.tilt_deg = 25.0  # looking down
