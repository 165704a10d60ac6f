"""What the fake URG-04LX and its sisters answer to each request, and when they send scans."""

from itertools import pairwise

import pytest

from fakes.urg04lx.device import FakeUrg04lx
from tests.fakes.urg04lx.bench import (
    F64,
    START_S,
    Bench,
    number,
    replies,
    scan_of,
    status,
    two_metres,
)


@pytest.mark.parametrize(
    ("line", "told"),
    [
        *[(b"MD%b072501000" % start, "01") for start in (b"x044", b"00 4", b"-044")],
        (b"MD0044y72501000", "02"),
        (b"MD00440725z1000", "03"),
        (b"MD0044076901000", "04"),
        (b"MD0100009901000", "05"),
        (b"MD0044072501x00", "06"),
        (b"MD00440725010x0", "07"),
        (b"GSx04407250x", "01"),
        (b"GD0044076801", "10"),
        (b"GD004407250", "0C"),
        (b"GD00440725001", "0E"),
        (b"TM", "0C"),
        (b"TM3", "01"),
        (b"TM1", "04"),
        (b"TM2", "03"),
        (b"SS38400x", "01"),
        (b"SS123456", "02"),
        (b"SS500000", "03"),
        (b"SS038400", "04"),
        (b"QT;0123456789012345", "00"),
        (b"QT;01234567890123456", "0G"),
        (b"QT;a-b", "0H"),
        (b"CRx1", "01"),
        (b"CR11", "02"),
        (b"CR00", "03"),
        (b"%ST", "0E"),
        (b"ME0044072501000", "0E"),
        (b"HS1", "0E"),
        (b"DB01", "0E"),
        (b"Q", "0E"),
    ],
)
def test_what_it_does_not_do_gets_the_status_of_the_sheet(line: bytes, told: str) -> None:
    assert Bench().status(line) == told


def test_a_line_longer_than_its_buffer_is_told_so() -> None:
    [reply] = replies(Bench().ask(b"QT" * 60))
    assert status(reply) == "0B"


def test_the_laser_is_lit_by_bm_and_put_out_by_qt_and_rs_and_time_mode() -> None:
    bench = Bench()
    for off in (b"QT", b"RS", b"TM0"):
        assert [bench.status(b"BM") for _ in range(2)] == ["00", "02"]
        assert b"LASR:ON" in bench.one(b"II", 0.3)
        assert bench.status(b"GD0044072500") == "00"
        assert bench.status(off) == "00"
        bench.ask(b"TM2")
        bench.fake.baud = 500000  # which RS has changed
        assert bench.status(b"GD0044072500") == "10"


def test_in_time_mode_all_else_gets_an_error_and_the_timer_runs_and_wraps() -> None:
    bench = Bench(timer_ms=(1 << 24) - 200)
    assert [bench.status(b"TM0") for _ in range(2)] == ["00", "02"]
    for line in (b"QT", b"BM", b"GD0044072500", b"VV", b"RS"):
        assert bench.status(line) == "0E"
    told = [bench.one(b"TM1", 0.1).split(b"\n")[2] for _ in range(3)]
    times_ms = [number(line[:-1]) for line in told]
    assert [b - a for a, b in pairwise(times_ms)] == [100, 100]
    assert 1000 < times_ms[0] < 6000  # it has wrapped
    assert [bench.status(b"TM2") for _ in range(2)] == ["00", "03"]
    assert bench.status(b"QT") == "00"


def test_a_counted_series_counts_down_and_puts_the_laser_out() -> None:
    bench = Bench()
    sent = replies(bench.ask(b"MS0384038601003", 1.0))
    assert [reply.split(b"\n")[0][-2:] for reply in sent] == [b"03", b"02", b"01", b"00"]
    assert [status(reply) for reply in sent] == ["00", "99", "99", "99"]
    times_ms = [scan_of(reply)[0] for reply in sent[1:]]
    assert times_ms == [times_ms[0] + 100 * k for k in range(3)]
    assert b"LASR:OFF" in bench.ask(b"II")


def test_the_interval_skips_scans_and_a_second_request_during_a_stream_is_refused() -> None:
    bench = Bench()
    sent = replies(bench.ask(b"MD0384038601200", 1.0))
    times_ms = [scan_of(reply)[0] for reply in sent[1:]]
    assert times_ms == [times_ms[0] + 300 * k for k in range(4)]
    for line in (b"MD0384038601200", b"MS0384038601000", b"GD0384038600"):
        assert b"\n0Bb\n\n" in bench.ask(line, 0.01)


def test_a_cluster_is_the_least_of_its_neighbours_without_error_codes() -> None:
    values = {100: 500, 101: 400, 102: 7, 103: 0, 104: 8, 105: 19, 106: 300}
    bench = Bench(values_at=values)
    bench.ask(b"BM", 0.3)
    for cluster, told in ((b"00", list(values.values())), (b"03", [400, 0, 300])):
        assert scan_of(bench.one(b"GD01000106" + cluster))[1] == told


def test_steps_outside_the_measuring_range_cannot_be_measured() -> None:
    bench = Bench(noise=0.0, values_at={769: 1, -1: 1, 384: 2000})
    bench.ask(b"BM", 0.3)
    told = scan_of(bench.one(b"GD0000076801"))[1]
    assert told == [19] * 44 + [2000] * 682 + [19] * 43


def test_each_step_is_measured_at_its_own_time_and_bearing() -> None:
    asked = []

    def truth(t_first_s: float, times_s: F64, bearings_rad: F64) -> F64:
        asked.append((t_first_s, times_s, bearings_rad))
        return two_metres(t_first_s, times_s, bearings_rad)

    bench = Bench(truth)
    [_, reply] = replies(bench.ask(b"MD0384038401001", 0.3))
    stamp_s = START_S + scan_of(reply)[0] / 1000
    [(t_first_s, times_s, bearings_rad)] = asked
    assert t_first_s == times_s[0] == pytest.approx(stamp_s + 44 / 1024 * 0.1, abs=1e-6)
    assert times_s[-1] == pytest.approx(stamp_s + 725 / 1024 * 0.1, abs=1e-6)
    assert bearings_rad[384 - 44] == 0.0
    assert bearings_rad[[0, -1]] * 57.29578 == pytest.approx([-119.53, 119.88], abs=0.005)


def test_a_clock_that_drifts_stamps_and_turns_so() -> None:
    bench = Bench(drift_ppm=10_000.0)
    sent = replies(bench.ask(b"MD0384038601000", 10.0))
    times_ms = [scan_of(reply)[0] for reply in sent[1:]]
    assert times_ms == [times_ms[0] + 100 * k for k in range(len(times_ms))]
    assert len(times_ms) == pytest.approx(101, abs=1)


def test_a_slower_motor_is_told_and_its_stream_goes_on() -> None:
    bench = Bench()
    bench.ask(b"MD0384038601000", 0.5)
    bench.ask(b"CR10", 0.3)
    times_ms = [scan_of(reply)[0] for reply in replies(bench.hear(1.0))]
    assert [b - a for a, b in pairwise(times_ms)][:3] == [111, 111, 111]
    assert b"SCSP:Initial(540[rpm]);" in bench.ask(b"II", 0.02)
    assert status(bench.one(b"QT", 0.02)) == "00"
    assert bench.status(b"CR99") == "00"


def test_the_usb_sister_is_in_scip_2_has_no_rate_and_knows_more() -> None:
    bench = Bench(model="URG-04LX-UG01")
    assert bench.ask(b"SCIP2.0") == b"SCIP2.0\n0Ee\n\n"
    assert bench.fake.baud is None
    assert [bench.status(line) for line in (b"SS019200", b"SS115200")] == ["03", "00"]
    assert [bench.status(line) for line in (b"HS1", b"HS1", b"HS2")] == ["00", "02", "01"]
    assert [bench.status(b"DB" + number) for number in (b"60", b"98")] == ["00", "01"]
    assert bench.status(b"MD0044072501000") == "60"
    assert bench.status(b"DB00") == "00"
    assert len(bench.ask(b"MD0044072501001", 0.3)) == 20 + 1 + 2137


def test_the_ethernet_sister_has_1081_points_40_times_a_second_and_tells_its_state() -> None:
    bench = Bench(model="UTM-30LX")
    for line in (
        b"AMIN:0;",
        b"AMAX:1080;",
        b"AFRT:540;",
        b"ARES:1440;",
        b"DMIN:23;",
        b"DMAX:60000;",
        b"SCAN:2400;",
    ):
        assert line in bench.one(b"PP")
    assert bench.ask(b"%ST") == b"%ST\n00P\n000@\n\n"
    for line, state in (
        (b"TM0", b"002"),
        (b"TM2", b"000"),
        (b"BM", b"003"),
        (b"MD0000108001000", b"004"),
    ):
        bench.ask(line)
        assert b"%ST\n00P\n" + state in bench.ask(b"%ST", 0.005)
    sent = replies(bench.hear(1.0))
    assert len(sent) == pytest.approx(40, abs=1)
    assert len(scan_of(sent[0])[1]) == 1081
    assert bench.fake.baud is None
    assert b"SS115200\n0Ee\n\n" in bench.ask(b"SS115200")
    bench.fake.reconnected(bench.now_s)
    assert bench.ask(b"%ST") == b"%ST\n00P\n000@\n\n"
    bench.fake.trouble = 60
    assert bench.ask(b"%ST").startswith(b"%ST\n00P\n900")


def test_the_ethernet_sister_reboots_when_it_is_told_so_twice_in_a_row() -> None:
    bench = Bench(model="UTM-30LX")
    lines = b"BM", b"RB", b"PP", b"RB", b"RB"
    assert [bench.status(line) for line in lines] == ["00", "01", "00", "01", "00"]
    assert b"LASR:OFF" in bench.one(b"II")
    assert bench.status(b"RB") == "01"
    assert Bench().status(b"RB") == "0E"


def test_a_model_that_there_is_not_is_named() -> None:
    with pytest.raises(ValueError, match=r"must be one of URG-04LX, .*is 'UST'"):
        FakeUrg04lx(two_metres, 1, "UST")
