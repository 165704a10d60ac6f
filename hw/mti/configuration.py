"""How an MTi is set up, as it tells: all at once, its outputs, its baud rates by code.

Source: MTi sheet, section 3.
"""

import struct

from core.records import record

CONFIGURATION_BYTES = 118
BAUDS = (  # by code; from 2000000 on: newer devices only
    *(460800, 230400, 115200, 76800, 57600, 38400, 28800, 19200, 14400, 9600),
    *(921600, 4800, 2000000, 4000000, 3686400),
)
BAUD_CODES = {baud: code for code, baud in enumerate(BAUDS)}
BAUD_CODES[921600] = 0x80  # only firmware of 2.4.6 and later knows it as 0A, too


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
