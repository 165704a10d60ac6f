"""The fake LMS111 with faults, and under bytes that no host would send."""

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from tests.support.bench_lms111 import FRAMES, START_S, Bench, counters, framed, payloads


def test_mute_swallows_what_it_says_and_not_what_it_hears() -> None:
    bench = Bench()
    bench.fake.mute = True
    bench.start()
    assert not bench.listen(0.2)
    bench.fake.mute = False
    assert bench.scans(0.1)


def test_frozen_repeats_one_telegram() -> None:
    bench = Bench()
    bench.start()
    last = bench.scans(0.1)[-1]
    bench.fake.frozen = True
    assert set(bench.scans(0.2)) == {last}
    bench.fake.frozen = False
    assert counters(bench.scans(0.1))[0] == counters([last])[0] + 11


def test_late_delays_every_byte() -> None:
    bench = Bench()
    bench.start()
    before = bench.scans(0.1)
    bench.fake.late_s = 0.15
    assert not bench.scans(0.145)
    assert counters(bench.scans(0.1))[0] == counters(before)[-1] + 1
    assert not bench.ask(FRAMES["unsubscribe"]).endswith(FRAMES["unsubscribed"])


def test_a_refused_command_gets_the_code_that_was_ordered() -> None:
    bench = Bench()
    bench.fake.refuse = {"sWN LMPoutputRange": 0x0A, "DeviceIdent": 3}
    bench.ask(FRAMES["login"])
    assert bench.ask(FRAMES["write range"]) == FRAMES["write denied"]
    assert b"sRA" in bench.ask(FRAMES["read range"])
    assert bench.ask(framed("sRN DeviceIdent")) == FRAMES["unknown variable"]


def test_it_is_silent_for_so_long_after_power_up() -> None:
    bench = Bench()
    bench.fake.start_silent_s = 2.0
    assert not bench.ask(FRAMES["login"])
    bench.listen(2.0)
    assert bench.ask(FRAMES["login"])
    bench.fake.reboot(bench.now_s)
    assert not bench.ask(FRAMES["login"])


def test_dropped_scans_are_missing_in_the_scan_counter() -> None:
    bench = Bench()
    bench.fake.drop_rate = 0.3
    bench.start()
    steps = {b - a for a, b in pairwise(counters(bench.scans(2.0)))}
    assert {1, 2} <= steps
    assert 0 not in steps


def test_wrong_checksums_are_wrong() -> None:
    bench = Bench()
    bench.fake.wrong_checksum_rate = 1.0
    good = FRAMES["logged in"]
    assert bench.ask(FRAMES["login"]) == good[:-1] + bytes([good[-1] ^ 0xFF])


def test_set_to_the_other_dialect_it_is_silent_to_the_next_client() -> None:
    bench = Bench()
    bench.ask(FRAMES["login"])
    assert bench.ask(FRAMES["set ascii"]) == framed("sWA EIHstCola ")
    assert bench.ask(FRAMES["read scan"])
    bench.fake.reconnected(bench.now_s)
    assert not bench.ask(FRAMES["read scan"])


def test_after_a_hold_up_it_does_not_make_up_for_what_it_could_not_keep() -> None:
    bench = Bench()
    bench.start()
    bench.now_s += 1e6
    assert len(payloads(bench.fake.exchange(bench.now_s, b""))) == 45


COMMANDS = [
    FRAMES["login"],
    FRAMES["scan 25"],
    FRAMES["write content rssi"],
    FRAMES["read state"],
    FRAMES["start"],
    FRAMES["run"],
    FRAMES["subscribe"],
    FRAMES["read scan"],
]
PIECES = st.lists(
    st.binary(max_size=40)
    | st.sampled_from(COMMANDS)
    | st.builds(
        framed,
        st.sampled_from(["sRN", "sWN", "sMN", "sEN", "sRI0", "sMN SetAccessMode "])
        | st.text(st.characters(codec="latin-1"), max_size=12),
        st.binary(max_size=30),
    ),
    max_size=12,
)


@given(PIECES, st.floats(0.0, 3.0))
def test_no_bytes_make_it_raise(pieces: list[bytes], step_s: float) -> None:
    bench = Bench()
    for piece in pieces:
        bench.ask(piece, step_s)


@given(st.lists(st.integers(0, 400)))
def test_where_the_hosts_stream_is_cut_makes_no_difference(cuts: list[int]) -> None:
    stream = b"".join(COMMANDS)
    edges = [0, *sorted(min(cut, len(stream)) for cut in cuts), len(stream)]
    whole, cut = Bench(), Bench()
    whole.fake.exchange(START_S, stream)
    for a, b in pairwise(edges):
        assert cut.fake.exchange(START_S, stream[a:b]) == b""
    assert cut.listen(0.6) == whole.listen(0.6)


@given(st.binary(max_size=60))
def test_a_command_after_junk_is_heard_within_its_patience(junk: bytes) -> None:
    bench = Bench()
    bench.ask(junk, 1.5)
    bench.ask(FRAMES["login"], 1.5)
    assert bench.ask(FRAMES["login"], 1.5).endswith(FRAMES["logged in"])


def test_a_damaged_command_is_ignored() -> None:
    bench = Bench()
    for k in range(4, len(FRAMES["login"])):
        damaged = bytearray(FRAMES["login"])
        damaged[k] ^= 0x10
        assert not bench.ask(bytes(damaged), 1.5)
        bench.fake.reconnected(bench.now_s)
