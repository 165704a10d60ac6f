"""What the LMS111's telegrams become: used beams, their bearings and times, one echo or two."""

import math
from dataclasses import replace

import numpy as np
import pytest

from core.records import Scan
from fakes.lms1xx.scan import Channel
from tests.support.scripted_lms111 import Bench


def one_scan(**changes: object) -> Scan:
    return Bench(**changes).run(0.5)[0]


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


@pytest.mark.parametrize("is_sent", [True, False], ids=["two echoes", "one echo"])
@pytest.mark.parametrize("echo", ["first", "last", "both"])
def test_the_second_echo_is_a_row_of_its_own_or_fills_in_or_is_missing(
    echo: str, is_sent: bool
) -> None:
    bench = Bench(echo=echo)
    third = np.arange(541) % 3 == 0  # the beams that have one
    if is_sent:
        second_mm = np.where(third, 5000, 0).astype(np.uint16)
        bench.fake.channels.append(Channel(b"DIST2", second_mm, -450_000, 5000))
    ranges_m = bench.run(0.5)[0].ranges_m
    first_m = one_scan().ranges_m[0]
    second_m = np.where(third & is_sent, 5.0, np.nan)
    expected = {
        "first": [first_m],
        "last": [np.where(np.isnan(second_m), first_m, second_m)],
        "both": [first_m, second_m],
    }[echo]
    assert ranges_m.flags.c_contiguous
    np.testing.assert_array_equal(ranges_m, expected)
    assert bool(bench.cause) is (echo != "first" and not is_sent)


def test_a_scan_without_a_used_beam_is_rejected_and_said() -> None:
    bench = Bench(first_deg=10.0, last_deg=20.0)
    bench.fake.channels = [replace(bench.fake.channels[0], first=900_000)]
    assert not bench.run(0.5)
    assert bench.cause == "the scanner sends 90 to 360 deg only"
    assert bench.lms.status.rejections[0].reason.endswith("in the used field of view")
