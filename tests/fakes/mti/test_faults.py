"""The fake MTi with faults, and under bytes that no host would send."""

import math
import struct
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fakes.mti.device import State
from tests.support.cases import examples
from tests.support.devices.bench_mti import START_S, Bench, counters, frames, messages
from tests.support.devices.mti_frames import framed, wire


def test_frozen_it_repeats_the_same_data_and_mute_it_hears() -> None:
    bench = Bench()
    bench.listen(0.2)
    bench.fake.frozen = True
    repeated = messages(bench.listen(0.2))
    assert len(repeated) == 20
    assert set(repeated[1:]) == {repeated[0]}
    bench.fake.mute = True
    assert not bench.write(wire("GoToConfig"))
    assert bench.fake.state is State.CONFIG


def test_bursts_come_at_multiples_of_the_adapters_time() -> None:
    bench = Bench()
    bench.fake.burst_s = 0.016
    pieces = bench.pieces(1.0, 0.001)
    assert len(pieces) == 62
    assert {b - a > 0.0149 for (a, _), (b, _) in pairwise(pieces)} == {True}
    stream = b"".join(piece for _, piece in pieces)
    data = messages(frames(stream[: len(stream) // 23 * 23]))  # whole messages of 23 bytes
    assert {(b - a) % 2**16 for a, b in pairwise(counters(data))} == {1}


def test_a_gap_jumps_in_the_counter_once_and_lost_messages_are_missing_in_it() -> None:
    bench = Bench()
    bench.listen(0.1)
    bench.fake.gap = 40
    counted = counters(messages(bench.listen(0.3)))
    assert sorted({(b - a) % 2**16 for a, b in pairwise(counted)}) == [1, 41]
    bench.fake.lost_rate = 0.3
    data = messages(bench.listen(2.0))
    assert 100 < len(data) < 180
    assert {1, 2} <= {(b - a) % 2**16 for a, b in pairwise(counters(data))}


def test_nan_comes_in_every_number_format() -> None:
    bench = Bench()
    bench.fake.nan = True
    for word, form in ((0x001, ">4f"), (0x005, ">3f"), (0x009, ">9f"), (0x301, ">4d")):
        bench.configure(framed(0xD2, struct.pack(">I", word)))
        data = messages(bench.listen(0.05))[0]
        assert np.isnan(struct.unpack(form, data[:-2])).all()
    for fixed in (0x101, 0x201):
        bench.configure(framed(0xD2, struct.pack(">I", fixed)))
        assert bench.listen(0.05)


def test_a_yaw_jump_turns_the_orientation_and_not_the_rates() -> None:
    bench = Bench()
    bench.configure(wire("SetOutputMode"), wire("SetOutputSettings"))
    before = struct.unpack(">12f", messages(bench.listen(0.1))[-1][:48])
    bench.fake.yaw_jump_rad = -0.5
    after = struct.unpack(">12f", messages(bench.listen(0.1))[-1][:48])
    assert after[:9] == before[:9]
    assert after[11] - before[11] == pytest.approx(math.degrees(-0.5), abs=1e-4)


def test_a_tilt_that_is_off_is_in_the_angles_and_in_nothing_else() -> None:
    bench = Bench()
    bench.configure(wire("SetOutputMode"), wire("SetOutputSettings"))
    before = struct.unpack(">12f", messages(bench.listen(0.1))[-1][:48])
    bench.fake.tilt_off_rad = np.array([0.05, 0.0])
    after = struct.unpack(">12f", messages(bench.listen(0.1))[-1][:48])
    assert after[:9] == before[:9]
    assert after[9] - before[9] == pytest.approx(math.degrees(0.05), abs=1e-3)


def test_the_first_acknowledgements_are_swallowed_and_obeyed() -> None:
    bench = Bench()
    bench.fake.deaf_acks = 2
    assert 0x31 not in [mid for mid, _ in frames(bench.write(wire("GoToConfig")))]
    assert bench.write(wire("SetOutputMode")) == b""
    assert bench.write(wire("ReqOutputMode")) == wire("OutputMode")


def test_a_brown_out_cuts_a_message_and_wakes_up_again() -> None:
    bench = Bench()
    bench.configure(wire("SetOutputMode"))
    bench.listen(0.2)
    bench.fake.brown_out(bench.now_s)
    heard = bench.write(b"", 0.02)
    assert heard.endswith(wire("WakeUp"))
    assert heard[:4] == bytes.fromhex("FAFF3236")
    assert len(heard) == 27 + 5
    assert counters(messages(bench.listen(1.0)))[:2] == [2, 3]  # 0D and 91 held the line so long
    assert bench.fake.memory.mode == 0x0006
    bench.fake.late_s = 0.1  # what was cut is late, too
    bench.fake.brown_out(bench.now_s, forgets=True)
    assert not bench.write(b"", 0.05)
    assert bench.write(b"", 0.1).endswith(wire("WakeUp"))
    assert bench.fake.memory.mode == 0x0004


def test_after_a_hold_up_it_does_not_make_up_for_what_it_could_not_keep() -> None:
    bench = Bench()
    first = counters(messages(bench.listen(0.1)))[-1]
    sampled = len(bench.sampled_s)
    bench.now_s += 1000.0
    data = messages(bench.listen(0.005))
    assert 88 <= len(data) <= 92
    assert len(bench.sampled_s) - sampled <= 92
    assert abs((counters(data)[-1] - first) % 2**16 - 100_000 % 2**16) <= 2


CONVERSATION = [
    wire("GoToConfig"),
    wire("ReqDID"),
    wire("SetOutputMode"),
    wire("SetOutputSettings"),
    wire("SetPeriod"),
    wire("ReqConfiguration"),
    wire("ReqAvailableScenarios"),
    wire("GoToMeasurement"),
]
PIECES = st.lists(
    st.binary(max_size=40)
    | st.sampled_from([*CONVERSATION, wire("Reset"), wire("WakeUpAck"), wire("ReqData")])
    | st.builds(framed, st.integers(0, 255), st.binary(max_size=40)),
    max_size=15,
)


@settings(max_examples=examples(20))
@given(PIECES, st.sampled_from([0.0, 0.01, 0.3, 5.0]))
def test_no_bytes_make_it_raise(pieces: list[bytes], step_s: float) -> None:
    bench = Bench()
    for piece in pieces:
        bench.write(piece, step_s)


@settings(max_examples=examples(20))
@given(st.lists(st.integers(0, 200)))
def test_where_the_hosts_stream_is_cut_makes_no_difference(cuts: list[int]) -> None:
    stream = b"".join(CONVERSATION)
    edges = [0, *sorted(min(cut, len(stream)) for cut in cuts), len(stream)]
    whole, cut = Bench(), Bench()
    whole.fake.exchange(START_S, stream)
    for a, b in pairwise(edges):
        assert cut.fake.exchange(START_S, stream[a:b]) == b""
    assert cut.listen(0.1) == whole.listen(0.1)


def test_a_damaged_request_is_ignored() -> None:
    bench = Bench()
    bench.write(wire("GoToConfig"))
    for k in range(1, 7):
        damaged = bytearray(wire("SetOutputMode"))
        damaged[k] ^= 0x08
        bench.write(bytes(damaged), 0.3)
    assert bench.fake.memory.mode == 0x0004


@settings(max_examples=examples(20))
@given(st.binary(max_size=60))
def test_a_request_after_junk_is_heard_within_its_patience(junk: bytes) -> None:
    bench = Bench()
    bench.write(wire("GoToConfig"), 0.2)
    bench.write(junk, 0.2)
    bench.write(wire("GoToConfig"), 0.2)  # may be taken for the rest of what the junk began
    bench.write(b"", 1.0)
    if bench.fake.state is State.CONFIG:
        assert wire("GoToConfigAck") in bench.write(wire("GoToConfig"), 0.2)
