"""The binary segment of a frame: its fields, and its depths with what is doubted taken out.

    length n u32 | time u64 | version u16 | number u32, quality u8, status u8 | maps | CRC u32 | n

Little-endian; the segment is n + 4 bytes long, further sets may follow. Version 1 has no number,
quality and status.
Source: visionary sheet, section 5.
"""

import struct
import zlib
from datetime import UTC, datetime

import numpy as np
from msgspec import Struct

from core.records import U8, U16
from hw.device import BadFrame
from hw.visionary.blob import SHOWN
from hw.visionary.description import Description
from jit import kernel

HEAD, MORE = struct.Struct("<IQH"), struct.Struct("<IBB")
TAIL = struct.Struct("<II")
NONE, MOST = 0, 65_535  # depths that are no measurement


class FrameHead(Struct, frozen=True):
    """What a frame says of itself."""

    stamp_ms: int  # since 1970, by the camera's calendar clock
    number: int  # of captured frames; -1: it is not told
    quality: int
    status: int  # 0: all is well
    is_crc_right: bool
    maps_at: int  # where they begin


def stamp_ms_of(bits: int) -> int | None:
    """Milliseconds since 1970 of a time stamp; None: no such time.

    >>> stamp_ms_of(0x03F55D8003A3EC7B)
    1795358159123
    """
    year, month, day = bits >> 47 & 0xFFF, bits >> 43 & 0xF, bits >> 38 & 0x1F
    hour, minute, second = bits >> 22 & 0x1F, bits >> 16 & 0x3F, bits >> 10 & 0x3F
    try:
        at = datetime(year, month, day, hour, minute, second, tzinfo=UTC)
    except ValueError:
        return None
    return round(at.timestamp()) * 1000 + (bits & 0x3FF)


def head_of(binary: memoryview, told: Description) -> FrameHead | BadFrame:
    """The fields of a whole segment; or why it is none."""
    shown = bytes(binary[:SHOWN])
    if len(binary) < HEAD.size:
        return BadFrame("a depth set that is too short", shown)
    length, bits, version = HEAD.unpack_from(binary)
    maps_at = HEAD.size + (MORE.size if version != 1 else 0)
    size = maps_at + told.maps_size + TAIL.size
    if version not in (1, 2):
        return BadFrame(f"a depth set of version {version}, not 1 or 2", shown)
    if length + 4 != size or len(binary) < size:
        return BadFrame(
            f"a depth set of {length + 4} bytes in {len(binary)}, "
            f"{told.width} x {told.height} px need {size}",
            shown,
        )
    crc, copy = TAIL.unpack_from(binary, size - TAIL.size)
    if copy != length:
        return BadFrame("a depth set whose lengths differ", shown)
    stamp_ms = stamp_ms_of(bits)
    if stamp_ms is None:
        return BadFrame(f"a depth set with an impossible time, {bits:016x}", shown)
    number, quality, status = MORE.unpack_from(binary, HEAD.size) if version != 1 else (-1, 0, 0)
    is_right = zlib.crc32(binary[4 : size - TAIL.size]) == crc
    return FrameHead(stamp_ms, number, quality, status, is_right, maps_at)


@kernel
def _keep_good(
    data: U8, depth_at: int, third_at: int, size: int, least: int, before: U16, numbers: U16
) -> tuple[int, int]:
    """Fills numbers (n,) with depths, 0 where there is none or it is doubted.

    Args:
        data: the segment's bytes.
        third_at: of states or confidences of `size` bytes each; -1: there are none.
        least: confidence that is believed; -1: these are states, and 0 is good.
        before: (n,) numbers of another frame.

    Returns:
        How many there are, and how many differ from the other frame's.
    """
    count = changed = 0
    for i in range(len(numbers)):
        at = depth_at + 2 * i
        number = np.int64(data[at]) | np.int64(data[at + 1]) << 8
        third = np.int64(0)
        if third_at >= 0:
            at = third_at + size * i
            third = np.int64(data[at])
            if size == 2:
                third |= np.int64(data[at + 1]) << 8
        is_good = (third == 0) if least < 0 or third_at < 0 else (third >= least)
        kept = number if is_good and number != MOST else np.int64(0)
        count += kept != 0
        changed += kept != np.int64(before[i])
        numbers[i] = kept
    return count, changed


def numbers_of(
    binary: memoryview, head: FrameHead, told: Description, min_confidence: int, before: U16
) -> tuple[U16, int, int]:
    """The image (rows, columns), how many pixels are valid, and how many differ from `before`.

    Args:
        before: (rows, columns) of another frame, or `no_numbers`.
    """
    numbers: U16 = np.empty(told.height * told.width, np.uint16)
    third_at = head.maps_at + told.third_at if told.third_at >= 0 else -1
    least = -1 if told.has_states else min_confidence
    data: U8 = np.frombuffer(binary, np.uint8)
    count, changed = _keep_good(
        data, head.maps_at, third_at, told.third_size, least, before.reshape(-1), numbers
    )
    numbers.setflags(write=False)
    return numbers.reshape(told.height, told.width), int(count), int(changed)


def no_numbers(rows: int, columns: int) -> U16:
    """An image without a measurement, as one of another frame."""
    numbers: U16 = np.zeros((rows, columns), np.uint16)
    numbers.setflags(write=False)
    return numbers


def warm() -> None:
    """Run the kernel once, so that it is not compiled while a robot drives."""
    binary = memoryview(bytearray(HEAD.size + MORE.size + 4)).toreadonly()
    told = Description("", 1, 1, (1, 1), (0, 0), (0, 0), (0, 0, 0), False, 1.0, 2, 2, True, 4)
    head = FrameHead(0, 0, 0, 0, True, HEAD.size + MORE.size)
    numbers_of(binary, head, told, 0, no_numbers(1, 1))
