"""The fake LMS111 with hosts that do things in their own order, or in no order at all."""

import re
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fakes.lms1xx.device import FakeLms111
from tests.support.bench_lms111 import (
    FRAMES,
    TEXTS,
    Bench,
    counters,
    five_metres,
    framed,
    payloads,
    raw_of,
)

STX, ETX = b"\x02", b"\x03"


def text_bench() -> Bench:
    """A fake that speaks CoLa-A."""
    bench = Bench()
    bench.fake.binary = False
    return bench


def test_a_driver_that_waits_for_ready_and_sends_run_after_that_gets_its_scans() -> None:
    bench = text_bench()

    def asked(command: str) -> str:
        answer = bench.ask(STX + command.encode() + ETX, 0.05)
        assert answer.count(STX) == answer.count(ETX) == 1
        assert len(answer) <= 100  # as many as it reads at once
        return answer[1:-1].decode()

    assert asked("sMN SetAccessMode 03 F4724744").endswith(" 1")
    assert asked("sMN mLMPsetscancfg +2500 +1 +2500 -450000 +2250000").split()[2] == "0"
    assert asked("sRN LMPscancfg").split()[2:5] == ["9C4", "1", "9C4"]
    assert asked("sWN LMDscandatacfg 01 00 0 0 0 00 00 0 0 0 0 +1") == "sWA LMDscandatacfg"
    assert asked("sRN LMPoutputRange") == TEXTS["range is"].decode()
    assert asked("sMN LMCstartmeas") == "sAN LMCstartmeas 0"
    for _ in range(20):
        if asked("sRN STlms").startswith("sRA STlms 7"):
            break
    assert asked("sRN STlms").startswith("sRA STlms 7 0 8 00:00:")
    assert asked("sMN Run") == "sAN Run 1"
    assert bench.ask(b"\x02sEN LMDscandata 1\x03", 0.002) == b"\x02sEA LMDscandata 1\x03"
    found = re.findall(rb"\x02sSN LMDscandata [^\x02\x03]*\x03", bench.ask(b"", 0.5))
    assert len(found) == pytest.approx(12, abs=1)
    assert {scan.split(b" ")[25] for scan in found} == {b"439"}


def test_standby_stops_the_mirror_and_starting_needs_no_second_login() -> None:
    bench = Bench()
    bench.start()
    assert bench.scans(0.2)
    assert b"sFA\0\1" in payloads(bench.ask(FRAMES["stop"]))
    bench.ask(FRAMES["login"])
    for command, state in (("start", 4), ("standby", 2), ("start", 4), ("stop", 2)):
        bench.ask(FRAMES[command])
        assert bench.fake.state == state


def test_no_more_hosts_get_in_than_it_has_room_for() -> None:
    fake = FakeLms111(five_metres, 1)
    fake.max_clients = 2
    one, two = fake.connect(0.0), fake.connect(0.0)
    assert one is not None
    assert two is not None
    assert fake.connect(0.1) is None
    two.left(0.2)
    two.left(0.2)
    three = fake.connect(0.3)
    assert three is not None
    three.exchange(0.3, FRAMES["read scan"])
    assert (one.exchange(0.4, b""), three.exchange(0.4, b"")) == (b"", FRAMES["scan is 50"])


def test_after_power_up_hosts_are_refused_then_not_heard_then_served() -> None:
    fake = FakeLms111(five_metres, 1)
    fake.refuse_connections_s, fake.start_silent_s = 5.0, 10.0
    fake.exchange(100.0, b"")
    assert fake.connect(104.9) is None
    client = fake.connect(105.0)
    assert client is not None
    client.exchange(109.0, FRAMES["read scan"])
    assert client.exchange(109.5, b"") == b""
    client.exchange(110.0, FRAMES["read scan"])
    assert client.exchange(110.1, b"") == FRAMES["scan is 50"]
    fake.reboot(111.0)
    assert fake.connect(115.0) is None


def test_filters_are_kept_as_other_settings_are() -> None:
    bench = Bench()
    on, read = framed("sWN LFPmeanfilter ", b"\1\0\x0a\0"), framed("sRN LFPmeanfilter")
    for stored, kept in ((b"", b"\0\0\2\0"), (FRAMES["store"], b"\1\0\x0a\0")):
        bench.ask(FRAMES["login"])
        assert bench.ask(on) == framed("sWA LFPmeanfilter ")
        bench.ask(stored)
        bench.fake.reboot(bench.now_s)
        assert bench.ask(read) == framed("sRA LFPmeanfilter ", kept)
    assert bench.fake.stores == 1
    assert bench.fake.mean_scans == 10


@pytest.mark.parametrize(
    ("name", "values"),
    [("LFPmeanfilter", b"\1\0\1\0"), ("LFPmeanfilter", b"\1\0\x65\0"), ("LFPnto1filter", b"\2"),
     ("MSsuppmode", b"\2"), ("EIHstCola", b"\2")],
)  # fmt: skip
def test_values_that_it_cannot_take_are_refused(name: str, values: bytes) -> None:
    bench = Bench()
    bench.ask(FRAMES["login"])
    assert bench.ask(framed(f"sWN {name} ", values)) == FRAMES["condition failed"]


def test_an_honest_model_tells_the_step_of_its_output() -> None:
    bench = Bench()
    bench.fake.untrue_output_step = False
    bench.ask(FRAMES["login"])
    bench.ask(FRAMES["scan 25"])
    [answer] = payloads(bench.ask(FRAMES["read range"]))
    assert answer[-14:] == struct.pack(">HIii", 1, 2500, -450_000, 2_250_000)


def test_a_scan_that_is_asked_for_twice_is_the_same_scan() -> None:
    bench = Bench()
    bench.start(FRAMES["scan 25"])
    bench.ask(FRAMES["unsubscribe"], 1.01)
    polls = [payloads(bench.ask(FRAMES["poll"], 0.002))[0] for _ in range(2)]
    assert polls[0] == polls[1]
    assert polls[0].startswith(b"sRA LMDscandata ")


def test_the_ordered_status_and_the_filtered_beams_are_told() -> None:
    bench = Bench()
    bench.fake.device_status, bench.fake.in_error, bench.fake.filtered_rate = 1, True, 1.0
    bench.fake.settling_scans = 0
    bench.start()
    scan = bench.scans(0.1)[0]
    assert scan[24:26] == b"\0\1"
    assert set(raw_of(scan)) == {3}
    [state] = [p for p in payloads(bench.ask(FRAMES["read device state"])) if b"SCdev" in p]
    assert state == b"sRA SCdevicestate \2"


def test_a_telegram_with_every_third_scan_is_filtered_over_every_scan() -> None:
    seen: list[int] = []

    def ramp(t_first_s: float, times_s: object, bearings_rad: object) -> object:
        seen.append(len(seen))
        return five_metres(t_first_s, times_s, bearings_rad)  # type: ignore[arg-type]

    bench = Bench(ramp)  # type: ignore[arg-type]
    every_third = framed(
        "sWN LMDscandatacfg ", bytes.fromhex("0100 00 00 00 0000 00 00 00 00 0003")
    )
    bench.start(every_third, framed("sWN LFPnto1filter ", b"\1"))
    scans = bench.scans(0.5)
    assert len(seen) > 2 * len(scans)
    assert counters(scans)[1] - counters(scans)[0] == 3
    assert set(raw_of(scans[0])) == {3}  # the first sweep of all
    assert min(raw_of(scans[1])) > 4000


ORDERS = st.lists(
    st.sampled_from(sorted(set(FRAMES) - {"scan A", "scan B", "reboot"})), max_size=25
)


@settings(max_examples=40)
@given(ORDERS, st.floats(0.02, 0.7))
def test_in_any_order_each_command_gets_one_answer_or_refusal(
    names: list[str], wait_s: float
) -> None:
    bench = Bench()
    for name in names:
        command = payloads(FRAMES[name])[0]
        if command[:3] not in (b"sRN", b"sWN", b"sMN", b"sEN"):
            continue
        heard = payloads(bench.ask(FRAMES[name], wait_s))
        answers = [payload for payload in heard if not payload.startswith(b"sSN")]
        [answer] = answers
        is_refusal = answer.startswith(b"sFA") and len(answer) == 5
        assert is_refusal or answer.split(b" ")[1] == command.split(b" ")[1]


@settings(max_examples=40)
@given(st.lists(st.sampled_from(sorted(TEXTS)), max_size=20))
def test_in_any_order_each_text_gets_one_answer_or_refusal(names: list[str]) -> None:
    bench = text_bench()
    for name in names:
        if TEXTS[name][:3] not in (b"sRN", b"sWN", b"sMN"):
            continue
        answer = bench.ask(STX + TEXTS[name] + ETX)
        assert re.fullmatch(rb"\x02(sFA [0-9A-F]+|s[RWA][AN] [^\x02\x03]+)\x03", answer)
