"""Numbers on an MTi's wire: float32, fixed 12.20, fixed 16.32, float64.

Source: MTi sheet, section 3.
"""

import math
import struct
from collections.abc import Sequence

FLOAT32, FIXED_12_20, FIXED_16_32, FLOAT64 = 0, 1, 2, 3
NUMBER_SIZES = (4, 4, 6, 8)
PREAMBLE_TWICE = 0xFAFF


def number(value: float, number_format: int) -> bytes:
    """One number of a message; what a fixed format cannot hold becomes its nearest, or lowest."""
    if number_format == FLOAT32:
        return struct.pack(">f", value)
    if number_format == FLOAT64:
        return struct.pack(">d", value)
    fraction, size = (20, 4) if number_format == FIXED_12_20 else (32, 6)
    most = 2 ** (8 * size - 1)
    scaled = -most if not math.isfinite(value) else round(value * 2**fraction)
    return _fixed(max(-most, min(most - 1, scaled)), number_format)


def numbers(values: Sequence[float], number_format: int, preamble: bool = False) -> bytes:
    """Many of them; with `preamble` the smallest holds `FA FF`, as near to its value as may be."""
    if number_format == FLOAT32 and not preamble:
        return struct.pack(f">{len(values)}f", *values)
    parts = [number(value, number_format) for value in values]
    if preamble and parts:
        k = min(range(len(parts)), key=lambda part: abs(values[part]))
        parts[k] = _with_preamble(values[k], number_format)
    return b"".join(parts)


def _with_preamble(value: float, number_format: int) -> bytes:
    """Nearly the value, its least bytes FA FF."""
    if number_format in (FLOAT32, FLOAT64):
        return number(value, number_format)[:-2] + PREAMBLE_TWICE.to_bytes(2, "big")
    fraction = 20 if number_format == FIXED_12_20 else 32
    scaled = round(value * 2**fraction) if math.isfinite(value) else 0
    upper = round((scaled - PREAMBLE_TWICE) / 2**16)
    return _fixed(upper * 2**16 + PREAMBLE_TWICE, number_format)


def _fixed(scaled: int, number_format: int) -> bytes:
    size = NUMBER_SIZES[number_format]
    fixed = scaled.to_bytes(size, "big", signed=True)
    return fixed if number_format == FIXED_12_20 else fixed[2:] + fixed[:2]
