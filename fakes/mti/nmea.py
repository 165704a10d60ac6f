"""The sentences that a newer MTi can speak between its messages; which they are is [U].

Source: MTi sheet, section 3, message 8E: a word of bits, 0 is off.
"""

import math

from fakes.mti.rotation import EULER, F64, orientation

HEADING, TRUE_HEADING, ATTITUDE = 0x0001, 0x0100, 0x0010  # HCHDM, HEHDT, PRDID
PERIOD_S = 0.1


def sentences(R_earth_sensor: F64, kinds: int) -> bytes:
    """What is switched on, from the orientation (3, 3); earth is north, west, up."""
    roll_deg, pitch_deg, yaw_deg = orientation(R_earth_sensor, EULER)
    if math.isnan(yaw_deg):
        return b""
    heading_deg = -yaw_deg % 360.0
    spoken = []
    if kinds & HEADING:
        spoken.append(f"HCHDM,{heading_deg:.1f},M")
    if kinds & TRUE_HEADING:
        spoken.append(f"HEHDT,{heading_deg:.1f},T")
    if kinds & ATTITUDE:
        spoken.append(f"PRDID,{-pitch_deg:+.2f},{roll_deg:+.2f},{heading_deg:.2f}")
    return b"".join(_sentence(text.encode("ascii")) for text in spoken)


def _sentence(text: bytes) -> bytes:
    check = 0
    for byte in text:
        check ^= byte
    return b"$%s*%02X\r\n" % (text, check)
