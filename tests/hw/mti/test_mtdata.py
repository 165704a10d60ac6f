"""MTData of every output mode and every output settings, against a slow encoder."""

import math
import struct
from itertools import product

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from hw.device import BadFrame
from hw.mti.mtdata import MtDataDecoder
from hw.mti.sample import MtSample
from tests.support.mti_frames import ROWS, euler_deg, slow_number

MODES = [
    *(
        sum(bits)
        for bits in product((0, 1), (0, 2), (0, 4), (0, 8), (0, 0x30), (0, 0x800), (0, 0x1000))
    ),
    *(0x4000, 0x5000, 0x4800, 0x5806, 0x403F),  # raw
]
SETTINGS = [
    sum(bits)
    for bits in product(
        (0, 1), (0, 2), (0, 4, 8), (0, 0x10), (0, 0x20), (0, 0x40), (0, 0x100, 0x200, 0x300),
        (0, 0x400), (0, 0x800),
    )
]  # fmt: skip
TEMPERATURE, STATUS, COUNTER = 36.5, 3, 4660
ACCEL, RATE, MAGNETIC = (0.12, -0.34, 9.81), (0.01, -0.02, 0.25), (0.45, -0.10, -0.89)
ORIENTATIONS = ((0.5, 0.5, 0.5, 0.5), (90.0, 0.0, 90.0), 9 * (0.5,))  # the last: not read
UTC = bytes.fromhex("00000001 07DA 0102030405 01")


def slow_mtdata(mode: int, settings: int) -> bytes:
    """By the table of section 4, one row after the other."""
    data = bytes(range(20)) if mode & 0x4000 else b""
    data += bytes(44) if mode & 0x1000 else b""
    processed = 0 if mode & 0x4000 else mode
    values = [TEMPERATURE] if processed & 0x0001 else []
    if processed & 0x0002:
        values += [] if settings & 0x10 else ACCEL
        values += [] if settings & 0x20 else RATE
        values += [] if settings & 0x40 else MAGNETIC
    values += ORIENTATIONS[settings >> 2 & 3] if processed & 0x0004 else ()
    data += b"".join(slow_number(value, settings // 256 % 4) for value in values)
    if processed & 0x0008:
        data += b"" if settings & 0x400 else b"\1\2"
        data += b"" if settings & 0x800 else b"\3\4"
    position_velocity = 3 * (bool(processed & 0x0010) + bool(processed & 0x0020))
    data += position_velocity * slow_number(57.6, settings // 256 % 4)
    data += bytes([STATUS]) if mode & 0x0800 else b""
    data += struct.pack(">H", COUNTER) if settings & 1 else b""
    return data + (UTC if settings & 2 else b"")


def sample_of(message: str) -> MtSample:
    [row] = [row for row in ROWS if row[1] == message]
    _, mode, settings = message.split()
    sample = MtDataDecoder(int(mode, 16), int(settings, 16)).decode(bytes.fromhex(row[2])[4:-1])
    assert isinstance(sample, MtSample)
    return sample


def near(value: tuple[float, ...] | None, expected: tuple[float, ...] | None) -> bool:
    """Equal but for a number's format: 12.20 is the coarsest of small, float32 of large ones."""
    if value is None or expected is None:
        return value is expected
    return len(value) == len(expected) and all(
        abs(a - b) <= 1e-6 + 1e-7 * abs(b) for a, b in zip(value, expected, strict=True)
    )


def check(mode: int, settings: int) -> None:
    data, decoder = slow_mtdata(mode, settings), MtDataDecoder(mode, settings)
    assert decoder.size == len(data)
    sample = decoder.decode(data)
    assert isinstance(sample, MtSample), sample
    computed = 0 if mode & 0x4000 else mode
    calibrated, oriented = computed & 2, computed & 4 and not settings & 8
    assert near(sample.accel_mps2, ACCEL if calibrated and not settings & 0x10 else None)
    assert near(sample.rate_radps, RATE if calibrated and not settings & 0x20 else None)
    assert near(sample.magnetic, MAGNETIC if calibrated and not settings & 0x40 else None)
    assert near(sample.q_earth_sensor, ORIENTATIONS[0] if oriented else None)
    assert sample.temperature_c == (TEMPERATURE if computed & 1 else None)
    assert sample.status == (STATUS if mode & 0x800 else None)
    assert sample.counter == (COUNTER if settings & 1 else None)


def test_every_output_mode_is_decoded_with_settings_that_cover_each_switch() -> None:
    """A 13th of the 1536 settings for the modes that they change most; a 61st for the others."""
    for mode in MODES:
        step = 13 if mode in (0x0006, 0x000F, 0x183F) else 61
        for settings in SETTINGS[mode % step :: step]:
            check(mode, settings)


def test_a_position_that_is_no_number_harms_nothing() -> None:
    sample = MtDataDecoder(0x0030, 1).decode(struct.pack(">6fH", *[math.nan] * 6, 7))
    assert sample == MtSample(counter=7)


@given(mode=st.integers(0, 0xFFFF), settings=st.integers(0, 2**32 - 1), data=st.data())
def test_no_data_of_any_mode_and_settings_makes_the_decoder_raise(
    mode: int, settings: int, data: st.DataObject
) -> None:
    decoder = MtDataDecoder(mode, settings)
    given_bytes = data.draw(st.binary(min_size=decoder.size, max_size=decoder.size))
    decoder.decode(given_bytes)
    assert isinstance(decoder.decode(given_bytes + b"\0"), BadFrame)


def test_calibrated_data_and_euler_angles_of_the_sheet() -> None:
    sample = sample_of("MTData 0006 00000005")
    np.testing.assert_allclose(sample.accel_mps2 or (), [0.12, -0.34, 9.81], rtol=1e-6)
    np.testing.assert_allclose(sample.rate_radps or (), [0.01, -0.02, 0.25], rtol=1e-6)
    np.testing.assert_allclose(sample.magnetic or (), [0.45, -0.10, -0.89], rtol=1e-6)
    np.testing.assert_allclose(euler_deg(sample.q_earth_sensor), [1.5, -2.25, 90.0], rtol=1e-9)
    assert (sample.counter, sample.status) == (4660, None)
    with_status = sample_of("MTData 0806 00000005")
    assert (with_status.counter, with_status.status) == (4661, 3)
    assert with_status.q_earth_sensor == sample.q_earth_sensor


def test_the_other_number_formats_and_the_quaternion_of_the_sheet() -> None:
    for message, counter in (("MTData 0004 00000105", 0x1236), ("MTData 0004 00000205", 0x1237)):
        sample = sample_of(message)
        np.testing.assert_allclose(euler_deg(sample.q_earth_sensor), [1.5, -2.25, 90], rtol=1e-9)
        assert sample.counter == counter
        assert sample.rate_radps is None
    yaw_90 = sample_of("MTData 0004 00000001")
    np.testing.assert_allclose(yaw_90.q_earth_sensor or (), [0.5**0.5, 0, 0, 0.5**0.5], atol=1e-7)
    assert sample_of("MTData 0004 00000005").counter == 64255
