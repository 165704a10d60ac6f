"""The exception codes with which a Modbus request is refused.

Source: Modbus application protocol 1.1b3, section 7.
"""

from enum import IntEnum


class Refusal(IntEnum):
    """Why a request is not served; NONE: it is."""

    NONE = 0
    FUNCTION = 1  # unknown, or not allowed to this client
    ADDRESS = 2  # no such register, or it can't be written
    VALUE = 3  # a count or a value that can't be, or only part of what belongs together
    BUSY = 6  # what this unit had frozen is too old: freeze anew
    NO_UNIT = 0x0B  # nobody with this unit id lives here
