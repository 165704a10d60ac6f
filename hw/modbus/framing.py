"""Modbus frames: requests found in bytes from TCP and UDP, and answers put into frames.

RTU frames have a file of their own (hw/modbus/rtu.py).
Source: Modbus messaging on TCP/IP implementation guide 1.0b, section 3.1.3.
"""

import struct
from typing import NamedTuple

MBAP = struct.Struct(">HHHB")  # transaction, protocol (0), length of what follows, unit
LENGTHS = range(2, 255)  # unit and 1 to 253 bytes of request
LENGTH_OFFSET = 6


class Request(NamedTuple):
    """One request as it arrived."""

    unit: int
    pdu: bytes  # function code and data, at least one byte
    transaction: int = 0  # told back; RTU has none


def take_requests(data: bytearray) -> tuple[list[Request], str]:
    """The whole requests at the start of `data`, which are taken out of it.

    And why what follows them is no Modbus frame, and nothing behind it can be understood; "" if
    it may be one.
    """
    found: list[Request] = []
    at, reason = 0, ""
    while len(data) - at >= LENGTH_OFFSET:
        transaction, protocol, length = struct.unpack_from(">HHH", data, at)
        if protocol != 0 or length not in LENGTHS:
            reason = "impossible length" if protocol == 0 else "wrong protocol number"
            break
        end = at + LENGTH_OFFSET + length
        if end > len(data):
            break
        found.append(Request(data[at + LENGTH_OFFSET], bytes(data[at + 7 : end]), transaction))
        at = end
    del data[:at]
    return found, reason


def datagram_requests(data: bytes) -> list[Request]:
    """The requests of one datagram: whole ones and nothing else; none if there is anything else."""
    rest = bytearray(data)
    found, reason = take_requests(rest)
    return [] if rest or reason else found


def mbap_frame(request: Request, pdu: bytes) -> bytes:
    """The frame of an answer on TCP or UDP.

    >>> mbap_frame(Request(1, b"", 5), bytes((0xE3, 1))).hex(" ")
    '00 05 00 00 00 03 01 e3 01'
    """
    return MBAP.pack(request.transaction, 0, len(pdu) + 1, request.unit) + pdu
