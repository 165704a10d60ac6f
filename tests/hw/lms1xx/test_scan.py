"""What the LMS111's telegrams become: used beams, their bearings and times, one echo or two."""

import math
import struct

import numpy as np
import pytest

from core.records import Scan
from hw.lms1xx.scan import POOL, RangePool
from tests.support.scripted_lms111 import Bench


def one_scan(**changes: object) -> Scan:
    scans = Bench(**changes).run(0.5)
    return scans[0]


def test_only_the_used_beams_are_delivered_each_at_its_bearing_and_time() -> None:
    whole, part = one_scan(), one_scan(first_deg=30.0, last_deg=150.0)
    assert part.ranges_m.shape == (1, 241)
    assert part.ranges_m.flags.c_contiguous
    np.testing.assert_array_equal(part.ranges_m[0], whole.ranges_m[0, 150:391])
    assert part.first_rad == pytest.approx(math.radians(-60))
    assert part.first_rad + 240 * part.step_rad == pytest.approx(math.radians(60))
    assert part.t_s - whole.t_s == pytest.approx(150 * whole.beam_dt_s)
    assert part.arrived_s == whole.arrived_s


def test_an_angle_between_beams_takes_the_beams_inside() -> None:
    scan = one_scan(first_deg=29.8, last_deg=31.2)
    assert scan.ranges_m.shape == (1, 3)
    assert scan.first_rad == pytest.approx(math.radians(-60))


def test_a_sweep_ends_no_later_than_its_transmission_begins() -> None:
    scan = one_scan()
    assert scan.t_s + 540 * scan.beam_dt_s <= scan.arrived_s + 1e-9
    bench = Bench()
    bench.fake.late_stamp_us = 40_000  # a device that buffers: its stamp is to be believed
    early = bench.run(0.5)[0]
    assert early.t_s == pytest.approx(early.arrived_s - 0.04, abs=0.006)


def test_the_second_echo_is_a_row_of_its_own_or_fills_in_or_is_missing() -> None:
    both, last = one_scan(echo="both"), one_scan(echo="last")
    assert both.ranges_m.shape == (2, 541)
    assert both.ranges_m.flags.c_contiguous
    assert np.isnan(both.ranges_m[1]).all()  # the recorded scan has one echo
    np.testing.assert_array_equal(both.ranges_m[0], last.ranges_m[0])


def with_second_echo(payload: bytes) -> bytes:
    """The recorded scan with a DIST2: 5 m at every third beam, nothing at the others."""
    raw = struct.pack(">541H", *(5000 if i % 3 == 0 else 0 for i in range(541)))
    end = 54 + 2 + 21 + 1082
    block = b"DIST2" + payload[61:77] + raw
    return payload[:54] + b"\x00\x02" + payload[56:end] + block + payload[end:]


@pytest.mark.parametrize("echo", ["first", "last", "both"])
def test_two_echoes_are_told_apart(echo: str) -> None:
    bench = Bench(echo=echo)
    bench.fake._scan = with_second_echo(bench.fake._scan)
    scan = bench.run(0.5)[0]
    first = one_scan().ranges_m[0]
    third = np.arange(541) % 3 == 0
    second = np.where(third, 5.0, np.nan)
    expected = {
        "first": [first],
        "last": [np.where(third, 5.0, first)],
        "both": [first, second],
    }[echo]
    np.testing.assert_array_equal(scan.ranges_m, expected)
    assert bench.lms.status.cause == ""


def test_a_scan_without_a_used_beam_is_rejected_and_said() -> None:
    bench = Bench(first_deg=10.0, last_deg=20.0)
    shifted = bytearray(bench.fake._scan)
    shifted[69:73] = struct.pack(">i", 900_000)  # it begins at 90 deg
    bench.fake._scan = bytes(shifted)
    assert not bench.run(0.5)
    assert bench.lms.status.cause == "the scanner sends 90 to 360 deg only"
    assert bench.lms.status.rejections[0].reason.endswith("in the used field of view")


def test_ranges_taken_from_the_pool_stay_until_it_went_round() -> None:
    pool = RangePool(10)
    one, two, three = pool.take(1, 4), pool.take(2, 3), pool.take(1, 5)
    one[:], two[:] = 1, 2
    assert (one.shape, two.shape, three.shape) == ((1, 4), (2, 3), (1, 5))
    three[:] = 3
    assert (two[0, 1:] == 2).all()
    assert one[0, 0] == 3
    assert POOL >= 4 * 65_536  # one read of bytes, all of them one-byte values, four times over
