"""What can be set about a fake MTi at any time: what goes wrong, and how well it measures."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from fakes.wires.timing import F64

Distortion = Callable[[float], F64]


@dataclass(eq=False)
class Faults:
    """All plain attributes of a FakeMti, whichever part of it they concern."""

    mute: bool = False  # its bytes are lost, it hears
    deaf: bool = False  # hears nothing, and speaks on
    burst_s: float = 0.0  # bytes come together, so far apart: 0.016 is a USB adapter as shipped
    late_s: float = 0.0  # all bytes come so much later
    jitter_s: float = 0.0  # mean of an exponential delay of each message; their order stays
    wrong_checksum_rate: float = 0.0  # of all messages
    lost_byte_rate: float = 0.0  # of all bytes
    half_frame: bool = False  # the next message is cut in the middle; then off again
    baud: int = 115200  # until the next power-up, which sets what the memory says

    drift_ppm: float = 0.0  # of its clock
    deaf_acks: int = 0  # so many answers are swallowed, the requests obeyed
    late_data: int = 0  # so many data messages still come before a GoToConfig's answer
    error_next: int | None = None  # code of an Error that it sends unasked, once
    frozen: bool = False  # the same data again and again
    lost_rate: float = 0.0  # of data messages, which are then missing in the counter
    counter: int = 0  # of the next message
    gap: int = 0  # samples that the next message's counter jumps over; then 0 again
    length_off: int = 0  # data messages carry so many bytes more, or fewer, than they should
    fine_next: int | None = None  # SampleTimeFine of the next message; it runs on from it
    fa_ff: bool = False  # the bytes FA FF occur in the data of each message

    nan: bool = False  # all numbers
    yaw_jump_rad: float = 0.0
    tilt_off_rad: F64 = field(default_factory=lambda: np.zeros(2))  # roll, pitch: told too much
    sheet_errors: bool = False  # True: as wrong as the sheet says it may be
    angle_noise_rad: float = math.radians(0.05)
    rate_noise_radps: float = math.radians(0.3)
    accel_noise_mps2: float = 0.02
    magnetic_noise: float = 0.002
    rate_bias_radps: F64 = field(default_factory=lambda: np.zeros(3))
    accel_bias_mps2: F64 = field(default_factory=lambda: np.zeros(3))
    earth_field: F64 = field(default_factory=lambda: np.array([0.4, 0.0, -0.9]))  # north, west, up
    distortion_at: Distortion | None = None  # what (3, 3) steel makes of earth_field
    pull_s: float = 3.0  # time constant with which the yaw follows the magnetic field
    temperature_deg: float = 35.0
    self_test: int = 0x01FF  # bits of message 25; 01FF: all passed
