"""The fake MTi against the frames and the conversation of its sheet."""

import math
import struct
from itertools import pairwise

import numpy as np
import pytest

from fakes.mti.device import FakeMti, State
from fakes.mti.messages import Sample
from tests.support.devices.bench_mti import RATE_RADPS, Bench, counters, frames, messages
from tests.support.devices.mti_frames import configuration, framed, wire


def test_the_start_up_conversation_of_the_sheet_comes_byte_for_byte() -> None:
    before, after = configuration("0012 0004 00000001"), configuration("0032 0006 00000005")
    assert (before[-1], after[-1]) == (0xCB, 0xA5)  # as printed
    bench = Bench()
    bench.write(b"")
    assert bench.write(wire("GoToConfig")).endswith(wire("GoToConfigAck"))
    for request, answer in [
        (wire("GoToConfig"), wire("GoToConfigAck")),
        (wire("ReqDID"), wire("DeviceID")),
        (wire("ReqProductCode"), wire("ProductCode")),
        (wire("ReqFWRev"), wire("FirmwareRev")),
        (wire("ReqConfiguration"), before),
        (wire("SetOutputMode"), wire("SetOutputModeAck")),
        (wire("SetOutputSettings"), wire("SetOutputSettingsAck")),
        (wire("SetPeriod"), wire("SetPeriodAck")),
        (wire("SetOutputSkipFactor"), wire("SetOutputSkipFactorAck")),
        (wire("ReqOutputMode"), wire("OutputMode")),
        (wire("ReqOutputSettings"), wire("OutputSettings")),
        (wire("ReqPeriod"), wire("Period")),
        (wire("ReqConfiguration"), after),
        (wire("ReqDataLength"), wire("DataLength")),
    ]:
        assert bench.write(request) == answer, request.hex()
    assert bench.write(wire("GoToMeasurement"), 0.002) == wire("GoToMeasurementAck")
    bench.fake.counter = 0x1234
    assert bench.write(b"", 0.02) == wire("MTData 0006 00000005")


def test_each_other_frame_of_the_sheet_gets_the_printed_answer() -> None:
    bench = Bench()
    bench.write(wire("GoToConfig"))
    for request, answer in [
        (wire("ReqBaudrate"), wire("Baudrate")),
        (wire("SetBaudrate", 0), wire("SetBaudrateAck")),
        (wire("SetBaudrate", 1), wire("SetBaudrateAck")),
        (wire("ResetOrientation", 2), wire("ResetOrientationAck")),
        (wire("ReqScenario"), wire("Scenario")),
        (wire("SetScenario"), wire("SetScenarioAck")),
        (wire("SetHeading"), wire("SetHeadingAck")),
        (framed(0x82), framed(0x83, struct.pack(">f", 0.5))),
        (wire("SetErrorMode"), framed(0xDB)),
        (framed(0x84, b"\1\2"), framed(0x85)),
        (framed(0x84), framed(0x85, b"\1\2")),
        (framed(0x02), framed(0x03, bytes.fromhex("00300D2A"))),
        (wire("RestoreFactoryDef"), framed(0x0F)),
        (framed(0x84), framed(0x85, b"\0\0")),
    ]:
        assert bench.write(request) == answer, request.hex()
    assert bench.write(bytes.fromhex("FA 01 00 00 FF"))[:3] == b"\xfa\x01\x01"  # bus id 1
    [(mid, scenarios)] = frames(bench.write(wire("ReqAvailableScenarios")))
    assert (mid, len(scenarios)) == (0x63, 110)
    assert scenarios[:2] == b"\3\x08"
    assert bench.write(framed(0x24), 0.9) == b""
    assert bench.write(b"", 0.2) == framed(0x25, b"\x01\xff")


@pytest.mark.parametrize(
    ("request_", "code"),
    [
        (wire("ReqOutputConfiguration"), 4),  # tells a legacy device
        (wire("SetOutputConfiguration"), 4),
        (framed(0x8E, b"\0\0"), 4),
        (framed(0x1E), 4),
        (framed(0x55), 4),
        (framed(0x31), 4),
        (wire("ReqData"), 4),
        (framed(0x04, struct.pack(">H", 224)), 3),
        (framed(0x04, b"\1"), 0x21),
        (framed(0x18, b"\x0c"), 0x20),
        (framed(0x64, b"\0\x09"), 0x21),
        (framed(0x82, struct.pack(">f", 3.2)), 0x21),
        (framed(0x82, struct.pack(">f", math.nan)), 0x21),
        (framed(0xA4, b"\0\1"), 0x21),  # only while measuring
        (framed(0xD0, b"\x00\x10"), 0x21),  # position
        (framed(0xD0, b"\x40\x04"), 0x21),  # raw
        (framed(0xD2, b"\x80\0\0\1"), 0x21),  # NED: MTi-G
        (framed(0xD2, b"\0\0\0\x0c"), 0x21),
        (framed(0xDA, b"\0\4"), 0x21),
        (framed(0x00, b"\0"), 0x21),
    ],
)
def test_what_it_does_not_take_gets_an_error(request_: bytes, code: int) -> None:
    bench = Bench()
    bench.write(wire("GoToConfig"))
    before = bench.write(wire("ReqConfiguration"))
    assert bench.write(request_) == framed(0x42, bytes([code]))
    assert bench.write(wire("ReqConfiguration")) == before


@pytest.mark.parametrize(
    ("name", "mode", "settings", "angles_deg", "counter"),
    [
        ("MTData 0806 00000005", 0x0806, 0x005, (1.5, -2.25, 90.0), 0x1235),
        ("MTData 0004 00000001", 0x0004, 0x001, (0.0, 0.0, 90.0), 0),
        ("MTData 0004 00000105", 0x0004, 0x105, (1.5, -2.25, 90.0), 0x1236),
        ("MTData 0004 00000205", 0x0004, 0x205, (1.5, -2.25, 90.0), 0x1237),
        ("MTData 0004 00000005", 0x0004, 0x005, (1.0, 0.0, 0.0), 64255),
    ],
)
def test_each_data_message_of_the_sheet_comes_byte_for_byte(
    name: str, mode: int, settings: int, angles_deg: tuple[float, float, float], counter: int
) -> None:
    bench = Bench(*angles_deg)
    mode_set, settings_set = struct.pack(">H", mode), struct.pack(">I", settings)
    bench.configure(framed(0xD0, mode_set), framed(0xD2, settings_set))
    bench.fake.counter = counter
    assert bench.write(b"", 0.02) == wire(name)


def test_it_is_found_streaming_as_shipped_and_ignores_what_belongs_to_config() -> None:
    bench = Bench()
    bench.fake.exchange(bench.now_s, wire("ReqDID") + wire("SetOutputMode") + framed(0x55))
    heard = bench.listen(1.0)
    assert {(mid, len(data)) for mid, data in heard} == {(0x32, 18)}
    assert len(heard) == pytest.approx(100, abs=1)


def test_samples_are_at_exact_periods_and_come_after_latency_and_line() -> None:
    bench = Bench()
    bench.fake.drift_ppm = -500.0
    bench.configure(wire("SetOutputMode"), wire("SetOutputSettings"))
    bench.sampled_s.clear()
    pieces = bench.pieces(0.5, 0.0001)
    stream = b"".join(data for _, data in pieces)
    assert max(len(data) for _, data in pieces) <= 2  # 1.15 bytes in a step
    arrivals_s = [came_s for came_s, data in pieces for _ in data]
    last_bytes_s = arrivals_s[54::55]
    assert stream[0::55] == b"\xfa" * len(stream[0::55])
    steps_s = np.diff(bench.sampled_s)
    np.testing.assert_allclose(steps_s, 0.01 / (1 - 500e-6), rtol=1e-9)
    for sampled_s, came_s in zip(bench.sampled_s, last_bytes_s, strict=False):
        assert 0 <= came_s - sampled_s - 0.00255 - 550 / 115200 < 0.00011


def test_period_skip_factor_and_baud_rate_are_as_set() -> None:
    bench = Bench()
    bench.configure(framed(0x04, struct.pack(">H", 2304)))
    assert len(bench.listen(1.0)) == pytest.approx(50, abs=1)
    bench.configure(framed(0xD4, b"\0\4"))
    data = messages(bench.listen(1.0))
    assert len(data) == pytest.approx(10, abs=1)
    assert {b - a for a, b in pairwise(counters(data))} == {1}
    bench.configure(framed(0xD4, b"\xff\xff"))  # only on request
    assert not bench.listen(0.5)
    assert [mid for mid, _ in frames(bench.write(wire("ReqData")))] == [0x32]
    assert not bench.listen(0.5)
    bench.configure(wire("SetBaudrate", 1))
    assert bench.fake.baud == 115200
    bench.fake.power_up(bench.now_s)
    bench.write(b"", 0.01)
    assert bench.fake.baud == 921600


def test_after_power_up_it_waits_for_the_host_and_a_wake_up_ack_leads_to_config() -> None:
    bench = Bench()
    bench.configure(wire("SetOutputMode"), wire("SetOutputSettings"))
    bench.fake.power_up(bench.now_s)
    assert bench.write(b"", 0.01) == wire("WakeUp")
    assert bench.write(wire("GoToConfig"), 0.4) == b""
    heard = bench.listen(0.5)
    assert [(mid, len(data)) for mid, data in heard[:3]] == [(0x0D, 118), (0x91, 1320), (0x32, 50)]
    bench.fake.power_up(bench.now_s)
    assert bench.write(b"", 0.3) == wire("WakeUp")
    assert bench.write(wire("WakeUpAck"), 1.0) == b""
    assert bench.fake.state is State.CONFIG
    assert bench.write(wire("ReqOutputMode")) == wire("OutputMode")  # all settings are kept
    assert bench.write(wire("ReqOutputSettings")) == wire("OutputSettings")
    assert bench.write(wire("Reset"), 0.2) == wire("ResetAck") + wire("WakeUp")
    assert counters(messages(bench.listen(0.8)))[0] < 30


def test_heading_reset_makes_yaw_zero_until_power_up_unless_stored() -> None:
    bench = Bench()
    bench.configure(framed(0xD2, bytes.fromhex("00000305")))

    def euler_deg() -> tuple[float, ...]:
        return struct.unpack(">3d", messages(bench.listen(0.05))[-1][:24])

    assert euler_deg() == pytest.approx((1.5, -2.25, 90.0))
    bench.write(wire("ResetOrientation", 0))
    assert euler_deg() == pytest.approx((1.5, -2.25, 0.0), abs=1e-9)
    bench.fake.power_up(bench.now_s)
    bench.listen(1.0)
    assert euler_deg() == pytest.approx((1.5, -2.25, 90.0))
    bench.write(wire("ResetOrientation", 1))  # alignment: level as well
    assert euler_deg() == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    bench.configure(wire("ResetOrientation", 2))  # stored
    bench.fake.power_up(bench.now_s)
    bench.listen(1.0)
    assert euler_deg() == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    bench.configure(framed(0x0E), framed(0xD2, bytes.fromhex("00000305")))
    bench.configure(framed(0x82, struct.pack(">f", -0.5)))
    assert euler_deg()[2] == pytest.approx(90 - math.degrees(0.5), abs=1e-5)


def test_a_model_that_there_is_not_is_refused() -> None:
    with pytest.raises(ValueError, match="model must be one of MTi-28"):
        Bench(model="MTi-99")


def test_noise_has_its_size_and_follows_the_seed() -> None:
    bench = Bench()

    def samples(seed: int) -> list[Sample]:
        fake = FakeMti(bench.motion_at, seed)
        return [fake.sensor.sample(0.01 * k) for k in range(1000)]

    rates, again = (np.array([sample.rate_radps for sample in samples(1)]) for _ in range(2))
    np.testing.assert_array_equal(rates, again)
    np.testing.assert_allclose(rates.std(axis=0), math.radians(0.3), rtol=0.1)
    np.testing.assert_allclose(rates.mean(axis=0), RATE_RADPS, atol=5e-4)
    traces = np.array([np.trace(bench.R.T @ sample.R_earth_sensor) for sample in samples(1)])
    spread_rad = np.arccos((traces - 1) / 2)
    assert np.sqrt((spread_rad**2).mean()) == pytest.approx(math.radians(0.05 * 3**0.5), rel=0.1)
