"""The fake LMS111 in CoLa-A, its models, what it measures; its faults, each by one attribute."""

import numpy as np
import pytest

from fakes.lms1xx.device import FakeLms111
from tests.support.devices.bench_lms111 import (
    F64,
    Bench,
    counters,
    five_metres,
    payloads,
    raw_of,
    scans_of,
)
from tests.support.devices.lms111_vectors import FRAMES, TEXTS, framed, texted


def test_each_answer_printed_in_the_sheet_comes_as_text() -> None:
    bench = Bench(binary=False)
    for command, answer in (
        (TEXTS["write range 180"], TEXTS["write denied"]),
        (TEXTS["login"], b"sAN SetAccessMode 1"),
        (TEXTS["scan 50"], TEXTS["scan 50 taken"]),
        (TEXTS["read scan"], TEXTS["scan is 50"]),
        (TEXTS["write content rssi"], b"sWA LMDscandatacfg"),
        (TEXTS["set time"], b"sAN LSPsetdatetime 1"),
        (b"sRN LocationName", TEXTS["location"]),
        (b"sRN DeviceIdent", TEXTS["ident"]),
        (b"sRI 0", b"sRA 0 10 LMS10x_FieldEval 10 V1.36-21.10.2010"),
        (b"sRN FirmwareVersion", b"sRA FirmwareVersion 9 V1.80.2  "),
        (b"sRN LMPoutputRange", TEXTS["range is"]),
        (b"sWN LMPoutputRange 1 1388 0 1B7740", b"sWA LMPoutputRange"),
        (b"sRN LMPoutputRange", b"sRA LMPoutputRange 1 1388 0 1B7740"),
    ):
        assert bench.say(command.decode()) == answer.decode()


@pytest.mark.parametrize(
    ("command", "refusal"),
    [
        ("sMN mLMPsetscancfg +5000 +1", "sFA 8"),
        ("sMN mLMPsetscancfg +5000 +1 +5000 -450000 +2250000 1", "sFA 7"),
        ("sMN mLMPsetscancfg +5000 +1 +5x00 -450000 +2250000", "sFA 11"),
        ("sMN mLMPsetscancfg \x00\x01", "sFA 11"),
        ("sMN mLMPsetscancfg x00x01", "sFA 11"),
        ("sMN mLMPsetscancfg +5000 +99999 +5000 -450000 +2250000", "sFA 10"),
        # without a sign it is hexadecimal: 0x5000 is neither a frequency nor a step
        ("sMN mLMPsetscancfg 5000 1 5000 -450000 +2250000", "sAN mLMPsetscancfg 3 "),
        ("sWN LMPoutputRange 1 1388 0 FFFFFFF0", "sFA 4"),
        ("garbage", "sFA 11"),
        ("sRN FREchoFilter", "sFA 3"),
    ],
)
def test_what_is_wrong_in_a_text_is_refused_by_its_code(command: str, refusal: str) -> None:
    bench = Bench(binary=False)
    bench.say("sMN SetAccessMode 3 F4724744")
    answer = bench.say(command)
    assert answer == refusal if refusal.startswith("sFA") else answer.startswith(refusal)


def test_each_dialect_is_deaf_to_the_other() -> None:
    assert Bench(binary=False).ask(FRAMES["read scan"], 1.0) == b""
    assert Bench().ask(texted("sRN LMPscancfg"), 1.0) == b""


def test_a_new_dialect_counts_from_the_next_connection_and_may_take_its_time() -> None:
    bench = Bench(dialect_change_s=20.0)
    bench.ask(FRAMES["login"])
    assert bench.ask(FRAMES["set ascii"]) == framed("sWA EIHstCola ")  # still in the old one
    bench.fake.reconnected(bench.now_s)
    assert bench.ask(FRAMES["read scan"]) == FRAMES["scan is 50"]
    bench.now_s += 20.0
    bench.ask(b"")
    bench.fake.reconnected(bench.now_s)
    assert bench.say("sRN EIHstCola") == "sRA EIHstCola 0"


def test_models_differ_as_the_sheet_says() -> None:
    bench = Bench(model="LMS100-1.23")
    bench.ask(FRAMES["login"])
    assert bench.ask(FRAMES["write range"]) == FRAMES["write denied"]
    assert b"V1.23" in bench.ask(framed("sRN FirmwareVersion"))
    with pytest.raises(ValueError, match="must be one of LMS111, LMS100"):
        FakeLms111(five_metres, 1, model="LMS999")


def test_a_scan_that_is_asked_for_twice_is_the_same_scan() -> None:
    bench = Bench()
    bench.start(FRAMES["scan 25"])
    bench.ask(FRAMES["unsubscribe"], 1.01)
    polls = [payloads(bench.ask(FRAMES["poll"], 0.002))[0] for _ in range(2)]
    assert polls[0] == polls[1]
    assert polls[0].startswith(b"sRA LMDscandata ")


def test_a_second_echo_is_sent_where_there_is_one() -> None:
    def two_echoes(t_first_s: float, times_s: F64, bearings_rad: F64) -> F64:
        return np.array([np.full(len(times_s), 2.0), np.full(len(times_s), 6.0)])

    bench = Bench(two_echoes, noise_m=0.0)
    bench.start(FRAMES["write content all"])
    scan = bench.scans(1.0)[10]
    assert (set(raw_of(scan)), set(raw_of(scan, "DIST2"))) == ({2000}, {6000})


@pytest.mark.parametrize(
    ("filter_on", "code"),
    [(framed("sWN LFPnto1filter ", b"\1"), 3), (framed("sWN LFPmeanfilter ", b"\1\0\2\0"), 4000)],
    ids=["n to 1", "mean"],
)
def test_the_filters_filter(filter_on: bytes, code: int) -> None:
    odd = iter(range(10_000))

    def blinking(t_first_s: float, times_s: F64, bearings_rad: F64) -> F64:
        return np.full(len(times_s), 3.0 if next(odd) % 2 else 5.0)

    bench = Bench(blinking, noise_m=0.0)
    bench.start(filter_on)
    assert {raw for scan in bench.scans(1.0)[1:3] for raw in raw_of(scan)} == {code}


def test_a_telegram_with_every_third_scan_is_filtered_over_every_scan() -> None:
    seen: list[int] = []

    def counted(t_first_s: float, times_s: F64, bearings_rad: F64) -> F64:
        seen.append(len(seen))
        return five_metres(t_first_s, times_s, bearings_rad)

    bench = Bench(counted)
    third = framed("sWN LMDscandatacfg ", bytes.fromhex("0100 00 00 00 0000 00 00 00 00 0003"))
    bench.start(third, framed("sWN LFPnto1filter ", b"\1"))
    scans = bench.scans(0.5)
    assert len(seen) > 2 * len(scans)
    assert counters(scans)[1] - counters(scans)[0] == 3
    assert set(raw_of(scans[0])) == {3}  # the first sweep of all
    assert min(raw_of(scans[1])) > 4000


def test_mute_it_measures_on_frozen_it_repeats_one_telegram_and_late_delays_every_byte() -> None:
    bench = Bench(mute=True)
    bench.start()
    assert not bench.listen(0.2)
    bench.fake.mute = False
    last = bench.listen(0.1)[-1]
    bench.fake.frozen = True
    assert set(bench.listen(0.2)) == {last}
    bench.fake.frozen = False
    before = counters(bench.scans(0.1))
    frozen_s = 0.02 * (before[0] - counters(scans_of(framed(last)))[0])
    assert frozen_s == pytest.approx(0.22, abs=0.021)
    bench.fake.late_s = 0.15
    assert not bench.scans(0.145)
    assert counters(bench.scans(0.1))[0] == before[-1] + 1
    assert not bench.ask(FRAMES["unsubscribe"]).endswith(FRAMES["unsubscribed"])


def test_answers_can_be_refused_lost_late_cut_short_or_damaged() -> None:
    bench = Bench(answers_lost=1, refuse={"sWN LMPoutputRange": 0x0A, "DeviceIdent": 3})
    assert bench.ask(FRAMES["login"]) == b""
    assert bench.ask(FRAMES["write content"]) == FRAMES["content written"]  # it had obeyed
    assert bench.ask(FRAMES["write range"]) == FRAMES["write denied"]
    assert b"sRA" in bench.ask(FRAMES["read range"])
    assert bench.ask(framed("sRN DeviceIdent")) == FRAMES["unknown variable"]
    bench.fake.slow_answer_s, good = 0.5, FRAMES["scan is 50"]
    assert bench.ask(FRAMES["read scan"], 0.4) == b""
    assert bench.ask(b"", 0.2) == good
    bench.fake.slow_answer_s, bench.fake.cut_next = 0.0, True
    assert bench.ask(FRAMES["read scan"]) == good[: len(good) // 2]
    bench.fake.wrong_checksum_rate = 1.0
    assert bench.ask(FRAMES["read scan"]) == good[:-1] + bytes([good[-1] ^ 0xFF])
    bench.fake.deaf = True
    assert bench.ask(FRAMES["read scan"]) == b""


def test_after_a_hold_up_it_does_not_make_up_for_what_it_could_not_keep() -> None:
    bench = Bench()
    bench.start()
    bench.now_s += 1e6
    assert len(payloads(bench.fake.exchange(bench.now_s, b""))) == 45


def test_bad_light_is_told_by_its_codes() -> None:
    bench = Bench(dazzled_rate=0.25, implausible_rate=0.25, filtered_rate=0.25)
    bench.start()
    codes = raw_of(bench.scans(0.1)[0])
    for code, share in ((1, 0.25 * 0.75**2), (2, 0.25 * 0.75), (3, 0.25)):
        assert codes.count(code) / 541 == pytest.approx(share, abs=0.06)


def test_its_state_is_told_when_asked_and_a_dirty_window_changes_no_byte_of_a_scan() -> None:
    bench = Bench(contamination=2, settling_scans=1)
    bench.start()
    assert [scan.status for scan in bench.scans(0.06)] == [(1, 0), (0, 0), (0, 0)]
    bench.fake.device_status, bench.fake.in_error = 1, True
    assert bench.scans(0.1)[-1].status == (0, 1)
    bench.ask(FRAMES["unsubscribe"])
    assert bench.ask(FRAMES["read contamination"]) == framed("sRA LCMstate ", b"\2")
    assert bench.ask(FRAMES["read device state"]) == framed("sRA SCdevicestate ", b"\2")
