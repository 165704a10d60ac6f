"""What is heard of a serial line at the wrong speed: the bits as sent, sampled as the hearer does.

Eight data bits, one start and one stop bit, as a pty has them. Source: how a UART samples.
"""

import fcntl
import struct
from itertools import pairwise

TCGETS2 = 0x802C542A  # tells the speed as a plain number, whatever it is (Linux, x86 and ARM)
TERMIOS2_SIZE, OUTPUT_SPEED = 44, struct.Struct("I")
BITS = 10  # of a character on the line


def maybe_speed(line: int) -> int | None:
    """Bits a second that a terminal is set to; None: it does not say."""
    try:
        settings = fcntl.ioctl(line, TCGETS2, bytes(TERMIOS2_SIZE))
    except OSError:
        return None
    return int(OUTPUT_SPEED.unpack_from(settings, TERMIOS2_SIZE - OUTPUT_SPEED.size)[0]) or None


def heard_at(data: bytes, sent_baud: int, heard_baud: int) -> bytes:
    """The bytes that a UART at heard_baud makes of a run of bytes sent at sent_baud.

    >>> heard_at(b"Q0", 9600, 9600)
    b'Q0'
    >>> heard_at(b"Q0", 9600, 115200).hex(" ")
    '00 00 00 00 00 00'
    """
    if sent_baud == heard_baud:
        return data
    line = [1]
    for byte in data:
        line += [0, *(byte >> bit & 1 for bit in range(8)), 1]
    step = sent_baud / heard_baud  # of the hearer's bit, in bits sent
    line += [1] * (int(BITS * step) + 2)  # idle
    heard, free_at = bytearray(), 0.0
    for start, (before, now) in enumerate(pairwise(line), 1):
        if not before or now or start < free_at:
            continue
        bits = (line[min(len(line) - 1, int(start + (1.5 + bit) * step))] for bit in range(8))
        heard.append(sum(value << bit for bit, value in enumerate(bits)))
        free_at = start + (BITS - 0.5) * step
    return bytes(heard)
