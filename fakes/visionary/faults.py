"""What can be set about a fake Visionary at any time: its faults, and what it is like."""

from fakes.visionary.models import Model


class Faults:
    """Plain attributes of the device, which its parts look at when they act."""

    def __init__(self, model: Model) -> None:
        self._model = model
        # what it says and hears
        self.mute = False  # the bytes of both ports are lost, it hears
        self.mute_control = False  # those of its control alone
        self.mute_stream = False  # those of its stream alone
        self.gone = False  # its power is off: connections end, and nobody gets in
        self.refuse = 0  # error that all commands get; 0: none
        self.unknown = ""  # name that it does not know, as variants lack some
        self.sessions = 4  # CoLa-2 sessions at a time, at most
        self.has_old_login = False  # CoLa-2: the challenge without salt
        self.password = "CLIENT"  # of level 3, as in the maker's samples
        # its frames
        self.frozen = False  # the same picture again and again, with new numbers and times
        self.same_number = False  # frames all have the same number
        self.damaged_rate = 0.0  # of frames: some bytes of one are other ones
        self.cut_rate = 0.0  # of frames: the second part of one is missing
        self.wrong_length = False  # the copy of the length is another
        self.wrong_checksum = False  # of the binary segment
        self.segments = 3  # that it tells of
        self.wrong_matrix = False  # it tells a focal length ten times too long
        self.turned_matrix = False  # it tells a mounting of its own that turns
        self.all_invalid = False  # no pixel is a measurement
        self.small = False  # half as many rows and columns, from now on
        self.changes_silently = False  # the description may change, its counter does not
        self.status = 0  # device status in its frames; 0: ok
        self.warning = 3  # TmpLvl and OpVoltageStatus: 3 good, 2 warning, 1 error
        self.standby = False  # it streams, without light
        # its pace
        self.latency_s = 0.03  # from the middle of exposure to the first byte
        self.jitter_s = 0.002  # by which that is longer in the mean
        self.drift_ppm = 0.0  # of its clock
        # its light
        self.exposure_s = 0.0  # time that a picture takes; what moves in it is torn
        self.noise = 1.0  # times what such a camera has; 0: none
        self.flying = 0.5  # share of the pixels at an edge that are between near and far
        self.multipath = 1.0  # light from near walls, times what is true of dull ones
        self.ambiguity_m = 15.0  # a range beyond it seems to be so much less
        self.least_amplitude = 0.004  # of light that returns: less is no measurement
        self.reflectivity = 0.5  # of all that it sees, but for what is black or shiny
        self.shiny_share = 0.0  # of the things: they return light as mirrors do
        self.every_px = 4  # pixels between rays where a plane fills what is between; 1: all
        # where it is
        self.mount_m = (0.20, 0.0, 0.40)  # its front on the body
        self.tilt_deg = 25.0  # looking down
