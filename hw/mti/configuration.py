"""How an MTi is set up, as it tells: all at once, its outputs, its baud rates by code.

Source: MTi sheet, section 3.
"""

import struct

from core.records import record

CONFIGURATION_BYTES = 118
BAUD_CODES = {
    460800: 0x00,
    230400: 0x01,
    115200: 0x02,
    76800: 0x03,
    57600: 0x04,
    38400: 0x05,
    28800: 0x06,
    19200: 0x07,
    14400: 0x08,
    9600: 0x09,
    921600: 0x80,  # firmware of 2.4.6 and later also knows it as 0A
    4800: 0x0B,
    2000000: 0x0C,  # this and what follows: newer devices only
    4000000: 0x0D,
    3686400: 0x0E,
}


@record()
class MtConfiguration:
    """What is used of the 118 bytes of Configuration."""

    period: int  # 1/115200 s
    skip: int
    output_mode: int
    output_settings: int
    firmware: tuple[int, int, int]

    @property
    def rate_hz(self) -> float:
        """Messages a second; 0.0 where only requests bring one, or nothing is said."""
        if not self.period or self.skip == 0xFFFF:
            return 0.0
        return 115200 / (self.period * (self.skip + 1))


def maybe_configuration(data: bytes) -> MtConfiguration | None:
    """The data of Configuration; None where it has not 118 bytes."""
    if len(data) != CONFIGURATION_BYTES:
        return None
    period, skip = struct.unpack_from(">HH", data, 4)
    mode, settings = struct.unpack_from(">HI", data, 104)
    return MtConfiguration(period, skip, mode, settings, (data[112], data[113], data[114]))
