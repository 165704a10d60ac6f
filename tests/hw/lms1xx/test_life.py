"""The life of a link to an LMS111: its dialect, its start, other hosts, silence, hostile bytes."""

from collections import Counter
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.cases import examples
from tests.support.devices.lms111_vectors import framed, texted
from tests.support.devices.scripted_lms111 import (
    CONFIGURING,
    TICK_S,
    UNKNOWN,
    WANTED,
    Bench,
    willing,
)

# --- dialect and start


@pytest.mark.parametrize("dialect", ["auto", "ascii"])
def test_a_device_that_speaks_text_is_found_and_delivers_the_same(dialect: str) -> None:
    text, packed = willing(dialect=dialect), willing()
    text.fake.is_text = True
    one, other = text.run(0.6), packed.run(0.4)
    assert (text.state, text.cause, text.lms.status.rejected) == ("running", "", 0)
    assert one[0].ranges_m.shape == (1, 541)
    assert one[0].ranges_m.tobytes() == other[0].ranges_m.tobytes()
    assert (one[0].first_rad, one[0].step_rad) == (other[0].first_rad, other[0].step_rad)


def test_the_dialect_that_answered_is_tried_first_next_time_and_may_change() -> None:
    bench = willing()
    bench.fake.is_text = True
    bench.run(0.5)
    bench.reconnect()
    sent = []
    for _ in range(3):
        bench.lms.step(bench.now_s)
        sent.append(bench.port.take())
        bench.now_s += TICK_S
    assert b"".join(sent).startswith(b"\x02sRN SCdevicestate\x03")
    bench.run(0.5)
    bench.fake.is_text = False  # somebody set EIHstCola
    bench.reconnect()
    assert bench.run(0.8)
    assert (bench.state, bench.cause) == ("running", "")


@pytest.mark.parametrize(("dialect", "is_text"), [("binary", True), ("ascii", False)])
def test_a_set_dialect_never_tries_the_other_and_the_cause_names_it(
    dialect: str, is_text: bool
) -> None:
    bench = willing(dialect=dialect)
    bench.fake.is_text = is_text
    bench.run(30.0, tick_s=0.1)
    assert bench.cause.startswith("waiting for the scanner to answer")
    bench.run(10.0, tick_s=0.1)
    other = "CoLa-A (EIHstCola 0)" if is_text else "CoLa-B (EIHstCola 1)"
    assert f"or it may be set to {other} instead of" in bench.cause
    bench.run(85.0, tick_s=0.1)
    assert bench.cause.startswith(f"the scanner does not answer: it may be set to {other}")
    assert not bench.fake.asked
    bench.fake.is_text = not is_text
    assert bench.run(1.0)


def test_one_that_speaks_neither_dialect_is_said_after_two_minutes() -> None:
    bench = willing()
    bench.fake.deaf_until_s = bench.now_s + 121.0
    bench.run(119.0, tick_s=0.1)
    assert bench.cause.startswith("waiting for the scanner to answer")
    bench.run(2.0)
    assert bench.cause == "the scanner answers in neither dialect"
    assert bench.run(1.0)


@pytest.mark.parametrize(("silent_s", "is_text"), [(30.0, False), (30.31, True)])
def test_the_first_scan_comes_within_a_second_after_a_start_that_takes_half_a_minute(
    silent_s: float, is_text: bool
) -> None:
    bench = willing()
    bench.fake.is_text = is_text
    bench.fake.deaf_until_s = bench.now_s + silent_s
    assert not bench.run(silent_s, tick_s=0.01)
    assert bench.cause.startswith("waiting for the scanner to answer")
    assert bench.run(1.0)
    assert bench.cause == ""


def test_late_answers_to_the_greeting_and_events_between_do_no_harm() -> None:
    bench = willing()
    bench.fake.answers["sRN SCdevicestate"] = UNKNOWN
    bench.fake.late_s["sRN SCdevicestate"] = 1.5
    assert bench.run(4.0)
    assert (bench.state, bench.cause) == ("running", "")
    bench = Bench()
    event = framed(b"sSN LIDoutputstate \x00\x01")
    for _ in range(150):
        bench.port.give(event)
        bench.port.give(bench.fake.scan(bench.now_s))
        bench.run(TICK_S)
    assert bench.state == "running"
    assert bench.fake.asked.count("sMN SetAccessMode") == 1


def test_a_stream_that_runs_proves_its_dialect() -> None:
    bench = willing()
    bench.fake.is_text = True
    bench.fake.answers["sRN SCdevicestate"] = None
    bench.run(TICK_S)
    bench.port.give(bench.fake.scan(100.0))
    assert bench.run(0.5)


# --- other hosts


def test_a_host_that_logs_in_is_named_and_not_fought_faster_than_every_three_seconds() -> None:
    bench = Bench()
    bench.run(1.0)
    assert bench.fake.asked.count("sMN SetAccessMode") == 1
    for _ in range(800):  # for 16 s, the other logs in whenever we have set it running
        bench.run(0.02, tick_s=0.01)
        if bench.state == "running":
            bench.fake.streams, bench.fake.state = False, CONFIGURING
    assert "the scanner is being configured: another host may be configuring it" in bench.causes
    assert 3 <= bench.fake.asked.count("sMN SetAccessMode") <= 6
    bench.run(10.0, tick_s=0.01)
    assert (bench.state, bench.cause) == ("running", "")


def test_a_host_that_logs_in_and_finishes_soon_is_not_fought_at_all() -> None:
    bench = willing()
    bench.run(11.0, tick_s=0.02)  # longer than it is thought that somebody may want it otherwise
    bench.fake.streams, bench.fake.state = False, CONFIGURING
    bench.run(2.5)
    assert bench.cause == "the scanner is being configured: another host may be configuring it"
    bench.fake.state = 7
    assert bench.run(1.0)
    assert "sMN SetAccessMode" not in bench.fake.asked
    bench.fake.streams, bench.fake.state = False, CONFIGURING  # and now it forgets its Run
    bench.run(6.5)
    assert bench.fake.asked.count("sMN SetAccessMode") == 1
    assert bench.state == "running"


def test_settings_that_are_others_after_a_new_connection_are_set_again_at_once() -> None:
    bench = Bench()
    bench.run(0.7)
    bench.fake.settings["LMPscancfg"] = (2500, 1, 2500, -450000, 2250000)  # or it has restarted
    bench.reconnect()
    bench.run(0.7)
    assert bench.fake.settings["LMPscancfg"] == WANTED["LMPscancfg"]
    assert bench.state == "running"


# --- running


@pytest.mark.parametrize("repeats", [False, True], ids=["silent", "one telegram again and again"])
def test_silence_is_a_loss_after_a_second_and_the_session_begins_anew(repeats: bool) -> None:
    bench = willing()
    bench.run(0.5)
    bench.fake.streams = False
    telegram = bench.fake.scan(bench.now_s)
    for tick in range(216):
        assert tick > 180 or bench.state == "running"
        bench.port.give(telegram * repeats)
        bench.run(TICK_S)
    assert (bench.state, bench.lms.status.losses) == ("starting", 1)
    assert any(cause.startswith("no scan from the scanner for 1 s") for cause in bench.causes)
    assert (bench.lms.status.rejected > 150) is repeats
    bench.run(1.0)
    assert bench.state == "running"
    assert bench.fake.asked.count("sEN LMDscandata") == 2
    assert bench.lms.status.missed == 0


def test_scans_that_never_came_are_counted_also_across_the_wrap() -> None:
    bench = willing()
    bench.fake.scan_number = 65_530
    bench.fake.step_by, bench.fake.period_s = 2, 0.04
    scans = bench.run(1.0)
    assert len(scans) > 20
    assert bench.lms.status.missed == len(scans) - 1
    bench.fake.scan_number, bench.fake.step_by = 5000, 1  # its counter begins anew
    assert bench.run(0.2)
    assert bench.lms.status.missed == len(scans) - 1


HOSTILE = {  # looks like telegrams, each time anew
    "text": b"\x02sRA \x03",
    "scan": b"\x02sSN LMDscandata 1 1 1 1 1 1 1 1 1 1\x03",
    "binary": b"\x02\x02\x02\x02\x00\x00\x20\x00ss",
    "answers": b"\x02sFA 1\x03",
}


@pytest.mark.parametrize("junk", HOSTILE.values(), ids=HOSTILE.keys())
def test_hostile_bytes_cost_little_in_one_step_and_the_scans_behind_them_are_taken(
    junk: bytes,
) -> None:
    bench = willing()
    bench.run(0.5)
    bench.port.give(junk * (65_536 // len(junk)))
    parser: Any = bench.lms._intake._parser
    decode, decoded = parser._decode, Counter[float]()

    def counted(*arguments: Any) -> Any:
        decoded[bench.now_s] += 1
        return decode(*arguments)

    parser._decode = counted
    scans = bench.run(0.5)
    assert max(decoded.values()) <= 1500  # of the 2000 to 11000 in the flood: a few ms
    assert len(scans) == pytest.approx(25, abs=1)
    assert (bench.state, bench.lms.status.missed) == ("running", 0)


NOISE = [framed(UNKNOWN), framed("sAN Run "), texted("sFA A"), texted("sAN Run 1")]


@settings(max_examples=examples(10))
@given(st.lists(st.binary(max_size=60) | st.sampled_from(NOISE)), st.booleans())
def test_no_bytes_at_any_time_stop_the_session_for_good(noise: list[bytes], is_text: bool) -> None:
    bench = Bench()
    bench.fake.is_text = is_text
    for piece in noise:
        bench.port.give(piece)
        bench.run(0.02)
    for _ in range(20):
        bench.run(1.0, tick_s=0.02)
        if bench.state == "running":
            break
    assert bench.run(0.2)
    assert bench.state == "running"
