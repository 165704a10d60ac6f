"""The fake LMS111 with faults, each by one attribute."""

from itertools import pairwise

import pytest

from tests.support.bench_lms111 import Bench, counters, payloads, raw_of, scans_of
from tests.support.lms111_vectors import FRAMES, framed


def test_mute_swallows_what_it_says_and_not_what_it_hears() -> None:
    bench = Bench(mute=True)
    bench.start()
    assert not bench.listen(0.2)
    bench.fake.mute = False
    assert bench.scans(0.1)


def test_frozen_repeats_one_telegram() -> None:
    bench = Bench()
    bench.start()
    last = bench.listen(0.1)[-1]
    bench.fake.frozen = True
    assert set(bench.listen(0.2)) == {last}
    bench.fake.frozen = False
    assert counters(bench.scans(0.1))[0] == counters(scans_of(framed(last)))[0] + 11


def test_late_delays_every_byte() -> None:
    bench = Bench()
    bench.start()
    before = bench.scans(0.1)
    bench.fake.late_s = 0.15
    assert not bench.scans(0.145)
    assert counters(bench.scans(0.1))[0] == counters(before)[-1] + 1
    assert not bench.ask(FRAMES["unsubscribe"]).endswith(FRAMES["unsubscribed"])


def test_a_refused_command_gets_the_code_that_was_ordered() -> None:
    bench = Bench(refuse={"sWN LMPoutputRange": 0x0A, "DeviceIdent": 3})
    bench.ask(FRAMES["login"])
    assert bench.ask(FRAMES["write range"]) == FRAMES["write denied"]
    assert b"sRA" in bench.ask(FRAMES["read range"])
    assert bench.ask(framed("sRN DeviceIdent")) == FRAMES["unknown variable"]


def test_answers_can_be_lost_late_cut_short_or_damaged() -> None:
    bench = Bench(answers_lost=1)
    assert bench.ask(FRAMES["login"]) == b""
    assert bench.ask(FRAMES["write content"]) == FRAMES["content written"]  # it had obeyed
    bench.fake.slow_answer_s = 0.5
    assert bench.ask(FRAMES["read scan"], 0.4) == b""
    assert bench.ask(b"", 0.2) == FRAMES["scan is 50"]
    bench.fake.slow_answer_s, bench.fake.cut_next = 0.0, True
    cut = bench.ask(FRAMES["read scan"])
    assert FRAMES["scan is 50"].startswith(cut)
    assert 0 < len(cut) < len(FRAMES["scan is 50"])
    bench.fake.wrong_checksum_rate = 1.0
    good = FRAMES["scan is 50"]
    assert bench.ask(FRAMES["read scan"]) == good[:-1] + bytes([good[-1] ^ 0xFF])
    bench.fake.deaf = True
    assert bench.ask(FRAMES["read scan"]) == b""


def test_dropped_scans_are_missing_in_the_scan_counter() -> None:
    bench = Bench(drop_rate=0.3)
    bench.start()
    steps = {b - a for a, b in pairwise(counters(bench.scans(2.0)))}
    assert {1, 2} <= steps
    assert 0 not in steps


def test_after_a_hold_up_it_does_not_make_up_for_what_it_could_not_keep() -> None:
    bench = Bench()
    bench.start()
    bench.now_s += 1e6
    assert len(payloads(bench.fake.exchange(bench.now_s, b""))) == 45


@pytest.mark.parametrize(("fault", "code"), [("dazzled_rate", 1), ("implausible_rate", 2)])
def test_bad_light_is_told_by_its_code(fault: str, code: int) -> None:
    bench = Bench()
    setattr(bench.fake, fault, 0.25)
    bench.start()
    codes = raw_of(bench.scans(1.0)[0])
    assert 0.15 * 541 < codes.count(code) < 0.35 * 541


def test_the_ordered_status_and_the_filtered_beams_are_told() -> None:
    bench = Bench(device_status=1, in_error=True, filtered_rate=1.0, settling_scans=0)
    bench.start()
    scan = bench.scans(0.1)[0]
    assert scan.status == (0, 1)
    assert set(raw_of(scan)) == {3}
    [state] = [p for p in payloads(bench.ask(FRAMES["read device state"])) if b"SCdev" in p]
    assert state == b"sRA SCdevicestate \2"


def test_a_dirty_window_is_told_when_asked_and_changes_no_undocumented_byte_of_a_scan() -> None:
    bench = Bench(contamination=2, settling_scans=1)
    bench.start()
    assert [scan.status for scan in bench.scans(0.06)] == [(1, 0), (0, 0), (0, 0)]
    bench.ask(FRAMES["unsubscribe"])
    assert bench.ask(FRAMES["read contamination"]) == framed("sRA LCMstate ", b"\2")
