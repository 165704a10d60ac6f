"""What a person may want of an MTi beside measuring: requests to bytes, answers to words.

Each `encode_` gives a whole frame; the answer has the next higher message id, or is an Error
(hw.mti.frames.error_in_words). Nothing here is sent by a session: settings wear the device's
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
BAUDS = {**{code: baud for baud, code in BAUD_CODES.items()}, 0x0A: 921600}
SELF_TESTS = tuple(
    f"{what} {axis}"
    for what in ("acceleration", "rate of turn", "magnetic field")
    for axis in ("x", "y", "z")
)
OUTPUTS = {
    0x0810: "temperature",
    0x1010: "UTC time",
    0x1020: "packet counter",
    0x1060: "sample time, fine",
    0x1070: "sample time, coarse",
    0x2010: "quaternion",
    0x2020: "rotation matrix",
    0x2030: "Euler angles",
    0x3010: "pressure",
    0x4010: "velocity increment",
    0x4020: "acceleration",
    0x4030: "free acceleration",
    0x5020: "altitude",
    0x5030: "position ECEF",
    0x5040: "latitude and longitude",
    0x7010: "GNSS position, velocity, time",
    0x7020: "GNSS satellites",
    0x8020: "rate of turn",
    0x8030: "orientation increment",
    0xC020: "magnetic field",
    0xD010: "velocity",
    0xE010: "status byte",
    0xE020: "status word",
}
FORMATS = ("float32", "12.20", "16.32", "float64")
FRAMES = ("ENU", "NED", "NWU", "frame 3")
FRAMED = (0x2010, 0x2020, 0x2030, 0x4030, 0xD010)  # outputs whose numbers depend on the frame
FORMATTED = (0x0810, *range(0x2010, 0x2040, 16), *range(0x4010, 0x4040, 16), 0x5020, 0x5030, 0x5040,
             0x8020, 0x8030, 0xC020, 0xD010)  # fmt: skip


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
    """The 118 bytes of Configuration (section 3); zero and "" where the device left them so."""

    master_id: int
    period: int  # 1/115200 s
    skip: int
    sync_in: tuple[int, int, int]  # mode, skip, offset
    date: str
    time: str
    devices: int
    device_id: int
    data_bytes: int  # of an MTData message; 0 on a newer device
    output_mode: int
    output_settings: int
    scenario: Scenario
    firmware: tuple[int, int, int]
    filter_type: str  # "3", "6", "I"
    filter_version: tuple[int, int]

    @property
    def rate_hz(self) -> float:
        """Messages a second; 0.0 where only requests bring one, or nothing is said."""
        if not self.period or self.skip == 0xFFFF:
            return 0.0
        return 115200 / (self.period * (self.skip + 1))


def decode_configuration(data: bytes) -> MtConfiguration | None:
    """The data of Configuration; None where it has not 118 bytes."""
    if len(data) != CONFIGURATION_BYTES:
        return None
    master_id, period, skip, sync_mode, sync_skip, sync_offset = struct.unpack_from(">IHHHHI", data)
    tail = struct.unpack_from(">HIHHIBB", data, 96)
    devices, device_id, data_bytes, mode, settings, scenario_version, scenario_kind = tail
    return MtConfiguration(
        master_id=master_id,
        period=period,
        skip=skip,
        sync_in=(sync_mode, sync_skip, sync_offset),
        date=_text(data[16:24]),
        time=_text(data[24:32]),
        devices=devices,
        device_id=device_id,
        data_bytes=data_bytes,
        output_mode=mode,
        output_settings=settings,
        scenario=Scenario(scenario_kind, scenario_version),
        firmware=(data[112], data[113], data[114]),
        filter_type=_text(data[115:116]),
        filter_version=(data[116], data[117]),
    )


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


def decode_scenario(data: bytes) -> Scenario | None:
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


def decode_self_test(data: bytes) -> list[str] | None:
    """What failed, in words; empty: all passed; None where the answer is not one.

    >>> decode_self_test(bytes([0x01, 0xF7]))
    ['rate of turn x']
    """
    if len(data) != 2:
        return None
    passed = int.from_bytes(data, "big")
    return [words for bit, words in enumerate(SELF_TESTS) if not passed >> bit & 1]


def encode_reset() -> bytes:
    """Begin anew as after a loss of power; its WakeUp follows the answer."""
    return encode_frame(Mid.Reset)


def encode_restore_factory() -> bytes:
    """All settings as shipped."""
    return encode_frame(Mid.RestoreFactoryDef)


def encode_req_baudrate() -> bytes:
    """The rate that holds from the next reset on."""
    return encode_frame(Mid.SetBaudrate)


def decode_baudrate(data: bytes) -> int | None:
    """Bits a second; None where the code is not known."""
    return BAUDS.get(data[0]) if len(data) == 1 else None


def encode_set_baudrate(baud: int) -> bytes:
    """Another rate from the next reset on. An adapter that cannot do it is locked out."""
    if baud not in BAUD_CODES:
        raise ValueError(f"baud: must be one of {sorted(BAUD_CODES)}, is {baud}")
    return encode_frame(Mid.SetBaudrate, bytes([BAUD_CODES[baud]]))


def encode_output_configuration(outputs: list[tuple[int, int]]) -> bytes:
    """Set the outputs of a newer device, (identifier, Hz) each; an empty list reads them."""
    if len(outputs) > 32:
        raise ValueError(f"outputs: at most 32, given {len(outputs)}")
    data = b"".join(struct.pack(">HH", *output) for output in outputs)
    return encode_frame(Mid.SetOutputConfiguration, data)


def decode_output_configuration(data: bytes) -> list[tuple[int, int]]:
    """(identifier, Hz) in the device's order; 65535 Hz: with every message."""
    whole = len(data) - len(data) % 4
    return [
        (identifier, rate_hz) for identifier, rate_hz in struct.iter_unpack(">HH", data[:whole])
    ]


def output_in_words(identifier: int) -> str:
    """A data identifier of MTData2.

    >>> output_in_words(0x2019)
    'quaternion, 12.20, NWU'
    """
    kind = identifier & 0xFFF0
    words = [OUTPUTS.get(kind, f"output {identifier:04X}")]
    if kind in FORMATTED:
        words.append(FORMATS[identifier & 3])
    if kind in FRAMED:
        words.append(FRAMES[identifier >> 2 & 3])
    return ", ".join(words)


def _text(data: bytes) -> str:
    return data.decode("ascii", "replace").strip("\0 ")
