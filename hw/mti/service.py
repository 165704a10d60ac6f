"""What a person may want of an MTi beside measuring: requests to bytes, answers to names.

Each `encode_` gives a whole frame; the answer has the next higher message id, or is an Error
(hw.mti.frames.describe_error). Nothing here is sent by a session: settings wear the device's
memory, and a reset of orientation changes what all users of the device see.

Source: MTi sheet, section 3.
"""

import struct
from dataclasses import dataclass
from enum import IntEnum

from hw.mti.frames import Mid, encode_frame

CONFIGURATION_BYTES, SCENARIO_BYTES = 118, 22
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
SELF_TESTS = tuple(
    f"{what} {axis}"
    for what in ("acceleration", "rate of turn", "magnetic field")
    for axis in ("x", "y", "z")
)


class OrientationReset(IntEnum):
    """Codes of ResetOrientation. STORE in Config state, 1 to 4 in Measurement state."""

    STORE = 0  # keeps what the resets before have made
    HEADING = 1  # earth X becomes the sensor's X as it points now; not for MTi-G
    GLOBAL = 2  # legacy only
    OBJECT = 3  # the sensor's tilt becomes zero
    ALIGNMENT = 4  # 3 and 1
    DEFAULT_HEADING = 5  # newer devices, as all that follow
    DEFAULT_OBJECT = 6
    DEFAULT_ALIGNMENT = 7


@dataclass(frozen=True, slots=True)
class Scenario:
    """A filter profile: what kind of motion the orientation filter expects."""

    kind: int  # what SetScenario takes
    version: int
    name: str = ""  # the device gives it in its list only


@dataclass(frozen=True, slots=True)
class MtConfiguration:
    """What is used of the 118 bytes of Configuration (section 3)."""

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


def encode_req_configuration() -> bytes:
    """All settings at once; Config state."""
    return encode_frame(Mid.ReqConfiguration)


def encode_req_scenarios() -> bytes:
    """Which filter profiles there are."""
    return encode_frame(Mid.ReqAvailableScenarios)


def decode_scenarios(data: bytes) -> list[Scenario]:
    """The list's entries that are in use; what is left over of an entry is not read."""
    found = []
    for start in range(0, len(data) - SCENARIO_BYTES + 1, SCENARIO_BYTES):
        kind, version = data[start], data[start + 1]
        if kind:
            found.append(Scenario(kind, version, _text(data[start + 2 : start + SCENARIO_BYTES])))
    return found


def encode_req_scenario() -> bytes:
    """Which filter profile is in use."""
    return encode_frame(Mid.SetScenario)


def maybe_scenario(data: bytes) -> Scenario | None:
    """The profile in use: version comes first on the wire."""
    return Scenario(data[1], data[0]) if len(data) == 2 else None


def encode_set_scenario(kind: int) -> bytes:
    """Choose a profile by its kind, 1..255; kept over a loss of power."""
    if not 1 <= kind <= 255:
        raise ValueError(f"kind: must be within 1..255, is {kind}")
    return encode_frame(Mid.SetScenario, struct.pack(">H", kind))


def encode_reset_orientation(code: OrientationReset) -> bytes:
    """Heading, object or alignment reset, and their storing."""
    return encode_frame(Mid.ResetOrientation, struct.pack(">H", code))


def encode_no_rotation(seconds: int) -> bytes:
    """Learn the gyroscopes' bias while the device is kept still so long, 0..65535 s."""
    if not 0 <= seconds <= 0xFFFF:
        raise ValueError(f"seconds: must be within 0..65535, is {seconds}")
    return encode_frame(Mid.SetNoRotation, struct.pack(">H", seconds))


def encode_self_test() -> bytes:
    """Run the self test; the answer takes up to 3 s."""
    return encode_frame(Mid.RunSelfTest)


def maybe_failed_tests(data: bytes) -> list[str] | None:
    """Which sensors failed; empty: all passed; None where the answer is not one.

    >>> maybe_failed_tests(bytes([0x01, 0xF7]))
    ['rate of turn x']
    """
    if len(data) != 2:
        return None
    passed = int.from_bytes(data, "big")
    return [sensor for bit, sensor in enumerate(SELF_TESTS) if not passed >> bit & 1]


def encode_set_baudrate(baud: int) -> bytes:
    """Another rate from the next reset on. An adapter that cannot do it is locked out."""
    if baud not in BAUD_CODES:
        raise ValueError(f"baud: must be one of {sorted(BAUD_CODES)}, is {baud}")
    return encode_frame(Mid.SetBaudrate, bytes([BAUD_CODES[baud]]))


def decode_output_configuration(data: bytes) -> list[tuple[int, int]]:
    """(identifier, Hz) in the device's order; 65535 Hz: with every message."""
    whole = len(data) - len(data) % 4
    return [
        (identifier, rate_hz) for identifier, rate_hz in struct.iter_unpack(">HH", data[:whole])
    ]


def _text(data: bytes) -> str:
    return data.decode("ascii", "replace").strip("\0 ")
