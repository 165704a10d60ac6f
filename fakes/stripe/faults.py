"""What can be set about a fake camera with a laser at any time: its faults, and what it is like."""

from typing import Literal

Ambient = Literal["dark", "lamp", "window", "sun"]
Colour = Literal["red", "green", "blue"]
Along = Literal["columns", "rows"]


class Faults:
    """Plain attributes of the device, which its parts look at when they act."""

    def __init__(self) -> None:
        # what it says and hears
        self.mute = False  # its bytes are lost, it hears
        self.late_s = 0.0  # that all its bytes take longer
        self.gone = False  # the camera is unplugged: streams end, and who asks gets 503
        self.refuse = 0  # HTTP status that all requests get; 0: none
        self.path = "/stream"  # at which it serves; any other gets 404
        self.tells_length = True  # of each image, by Content-Length
        self.tells_time = True  # of each image's exposure, by X-Timestamp
        # its images as files
        self.truncated_rate = 0.0  # of images: the second part of one is missing, its end too
        self.torn_rate = 0.0  # of images: bytes in the middle are missing, its end is there
        self.frozen = False  # the same image again and again, with new times
        self.repeated = 0  # images that it draws, to show them over and over; 0: it draws each
        self.image_px = (640, 480)  # width and height that it sends, whatever its sensor has
        self.quality = 90  # of the JPEG, 1..95
        # its pace
        self.rate_hz = 30.0  # images a second
        self.latency_s = 0.05  # from the exposure to the first byte
        self.jitter_s = 0.003  # by which that is longer in the mean
        # the laser
        self.laser = 1.0  # its power; 0: off
        self.colour: Colour = "red"  # of the laser
        self.line_px = 3.3  # width of its line at half its height
        self.speckle = 0.25  # 1 sigma of a pixel of the line, as a share of its light
        self.baseline_m = 0.12  # above the camera (rows: left of it); negative: below, right
        self.laser_deg = 11.0  # by which its plane dips to the camera's axis
        self.fan_deg = 40.0  # its plane's light, to either side
        self.along: Along = "columns"  # a place of the line in each of these
        # the camera
        self.exposure = 1.0  # times what suits a room with a lamp
        self.auto_exposure = False  # exposes so that the whole image is of a middle grey
        self.noise = 1.0  # times what such a camera has; 0: none
        self.focal_px = (600.0, 600.0)  # of its sensor, 640 x 480 pixels
        self.centre_px = (319.5, 239.5)
        self.distortion = (0.0, 0.0, 0.0, 0.0, 0.0)  # k1, k2, p1, p2, k3
        self.mount_m = (0.20, 0.0, 0.40)  # its centre on the body
        self.tilt_deg = 40.0  # looking down
        # what it looks at
        self.ambient: Ambient = "lamp"  # light beside the laser's
        self.reflectivity = 0.5  # of all that it sees, but for what is black
        self.texture = 0.3  # by which share that differs from place to place
