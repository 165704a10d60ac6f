"""MTData of a legacy MTi to samples, laid out by output mode and output settings.

The frame does not describe itself: only its length can tell that it is of another mode. Blocks that
mapod has no use for (raw counts, analog inputs, GPS, position, velocity, UTC) are stepped over.

Source: MTi sheet, sections 3 and 4.
"""

from collections.abc import Iterator

from hw.device import BadFrame
from hw.mti.sample import (
    EULER,
    NED,
    NUMBER_SIZES,
    NWU,
    ORIENTATION_NUMBERS,
    MtSample,
    SampleBuilder,
    numbers,
)

TEMPERATURE, CALIBRATED, ORIENTATION, AUXILIARY = 0x0001, 0x0002, 0x0004, 0x0008  # output modes
POSITION, VELOCITY, STATUS, GPS, RAW = 0x0010, 0x0020, 0x0800, 0x1000, 0x4000
COUNTER, UTC = 0x1, 0x2  # output settings
NO_ACCELERATION, NO_RATE, NO_MAGNETIC, NO_ANALOG_1, NO_ANALOG_2 = 0x10, 0x20, 0x40, 0x400, 0x800
IN_NED = 0x8000_0000

FIELDS = {"temperature_c": 1, "accel_mps2": 3, "rate_radps": 3, "magnetic": 3}  # numbers in a block


class MtDataDecoder:
    """MTData of one output mode and settings."""

    def __init__(self, mode: int, settings: int) -> None:
        self._number_format, self._orientation = settings >> 8 & 3, settings >> 2 & 3
        self._frame = NED if settings & IN_NED else NWU
        self._blocks: list[tuple[str, int, int]] = []  # name, start, end
        self.size = 0  # data bytes of a frame
        for name, size in _blocks(mode, settings):
            self._blocks.append((name, self.size, self.size + size))
            self.size += size

    def __contains__(self, block: str) -> bool:
        """Whether the messages carry a block of this name: "rate_radps", "counter" ..."""
        return any(name == block for name, _, _ in self._blocks)

    def decode(self, data: bytes) -> MtSample | BadFrame:
        if len(data) != self.size:
            reason = f"{len(data)} data bytes, {self.size} by output mode and settings"
            return BadFrame(reason, data)
        builder = SampleBuilder()
        for name, start, end in self._blocks:
            if name in FIELDS:
                builder.take(name, numbers(data, start, FIELDS[name], self._number_format))
            elif name == "orientation" and self._orientation <= EULER:
                count = ORIENTATION_NUMBERS[self._orientation]
                values = numbers(data, start, count, self._number_format)
                builder.take_orientation(self._orientation, values, self._frame)
            elif name in ("counter", "status"):
                builder.put(name, int.from_bytes(data[start:end], "big"))
        return builder.sample(data)


def _blocks(mode: int, settings: int) -> Iterator[tuple[str, int]]:
    """Name and size of the blocks present in MTData, in their order (section 4)."""
    number = NUMBER_SIZES[settings >> 8 & 3]
    processed = 0 if mode & RAW else mode  # raw data excludes all that is computed from it
    calibrated = processed & CALIBRATED
    analog_inputs = (not settings & NO_ANALOG_1) + (not settings & NO_ANALOG_2)
    table: tuple[tuple[str, int, int], ...] = (
        ("raw", mode & RAW, 20),
        ("gps", mode & GPS, 44),
        ("temperature_c", processed & TEMPERATURE, number),
        ("accel_mps2", calibrated and ~settings & NO_ACCELERATION, 3 * number),
        ("rate_radps", calibrated and ~settings & NO_RATE, 3 * number),
        ("magnetic", calibrated and ~settings & NO_MAGNETIC, 3 * number),
        ("orientation", processed & ORIENTATION, ORIENTATION_NUMBERS[settings >> 2 & 3] * number),
        ("analog", processed & AUXILIARY and analog_inputs, 2 * analog_inputs),
        ("position", processed & POSITION, 3 * number),
        ("velocity", processed & VELOCITY, 3 * number),
        ("status", mode & STATUS, 1),
        ("counter", settings & COUNTER, 2),
        ("utc", settings & UTC, 12),
    )
    return ((name, size) for name, present, size in table if present)
