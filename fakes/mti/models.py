"""The kinds of MTi that the fake can be, and in what they differ. Serial numbers are fictitious.

Source: MTi sheet, sections 3, 5, 7 and 9; names of filter profiles [U].
"""

import struct
from dataclasses import dataclass, field

LEGACY, FOURTH, FIFTH = 3, 4, 5  # generations: 10/100 series are the fourth, 600 the fifth
DAY_TICKS, U32_TICKS = 864_000_000, 2**32
HARDWARE = b"\x02\x00"
SHIPPED_OUTPUTS = ((0x1020, 0xFFFF), (0x1060, 0xFFFF), (0x2010, 100), (0xE020, 0xFFFF))

BAUDS = {
    0x00: 460800, 0x01: 230400, 0x02: 115200, 0x03: 76800, 0x04: 57600, 0x05: 38400, 0x06: 28800,
    0x07: 19200, 0x08: 14400, 0x09: 9600, 0x0A: 921600, 0x80: 921600, 0x0B: 4800,
}  # fmt: skip
NEW_BAUDS = BAUDS | {0x0C: 2_000_000, 0x0D: 4_000_000, 0x0E: 3_686_400}

ORIENTED = {0x2010: 400, 0x2020: 400, 0x2030: 400}
INERTIAL = {0x4020: 400, 0x8020: 400, 0xC020: 100}
SLOW = dict.fromkeys((*ORIENTED, *INERTIAL), 100)
NEW_PROFILES = (
    (39, 1, b"general"), (40, 1, b"high_mag_dep"), (41, 1, b"dynamic"),
    (42, 1, b"north_reference"), (43, 1, b"vru_general"),
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Model:
    """What a device of one kind is and can do."""

    product: bytes
    device_id: bytes  # 4 bytes, or 8 of which the first 4 are zero
    generation: int = FOURTH
    firmware: bytes
    filter: bytes  # type in ASCII, major, minor
    scenarios: tuple[tuple[int, int, bytes], ...]  # filter profiles: kind, version, name
    scenario_word: int  # version and type as message 0D tells them
    gnss: bool = False  # it has a receiver, of which the fake sends nothing
    rates_hz: dict[int, int] = field(default_factory=dict)  # packet id without format: the most
    silent_mids: tuple[int, ...] = ()  # requests that it does not answer

    @property
    def legacy(self) -> bool:
        """Whether it knows no MTData2."""
        return self.generation == LEGACY

    @property
    def fine_ticks(self) -> int:
        """SampleTimeFine wraps there."""
        return U32_TICKS if self.generation == FIFTH else DAY_TICKS

    @property
    def short_id(self) -> bytes:
        """The 4 bytes of the id that messages of fixed layout carry."""
        return self.device_id[-4:]

    @property
    def bauds(self) -> dict[int, int]:
        return BAUDS if self.legacy else NEW_BAUDS

    def profiles(self) -> bytes:
        """The five slots of message 63."""
        slots = [struct.pack(">BB20s", k, version, name.ljust(20))
                 for k, version, name in self.scenarios]  # fmt: skip
        return b"".join(slots).ljust(5 * 22, b"\0")

    @property
    def base_hz(self) -> int:
        """Its fastest output."""
        return max(self.rates_hz.values(), default=400)


REVISION_11 = bytes.fromhex("010702 0000001C 00000010")
MODELS = {
    "MTi-28": Model(
        product=b"MTi-28A53G35".ljust(20),
        device_id=bytes.fromhex("00300D2A"),  # type MTi with RS-232
        generation=LEGACY,
        firmware=bytes([2, 6, 1]),
        filter=bytes([0x33, 2, 8]),
        scenarios=((3, 8, b"machine"), (2, 8, b"human"), (6, 8, b"machine_nomagfield")),
        scenario_word=0x0003,
    ),
    "MTi-G": Model(
        product=b"MTi-G-28A53G35",
        device_id=bytes.fromhex("00500D2B"),
        generation=LEGACY,
        firmware=bytes([2, 6, 1]),
        filter=bytes([0x36, 2, 2]),
        scenarios=((10, 7, b"general"), (11, 7, b"automotive"), (12, 7, b"aerospace")),
        scenario_word=0x070A,
        gnss=True,
    ),
    "MTi-30": Model(
        product=b"MTi-30-2A8G4".ljust(20),
        device_id=bytes.fromhex("03680D2C"),
        firmware=REVISION_11,
        filter=bytes([0x49, 5, 1]),
        scenarios=NEW_PROFILES,
        scenario_word=0x0027,
        rates_hz={0x0810: 1, **ORIENTED, **INERTIAL},
    ),
    "MTi-3": Model(
        product=b"MTi-3-8A7G6".ljust(20),
        device_id=bytes.fromhex("03880D2D"),
        generation=FIFTH,
        firmware=bytes.fromhex("010000 00000026 0000C3B1"),
        filter=bytes([0x49, 1, 0]),
        scenarios=tuple((kind + 11, version, name) for kind, version, name in NEW_PROFILES),
        scenario_word=0x0032,
        rates_hz={0x0810: 1, **SLOW},
        silent_mids=(0xDA, 0xDC, 0x8E, 0x86),
    ),
    "MTi-G-700": Model(
        product=b"MTi-G-700-2A5G4".ljust(20),
        device_id=bytes.fromhex("07700D2E"),
        firmware=REVISION_11,
        filter=bytes([0x49, 5, 1]),
        scenarios=((1, 1, b"General"), (2, 1, b"GeneralNoBaro"), (3, 1, b"GeneralMag"),
                   (4, 1, b"Automotive"), (5, 1, b"HighPerformanceEDR")),
        scenario_word=0x0001,
        gnss=True,
        rates_hz={0x0810: 100, **ORIENTED, **INERTIAL},  # 0810 as recorded
    ),
    "MTi-630": Model(
        product=b"MTi-630-8A1G6".ljust(20),
        device_id=bytes.fromhex("00000000 00800D2F"),
        generation=FIFTH,
        firmware=bytes.fromhex("010300 00000041 0001E240"),
        filter=bytes([0x49, 2, 0]),
        scenarios=((1, 1, b"Responsive"), (2, 1, b"Robust"), (3, 1, b"General")),
        scenario_word=0x0001,
        rates_hz={0x0810: 1, **ORIENTED, **INERTIAL},
    ),
}  # fmt: skip
