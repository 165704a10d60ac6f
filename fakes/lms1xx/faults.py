"""What can be set about a fake LMS111 at any time: its faults, and what it is like."""


class Faults:
    """Plain attributes of the device, which its parts look at when they act."""

    def __init__(self) -> None:
        # what it says and hears
        self.mute = False  # its bytes are lost, it hears
        self.deaf = False  # it measures on, and hears nothing
        self.late_s = 0.0  # that all its bytes take longer
        self.slow_answer_s = 0.0  # that its answers take longer
        self.answers_lost = 0  # so many next answers are swallowed, the commands obeyed
        self.cut_next = False  # the next telegram stops in its middle; then off again
        self.wrong_checksum_rate = 0.0  # of all telegrams
        self.refuse: dict[str, int] = {}  # name, or kind and name, of a command -> sFA code
        self.max_clients = 4  # connections at once
        # how it starts
        self.start_silent_s = 0.0  # after power-up
        self.refuse_connections_s = 0.0  # after power-up
        self.dialect_change_s = 0.0  # from EIHstCola until new connections speak the new one
        self.spin_up_s = 0.3  # from Run to the first sweep
        self.settling_scans = 7  # that carry device status 01 00
        self.measures_at_power_up = False  # without being told to
        self.power_ons = 0x3F  # so far
        # what it tells of itself
        self.temperature_bad = False  # out of its range
        self.in_error = False  # as SCdevicestate tells
        self.contamination = 0  # of the window, as LCMstate tells: 1 warning, 2 error, 3 fatal
        self.device_status = 0  # of settled scans, second byte; no value but 0 is documented
        self.untrue_output_step = True  # LMPoutputRange says 0.5 deg, whatever it scans at
        self.name, self.comment = "not defined", ""  # that a telegram may carry
        self.encoder = (0, 0)  # position, speed
        # what it measures
        self.frozen = False  # the same telegram again and again
        self.drop_rate = 0.0  # of scans, which are then missing in the scan counter
        self.drift_ppm = 0.0  # of its clock
        self.clock_offset_us = 0  # what its clock shows at power-up
        self.first_scan = 0  # number of the first scan after Run, until it powers up again
        self.noise_m = 0.012  # 1 sigma; the sheet's statistical error
        self.offset_m = 0.0  # by which all it measures is too far; the sheet: up to 0.03
        self.max_range_m = 20.0
        self.dazzled_rate = 0.0  # of beams
        self.implausible_rate = 0.0  # of beams
        self.filtered_rate = 0.0  # of beams
        self.mean_scans = 0  # of the mean filter; 0: off
        self.two_in_a_row = False  # the n-to-1 filter: an echo counts if the scan before had it
