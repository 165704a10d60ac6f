"""The fake URG-04LX against the replies of its sheet, and on its line."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fakes.urg04lx import scip
from tests.fakes.urg04lx import sheet
from tests.fakes.urg04lx.bench import START_S, Bench, replies, scan_of
from tests.support.cases import cut
from tests.support.devices.urg04lx_vectors import REPLIES


def test_it_powers_up_in_scip_1_and_is_switched_once() -> None:
    bench = Bench(fresh=True)
    assert bench.ask(b"QT") == REPLIES["SCIP 1.1 refuses"]
    assert bench.ask(b"SCIP2.0") == REPLIES["switched to SCIP 2.0"]
    assert bench.ask(b"SCIP2.0") == REPLIES["switched before"]
    assert bench.ask(b"QT") == b"QT\n00P\n\n"
    assert bench.ask(b"GD0044072500") == REPLIES["laser off"]


def test_it_tells_of_itself_byte_for_byte_as_the_vendors_example() -> None:
    bench = Bench(fresh=True, timer_ms=sheet.II_MS)
    bench.fake.exchange(START_S, b"SCIP2.0\nII\nVV\nPP\n")
    assert bench.hear(1.0) == b"".join(
        REPLIES[name] for name in ("switched to SCIP 2.0", "vendor II", "vendor VV", "vendor PP")
    )


def test_statuses_and_numbers_are_those_of_the_sheet() -> None:
    for told in sheet.STATUSES:
        assert scip.summed(told[:-1]) == told
    for value, text in sheet.NUMBERS:
        assert scip.number(value, len(text)) == text


def scan_bench() -> Bench:
    bench = Bench(noise=0.0, values_at=sheet.SIX)
    bench.now_s = START_S + 0.2 - 0.0005  # a scan is about to begin, 0.2 s after power-up
    bench.fake.timer_ms = sheet.SCAN_MS - 200
    return bench


def test_a_stream_of_six_points_is_that_of_the_sheet() -> None:
    bench = scan_bench()
    sent = replies(bench.ask(b"MD0044004901000", 0.08))
    assert sent == [REPLIES["MD begun"], REPLIES["MD scan"]]
    assert bench.ask(b"QT") == b"QT\n00P\n\n"


def test_a_single_scan_of_six_points_with_two_characters_is_that_of_the_sheet() -> None:
    bench = scan_bench()
    assert bench.ask(b"BM", 0.001) == b""  # still on the line
    assert bench.ask(b"GS0044004900", 0.09) == b"BM\n00P\n\n" + REPLIES["GS scan"]


def test_full_scans_have_the_sizes_of_the_sheet() -> None:
    bench = Bench()
    bench.ask(b"BM", 0.3)
    assert len(bench.one(b"GD0044072500")) == 2134
    bench.ask(b"QT")
    for request, size in ((b"MD0044072501000", 2137), (b"MS0044072501000", 1435)):
        sent = replies(bench.ask(request, 0.6), is_cut=True)
        assert [len(reply) for reply in sent[1:]] == [size] * (len(sent) - 1)
        assert len(sent) > 4
        assert len(scan_of(sent[1])[1]) == 682
        bench.ask(b"QT", 0.2)


@pytest.mark.parametrize("end", [b"\n", b"\r", b"\r\n"])
def test_any_end_of_a_line_is_taken_and_the_text_comes_back(end: bytes) -> None:
    bench = Bench()
    text = b";a B9._+@"
    for line in (b"QT" + text, b"MD0044004401002" + text):
        bench.fake.exchange(bench.now_s, line + end)
        assert bench.hear(0.01) == line + b"\n00P\n\n"
    echoes = [reply.split(b"\n")[0] for reply in replies(bench.hear(0.5))]
    assert echoes == [b"MD00440044010%02d" % left + text for left in (1, 0)]


def test_bytes_take_their_time_on_the_line_and_its_rate_changes_after_the_reply() -> None:
    bench = Bench(fresh=True)
    bench.ask(b"SCIP2.0")
    bench.ask(b"BM", 0.3)
    bench.fake.exchange(bench.now_s, b"GD0044072500\n")
    assert len(bench.hear(1.0)) == pytest.approx(1920, abs=3)
    assert len(bench.hear(0.2)) == pytest.approx(214, abs=3)
    bench.fake.exchange(bench.now_s, b"SS750000\n")
    assert (bench.hear(0.0075, 0.0075), bench.fake.baud) == (b"SS750000\n00P", 19200)
    assert (bench.hear(0.005, 0.005), bench.fake.baud) == (b"\n\n", 19200)
    bench.fake.exchange(bench.now_s, b"GD0044072500\n")
    assert bench.fake.baud == 750000
    assert len(bench.hear(0.03)) == 2134
    bench.fake.exchange(bench.now_s, b"RS\n")
    assert (bench.hear(0.01, 0.01), bench.fake.baud) == (b"RS\n00P\n\n", 750000)
    assert (bench.hear(0.01, 0.01), bench.fake.baud) == (b"", 19200)


@pytest.mark.parametrize(
    ("baud", "request_", "scans"),
    [
        (19200, b"MD0044072501000", 3),
        (115200, b"MS0044072501000", 15),
        (250000, b"MD0044072501000", 30),
    ],
)
def test_scans_that_the_line_has_no_room_for_are_left_out(
    baud: int, request_: bytes, scans: int
) -> None:
    bench = Bench(baud=baud)
    bench.fake.baud = baud
    sent = bench.ask(request_, 3.0)
    assert sent.count(b"99b\n") == pytest.approx(scans, abs=1)


@given(st.lists(st.integers(0, 60)))
def test_where_the_hosts_stream_is_cut_makes_no_difference(cuts: list[int]) -> None:
    stream = b"SCIP2.0\nVV\rPP;x\r\nBM\nGD0044072500\nMS0100011000102\r\nII\n"
    whole, pieces = Bench(fresh=True), Bench(fresh=True)
    whole.fake.exchange(START_S, stream)
    for piece in cut(stream, cuts):
        assert pieces.fake.exchange(START_S, piece) == b""
    assert whole.hear(4.0, 0.5) == pieces.hear(4.0, 0.5)


LINES = st.one_of(
    st.binary(max_size=30),
    st.sampled_from([b"VV", b"PP", b"II", b"BM", b"QT", b"RS", b"SCIP2.0", b"TM0", b"TM1", b"TM2"]),
    st.builds(
        lambda command, digits: command + digits,
        st.sampled_from([b"GD", b"GS", b"MD", b"MS", b"SS", b"TM", b"CR", b"HS", b"DB", b"%ST"]),
        st.text("0123456789;x ", max_size=16).map(str.encode),
    ),
    st.sampled_from([b"GD0044072500", b"MD0000076899001", b"MS0500050001000;x"]),
)


@given(
    st.sampled_from(["URG-04LX", "URG-04LX-UG01", "UTM-30LX"]),
    st.booleans(),
    st.lists(st.tuples(LINES, st.sampled_from([b"\n", b"\r", b"\r\n", b""])), max_size=12),
    st.floats(0.0, 0.4),
)
def test_no_bytes_break_it_and_each_reply_ends_with_the_only_empty_line(
    model: str, fresh: bool, lines: list[tuple[bytes, bytes]], wait_s: float
) -> None:
    bench = Bench(model=model, fresh=fresh)
    sent = b""
    for line, end in lines:
        sent += bench.fake.exchange(bench.now_s, line + end) + bench.hear(wait_s, 0.1)
    bench.fake.baud = None
    sent += bench.fake.exchange(bench.now_s, b"\nTM2\nQT\n") + bench.hear(40.0, 10.0)
    assert replies(sent)[-1] in (b"QT\n00P\n\n", b"QT\nE\n\n")
