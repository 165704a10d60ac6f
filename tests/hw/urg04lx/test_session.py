"""The conversation with a Hokuyo scanner, against answers that are written down."""

from collections.abc import Callable

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.records import Scan
from tests.support.cases import cut, examples
from tests.support.devices.scripted_urg04lx import BAUD, MD, OPTIONS, Bench, reply, scan_of

SYNC = ["TM0", *["TM1"] * 10, "TM2"]
SET_UP = ["PP", "VV", *SYNC, MD]
FEWER = settings(max_examples=examples(10))


def seen(scans: list[Scan]) -> list[tuple[int, int]]:
    """Counter and range in mm of each."""
    for scan in scans:
        assert np.ptp(scan.ranges_m) == 0.0
    return [(scan.counter, round(1000 * scan.ranges_m[0, 0])) for scan in scans]


# --- how it is found


def test_one_that_is_idle_is_set_up_in_the_sheets_order() -> None:
    bench = Bench()
    scans = bench.run(4.0)
    assert bench.script.asked == ["QT", *SET_UP]
    assert (bench.state, bench.cause, bench.urg.status.rejected) == ("running", "", 0)
    assert len(scans) > 20
    assert bench.urg.identity.endswith("serial number H0614967")


@pytest.mark.parametrize("refusal", [reply("QT", "E"), b""], ids=["refuses", "says nothing"])
def test_scip_1_1_is_switched_over_even_where_it_says_nothing(refusal: bytes) -> None:
    bench = Bench()
    bench.script.answers |= {"QT": [refusal, reply("QT", "00")], "SCIP2.0": [reply("SCIP2.0", "0")]}
    bench.run(4.0)
    assert bench.script.asked == ["QT", "SCIP2.0", "QT", *SET_UP]
    assert bench.state == "running"


def test_the_mode_of_time_synchronisation_is_ended() -> None:
    bench = Bench()
    bench.script.answers["QT"] = [reply("QT", "0E"), reply("QT", "00")]
    bench.run(4.0)
    assert bench.script.asked == ["QT", "TM2", "QT", *SET_UP]


def test_what_it_streams_for_a_dead_host_is_no_scan_and_no_obstacle() -> None:
    bench = Bench()
    old = b"".join(scan_of(500, k, "MD0044072501000") for k in range(3))
    bench.script.answers["QT"] = [old[40:] + reply("QT", "00")]
    scans = bench.run(4.0)
    assert bench.script.asked == ["QT", *SET_UP]
    assert all(mm >= 1000 for _, mm in seen(scans))


@pytest.mark.parametrize("found", [19_200, 750_000])
def test_it_is_brought_from_the_rate_it_has_to_the_wanted_one(found: int) -> None:
    bench = Bench()
    bench.script.baud = found
    bench.script.answers[f"SS{BAUD}"] = [reply(f"SS{BAUD}", "00")]
    while bench.script.asked[-1:] != [f"SS{BAUD}"]:
        bench.run(0.005)
        assert bench.now_s < 70
    bench.script.baud = BAUD  # behind its answer
    bench.run(4.0)
    assert bench.script.asked == ["QT", f"SS{BAUD}", "QT", *SET_UP]
    assert (bench.state, bench.cause, bench.port.baud) == ("running", "", BAUD)


@pytest.mark.parametrize("status", ["02", "04"])
def test_a_rate_that_it_does_not_take_is_told_and_it_runs_at_its_own(status: str) -> None:
    bench = Bench()
    bench.script.baud = 57_600
    bench.script.answers[f"SS{BAUD}"] = [reply(f"SS{BAUD}", status)]
    bench.run(12.0)
    assert (bench.state, bench.port.baud) == ("running", 57_600)
    assert "does not take 115200 baud" in bench.cause


def test_nobody_there_is_told() -> None:
    bench = Bench()
    bench.script.answers.clear()
    bench.script.baud = 1
    bench.run(15.0)
    assert bench.state == "starting"
    assert "check power, cable and rate" in bench.cause


# --- what is not as it should be


def test_one_that_does_not_tell_its_time_runs_and_that_is_told() -> None:
    bench = Bench()
    bench.script.answers["TM0"] = [reply("TM0", "0E")]
    assert bench.run(4.0)
    assert bench.state == "running"
    assert "does not tell its time" in bench.cause


@pytest.mark.parametrize(
    "damage",
    [
        lambda data: data[:25] + b"!" + data[26:],  # a line of data
        lambda data: data[:17] + b"0" + data[18:],  # the status
        lambda data: data[:2] + b"9" + data[3:],  # the echo, which has no sum
        lambda data: data[:30] + data[31:],  # a byte is lost,
        lambda data: data[:-2],  # or the end of the message
        lambda data: data.replace(b"\n99b", b"\n00P"),  # as the answer to the request
    ],
    ids=["data", "status", "echo", "lost byte", "lost end", "no data"],
)
def test_damage_costs_its_own_scan_and_no_other(damage: Callable[[bytes], bytes]) -> None:
    bench = Bench().started()
    first = seen(bench.run(0.5))[-1]
    bench.spoil = lambda data: [damage(data)]
    assert bench.run(0.1) == []
    bench.spoil = lambda data: [data]
    after = seen(bench.run(0.5))
    assert after == [(first[0] + k, first[1] + k) for k in range(2, 2 + len(after))]
    assert len(after) == 5
    assert bench.urg.status.missed == 1
    assert bench.script.asked == []


@FEWER
@given(st.lists(st.integers(1, 100), max_size=6), st.integers(0, 4))
def test_the_same_scans_come_however_their_bytes_are_cut(cuts: list[int], junk: int) -> None:
    bench = Bench().started()
    whole = seen(bench.run(1.0))
    bench.spoil = lambda data: [b"\n" * junk, *cut(data, cuts)]
    pieces = seen(bench.run(1.0))
    assert [mm for _, mm in pieces] == list(range(whole[-1][1] + 1, whole[-1][1] + 11))
    assert bench.urg.status.rejected == 0


@FEWER
@given(st.lists(st.binary(max_size=40), min_size=1, max_size=20))
def test_whatever_bytes_come_between_no_scan_is_false(junk: list[bytes]) -> None:
    bench = Bench().started()
    first, waiting = seen(bench.run(0.5))[-1][1], list(junk)
    bench.spoil = lambda data: [waiting.pop() if waiting else b"", data]
    told = [mm for _, mm in seen(bench.run(3.0))]
    assert set(told) <= set(range(first + 1, first + 31))
    assert told == sorted(set(told))
    assert bench.state == "running"


REQUESTS = ["QT", "SCIP2.0", "PP", "VV", "TM0", "TM1", "TM2", f"SS{BAUD}", MD]
LINES = st.binary(max_size=70) | st.from_regex(
    r"(DMIN|DMAX|ARES|AMIN|SCAN):[0-9]{1,5};", fullmatch=True
).map(str.encode)
SAID = st.one_of(
    st.binary(max_size=60),
    st.builds(
        lambda command, status, lines: reply(command, status, *lines),
        st.sampled_from(REQUESTS),
        st.text("0123456789ABEI", min_size=1, max_size=2),
        st.lists(LINES, max_size=9),
    ),
    st.builds(
        lambda command, status: command.encode() + b"\n" + status + b"\n\n",
        st.sampled_from(REQUESTS),
        st.sampled_from([b"0", b"E", b"5", b"z", b"\xb2", b"\xff"]),  # b2: a digit, and no number
    ),
)


@settings(max_examples=examples(40))
@given(st.lists(st.tuples(SAID, st.sampled_from([0.005, 0.1, 0.6])), max_size=30), st.booleans())
def test_whatever_is_said_when_nothing_is_raised(
    said: list[tuple[bytes, float]], is_started: bool
) -> None:
    bench = Bench().started() if is_started else Bench()
    bench.script.answers.clear()
    for data, seconds in said:
        bench.port.give(data)
        for scan in bench.run(seconds):
            assert np.isfinite(scan.t_s)
            assert not (scan.ranges_m <= 0.0).any()


@pytest.mark.parametrize(
    ("status", "words"), [("10", "laser is off"), ("63", "hardware"), ("0I", "new firmware")]
)
def test_what_it_says_in_its_stream_is_told_and_it_is_started_again(
    status: str, words: str
) -> None:
    bench = Bench().started()
    bench.spoil = lambda data: [reply(MD, status)]
    bench.run(0.15)
    assert bench.state == "starting"
    assert words in bench.cause
    bench.spoil = lambda data: [data]
    bench.run(3.0)
    assert bench.script.asked == ["QT", "PP", "VV", MD]  # how long a scan takes to come is known
    assert (bench.state, bench.urg.status.losses) == ("running", 1)


def test_while_it_checks_an_error_nothing_is_delivered_and_nothing_asked() -> None:
    bench = Bench().started()
    bench.spoil = lambda data: [reply(MD, "21")]
    assert bench.run(0.5) == []
    assert "stopped to check" in bench.cause
    bench.spoil = lambda data: [reply(MD, "98")]
    bench.run(0.1)
    bench.spoil = lambda data: [data]
    assert len(bench.run(1.0)) == 10
    assert (bench.state, bench.cause, bench.script.asked) == ("running", "", [])


def test_a_restart_to_scip_1_1_and_19200_baud_is_found_by_the_silence() -> None:
    bench = Bench().started()
    script = bench.script
    script.baud = 19_200
    script.step(bench.now_s, b"QT\n")  # its stream is over
    script.asked.clear()
    script.answers |= {
        "QT": [reply("QT", "E"), reply("QT", "00")],
        "SCIP2.0": [reply("SCIP2.0", "0")],
        f"SS{BAUD}": [reply(f"SS{BAUD}", "00")],
    }
    bench.run(1.0)
    assert bench.state == "starting"
    assert bench.cause == "no scan from the scanner for 0.4 s"
    while script.asked[-1:] != [f"SS{BAUD}"]:
        bench.run(0.005)
        assert bench.now_s < 70
    script.baud = BAUD
    bench.run(4.0)
    assert script.asked == ["QT", "SCIP2.0", "QT", f"SS{BAUD}", "QT", "PP", "VV", MD]
    assert (bench.state, bench.cause) == ("running", "")


def test_why_none_of_its_scans_can_be_used_is_told() -> None:
    bench = Bench().started()
    bench.spoil = lambda data: [scan_of(1000, round(bench.now_s * 1000), points=64)]
    bench.run(1.0)
    assert bench.cause.endswith("64 points instead of 65")


def test_after_its_last_words_nothing_is_asked() -> None:
    bench = Bench().started()
    bench.urg.stop()
    assert bench.urg.settled
    assert bench.run(3.0) == []
    assert bench.script.asked == ["QT"]


def polled() -> Bench:
    """Each scan is asked for; none is answered."""
    bench = Bench(msgspec.structs.replace(OPTIONS, stream=False))
    bench.script.answers["II"] = [reply("II", "00", b"TIME:00C350")]
    return bench


@pytest.mark.parametrize(
    ("command", "status", "words"),
    [
        ("BM", "01", "refuses BM: its laser has a fault (status 01)"),
        ("PP", "01", "refuses PP: status 01 of PP"),
        ("GD0384044801", "01", "the scanner: the first step is no number (status 01)"),
        ("GD0384044801", "E", "the scanner: it has restarted, and speaks SCIP 1.1 (status E)"),
    ],
)
def test_what_a_status_means_depends_on_its_command(command: str, status: str, words: str) -> None:
    bench = polled()
    bench.script.answers[command] = [reply(command, status)]
    while "status" not in bench.cause:
        bench.run(0.005)
        assert bench.now_s < 60
    assert bench.cause.endswith(words)


def test_a_single_scan_is_asked_for_when_the_last_one_is_there_and_its_time_with_it() -> None:
    bench = Bench(msgspec.structs.replace(OPTIONS, stream=False))
    gd = "GD0384044801"
    lines = scan_of(700, 49_900).split(b"\n")[2:]
    bench.script.answers |= {
        gd: [gd.encode() + b"\n00P\n" + b"\n".join(lines)],
        "II": [reply("II", "00", b"LASR:ON", b"TIME:00C350")],  # 50 000
    }
    scans = bench.run(1.0)
    assert bench.script.asked[:7] == ["QT", "PP", "VV", "BM", "II", gd, "II"]
    assert len(scans) == 1  # the same one again is none
    assert scans[0].ranges_m.min() == 0.7
