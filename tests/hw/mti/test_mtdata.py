"""MTData of every output mode and every output settings, against a slow encoder."""

import math
import struct
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw.device import BadFrame
from hw.mti.mtdata import MtDataDecoder
from hw.mti.sample import MtSample
from tests.support.mti_frames import ROWS, euler_deg, wire
from tests.support.scripted_mti import Truth, slow_mtdata, slow_number

EULER_FRAME = wire("MTData 0006 00000005")
MODES = [
    sum(bits)
    for bits in product((0, 1), (0, 2), (0, 4), (0, 8), (0, 0x30), (0, 0x800), (0, 0x1000))
]
RAW_MODES = [0x4000, 0x5000, 0x4800, 0x5806, 0x403F]
SETTINGS = [
    sum(bits)
    for bits in product(
        (0, 1), (0, 2), (0, 4, 8), (0, 0x10), (0, 0x20), (0, 0x40), (0, 0x100, 0x200, 0x300),
        (0, 0x400), (0, 0x800),
    )
]  # fmt: skip
HALF = math.sqrt(0.5)
ORIENTATIONS = {  # roll 90, pitch 0, yaw 90 degrees
    0: (0.5, 0.5, 0.5, 0.5),
    1: (90.0, 0.0, 90.0),
    2: (0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0),  # column by column
}


def sample_of(message: str) -> MtSample:
    """The sheet's message, decoded."""
    [row] = [row for row in ROWS if row[1] == message]
    _, mode, settings = message.split()
    sample = MtDataDecoder(int(mode, 16), int(settings, 16)).decode(bytes.fromhex(row[2])[4:-1])
    assert isinstance(sample, MtSample)
    return sample


def truth_of(settings: int) -> Truth:
    return Truth(orientation=ORIENTATIONS[settings >> 2 & 3])


def near(value: tuple[float, ...] | None, expected: tuple[float, ...] | None) -> bool:
    """Equal but for a number's format: 12.20 is the coarsest of small, float32 of large ones."""
    if value is None or expected is None:
        return value is expected
    return len(value) == len(expected) and all(
        abs(a - b) <= 1e-6 + 1e-7 * abs(b) for a, b in zip(value, expected, strict=True)
    )


def check(mode: int, settings: int, decoder: MtDataDecoder) -> None:
    """Every field of the sample, there or not there."""
    truth = truth_of(settings)
    data = slow_mtdata(mode, settings, truth)
    assert decoder.size == len(data)
    sample = decoder.decode(data)
    assert isinstance(sample, MtSample), sample
    computed = 0 if mode & 0x4000 else mode
    calibrated = computed & 2
    assert near(sample.accel_mps2, truth.accel if calibrated and not settings & 0x10 else None)
    assert near(sample.rate_radps, truth.rate if calibrated and not settings & 0x20 else None)
    assert near(sample.magnetic, truth.magnetic if calibrated and not settings & 0x40 else None)
    assert near(sample.q_earth_sensor, ORIENTATIONS[0] if computed & 4 else None)
    assert sample.temperature_c == (truth.temperature if computed & 1 else None)
    assert sample.status == (truth.status if mode & 0x800 else None)
    assert sample.counter == (truth.counter if settings & 1 else None)


@pytest.mark.parametrize("mode", [*MODES, *RAW_MODES], ids=hex)
def test_every_output_mode_is_decoded_with_settings_that_cover_each_switch(mode: int) -> None:
    """All 1536 settings for the modes that they change; a seventh of them for the others."""
    step = 1 if mode in (0x0006, 0x000F, 0x183F) else 7
    for settings in SETTINGS[mode % step :: step]:
        check(mode, settings, MtDataDecoder(mode, settings))


@pytest.mark.parametrize(
    ("number_format", "value", "expected"),
    [
        (1, 1.5, "00180000"), (1, -2.25, "FFDC0000"), (1, 9.81, "009CF5C3"),
        (2, 1.5, "800000000001"), (2, -2.25, "C0000000FFFD"), (2, 90, "00000000005A"),
        (2, -0.34, "A8F5C28FFFFF"),
    ],
)  # fmt: skip
def test_fixed_numbers_of_the_sheet(number_format: int, value: float, expected: str) -> None:
    assert slow_number(value, number_format) == bytes.fromhex(expected)
    sample = MtDataDecoder(0x0001, number_format << 8).decode(bytes.fromhex(expected))
    assert isinstance(sample, MtSample)
    assert sample.temperature_c == pytest.approx(value, abs=1e-6)


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


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e30])
def test_values_that_no_device_measures_make_a_bad_frame(value: float) -> None:
    data = bytearray(EULER_FRAME[4:-1])
    data[12:16] = struct.pack(">f", value)
    assert isinstance(MtDataDecoder(6, 5).decode(bytes(data)), BadFrame)
