"""What can be set about a fake URG-04LX at any time: its faults, and what it is like."""


class Faults:
    """Plain attributes of the device, which its parts look at when they act."""

    def __init__(self) -> None:
        # what it says and hears
        self.mute = False  # its bytes are lost, it hears
        self.deaf = False  # it measures and streams on, and hears nothing
        self.late_s = 0.0  # that all its bytes take longer
        self.slow_answer_s = 0.0  # that its answers take longer
        self.answers_lost = 0  # so many next answers are swallowed, the requests obeyed
        self.damaged_rate = 0.0  # of messages: one of their bytes is altered
        self.lost_line_rate = 0.0  # of messages: one of their lines is missing
        self.cut_next = False  # the next message stops in its middle; then off again
        self.refuse: dict[str, str] = {}  # command -> status that it gets in SCIP 2.0, as 0A
        self.updates_firmware = False  # all but VV, II, RS and SCIP2.0 gets 0I
        self.splits_serial = False  # a stray line break in VV's serial number, and a wrong sum
        self.hangs_at_extensions = False  # commands of other models make it deaf until a restart
        self.baud: int | None = None  # of its serial line, until SS, RS or a restart; None: no line
        # how it starts
        self.start_silent_s = 0.0  # after power-up
        # what it tells of itself
        self.trouble = 0  # 50..97: hardware trouble; 21..49: it checks an error, and goes on after
        self.laser_fails = False  # BM gets 01
        # what it measures
        self.frozen = False  # the same values again and again, with new times
        self.drift_ppm = 0.0  # of its clock
        self.timer_ms = 0  # what its timer shows at power-up and after RS
        self.noise = 1.0  # times what its sheet says; 0: none
        self.offset_m = 0.0  # by which all it measures is too far
        self.mixed = True  # beams that meet an edge tell something of their own
        self.remission = 0.9  # of all that it meets: white; black is 0.05
        self.remission_at: dict[int, float] = {}  # step -> remission of what is met there
        self.values_at: dict[int, int] = {}  # step -> what it tells, whatever is there
