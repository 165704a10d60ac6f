"""What arrives on a wire and is no frame, or one that says what can't be: the reason it counts as.

A link's frames have a right checksum where the row is not about that: what they say is wrong.
Source: docs/protocols.
"""

import struct

from mapod_link.asking import ASK_BODY, DRIVE_BODY, EXTERNAL_BODY, UPRIGHT_BODY
from mapod_link.frames import ASK, DRIVE, EXTERNAL_POSE, HELLO, bytes_from_frame

SESSION, NONCE = 0x5A17C0DE, 0x11223344
NO_ANGLE, LEAST = -(2**15), -(2**31)


def drive(*numbers: int) -> bytes:
    """v mm/s, w mrad/s, valid ms, reserved."""
    return bytes_from_frame(DRIVE, 1, 1000, DRIVE_BODY.pack(SESSION, NONCE, *numbers))


def external(*numbers: int, upright: bytes = b"") -> bytes:
    """x and y mm, yaw, their deviations, correlation, deviation of yaw, age ms."""
    body = EXTERNAL_BODY.pack(SESSION, NONCE, *numbers) + upright
    return bytes_from_frame(EXTERNAL_POSE, 1, 1000, body)


def ask(*numbers: int) -> bytes:
    """Number, what, layer, i, j, width, height."""
    return bytes_from_frame(ASK, 1, 1000, ASK_BODY.pack(*numbers))


def link(kind: int, body: bytes) -> bytes:
    return bytes_from_frame(kind, 1, 1000, body)


def mti(mid: int, data: bytes) -> bytes:
    body = bytes((0xFF, mid, len(data))) + data
    return b"\xfa" + body + bytes((-sum(body) & 0xFF,))


def cola(payload: bytes, length: int | None = None) -> bytes:
    """CoLa-B, its checksum right."""
    size = len(payload) if length is None else length
    total = 0
    for byte in payload:
        total ^= byte
    return bytes((2, 2, 2, 2)) + struct.pack(">I", size) + payload + bytes((total,))


SAW = 105_250, -48_900, 12_345, 20, 30, -2500, 175, 40  # an external pose as it may be
DAMAGED = drive(650, -120, 300, 0).replace(SESSION.to_bytes(4, "little"), b"mpod")
TOO_LONG = b"\x01" * 400

LINK = {
    "nothing": (b"", "bad length"),
    "shorter than any frame": (b"\x18" * 11, "bad length"),
    "longer than any frame": (bytes(369), "bad length"),
    "a byte changed": (DAMAGED, "bad checksum"),
    "zeros": (bytes(20), "bad checksum"),
    "a type that there is not": (link(15, b""), "unknown type"),
    "a frame of the other direction": (link(2, bytes(36)), "unknown type"),
    "a drive request cut short": (link(DRIVE, bytes(19)), "DRIVE out of range"),
    "a drive request too long": (link(DRIVE, bytes(21)), "DRIVE out of range"),
    "of nobody": (link(DRIVE, DRIVE_BODY.pack(SESSION, 0, 1, 1, 1, 0)), "DRIVE out of range"),
    "a speed that is none": (drive(NO_ANGLE, 0, 300, 0), "DRIVE out of range"),
    "a turn that is none": (drive(0, NO_ANGLE, 300, 0), "DRIVE out of range"),
    "to drive for more than a second": (drive(0, 0, 1001, 0), "DRIVE out of range"),
    "with what is reserved": (drive(0, 0, 300, 1), "DRIVE out of range"),
    "a pose cut short": (link(EXTERNAL_POSE, bytes(27)), "EXTERNAL_POSE out of range"),
    "a pose between its two lengths": (
        external(*SAW, upright=bytes(4)),
        "EXTERNAL_POSE out of range",
    ),
    "no x": (external(LEAST, *SAW[1:]), "EXTERNAL_POSE out of range"),
    "no y": (external(SAW[0], LEAST, *SAW[2:]), "EXTERNAL_POSE out of range"),
    "a yaw beyond a half turn": (
        external(*SAW[:2], 31_416, *SAW[3:]),
        "EXTERNAL_POSE out of range",
    ),
    "x without a deviation": (external(*SAW[:3], 0, *SAW[4:]), "EXTERNAL_POSE out of range"),
    "y without a deviation": (external(*SAW[:4], 0, *SAW[5:]), "EXTERNAL_POSE out of range"),
    "a correlation above one": (
        external(*SAW[:5], 10_001, *SAW[6:]),
        "EXTERNAL_POSE out of range",
    ),
    "a yaw without a deviation": (external(*SAW[:6], 0, SAW[7]), "EXTERNAL_POSE out of range"),
    "from more than a second ago": (external(*SAW[:7], 1001), "EXTERNAL_POSE out of range"),
    "no height": (
        external(*SAW, upright=UPRIGHT_BODY.pack(LEAST, 5, 0, 0, 9)),
        "EXTERNAL_POSE out of range",
    ),
    "a pitch beyond a half turn": (
        external(*SAW, upright=UPRIGHT_BODY.pack(0, 5, 31_416, 0, 9)),
        "EXTERNAL_POSE out of range",
    ),
    "a question cut short": (link(ASK, bytes(13)), "ASK out of range"),
    "a question for nothing": (ask(1, 0, 0, 0, 0, 0, 0), "ASK out of range"),
    "a hello cut short": (link(HELLO, bytes(11)), "HELLO out of range"),
}

SERIAL = {  # of the link on a serial line
    "no delimiter for long": (TOO_LONG, "frame too long"),
    "a code that points behind the end": (b"\xff\x01\x02\x00", "bad length"),
    "one byte": (b"\x05\x00", "bad length"),
    "a code within a frame that points behind its end": (b"\x02\x11" * 9 + b"\x7f\x00", "not COBS"),
}

MODBUS = {  # on TCP
    "another protocol": (
        bytes.fromhex("00 01 00 01 00 06 01 03 00 00 00 01"),
        "wrong protocol number",
    ),
    "too short to be a request": (bytes.fromhex("00 01 00 00 00 01 01 03"), "impossible length"),
    "longer than any request": (bytes.fromhex("00 01 00 00 00 FF 01 03"), "impossible length"),
    "of 65 535 bytes": (bytes.fromhex("00 01 00 00 FF FF 01 03"), "impossible length"),
}

LMS111 = {
    "noise": (b"\x00\x11\x22" * 9, "no telegram"),
    "a payload of gigabytes": (cola(b"sSN LMDscandata ", 1 << 31), "no telegram"),
    "a wrong checksum": (cola(b"sAN SetAccessMode \x01")[:-1] + b"\x00", "wrong checksum"),
    "a telegram of no kind": (cola(b"xyz LMDscandata "), "no telegram"),
    "a name of no letters": (cola(b"sAN \xff\xff"), "unknown telegram"),
    "a scan without content": (cola(b"sSN LMDscandata "), "telegram ends early"),
    "a scan of zeros": (cola(b"sSN LMDscandata " + bytes(60)), "scan frequency is 0"),
    "a refusal of one byte": (cola(b"sFA\x01"), "unknown telegram"),
    "text of no kind": (b"\x02hello\x03", "no telegram"),
}

MTI = {
    "noise": (b"\x00\x11\x22" * 9, "no start of a frame"),
    "a wrong checksum": (mti(0x3E, b"")[:-1] + b"\x00", "bad checksum"),
    "for another bus": (b"\xfa\x7f\x3e\x00\x43", "no start of a frame"),
    "an extended length that is short": (
        b"\xfa\xff\x32\xff\x00\x05" + bytes(9),
        "bad extended length",
    ),
    "an extended length that is too long": (
        b"\xfa\xff\x32\xff\xff\xff" + bytes(9),
        "bad extended length",
    ),
    "a frame that never ends": (b"\xfa\xff\x32\x40" + bytes(9), "frame not completed in time"),
}

AX3500 = {
    "a line without an end": (b"0" * 200, "line without an end"),
    "the end of such a line": (b"0" * 200 + b"\r", "end of a line that was too long"),
    "control characters": (b"?Q0\x07\r", "line with control characters"),
}

URG04LX = {
    "noise": (b"\x00\x11\x22\n\n", "no reply"),
    "a status with a wrong sum": (b"VV\n00Q\n\n", "wrong sum"),
    "data with a wrong sum": (b"GS0044004900\n00P\n0B=5T\n00070C0D?XooT\n\n", "wrong sum"),
    "no end": (b"x" * 20_000, "no end of a reply"),
}

DEVICES = {"lms111": LMS111, "mti": MTI, "ax3500": AX3500, "urg04lx": URG04LX}
