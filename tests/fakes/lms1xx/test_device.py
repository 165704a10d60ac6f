"""The fake LMS111 against the frames of its sheet and against the recorded session."""

import csv
import math
import struct
from datetime import datetime
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from fakes.lms1xx.cola import packed, written
from fakes.lms1xx.scan import Channel, ScanTelegram
from tests.support.devices.bench_lms111 import (
    F64,
    START_S,
    Bench,
    counters,
    payloads,
    raw_of,
    scans_of,
)
from tests.support.devices.lms111_vectors import FRAMES, TEXTS, framed


def test_each_answer_printed_in_the_sheet_comes_byte_for_byte() -> None:
    bench = Bench()
    conversation = [
        (framed("sMN SetAccessMode ", b"\3\0\0\0\0"), FRAMES["not logged in"]),
        (FRAMES["read scan"], FRAMES["scan is 50"]),
        (FRAMES["write range"], FRAMES["write denied"]),
        (FRAMES["write content"], FRAMES["write denied"]),
        (framed("sMN LMCstartmeas"), framed("sFA\0\1")),
        (FRAMES["scan 50"], framed("sFA\0\1")),
        (FRAMES["login 2"], FRAMES["logged in"]),
        (FRAMES["write content"], FRAMES["write denied"]),
        (FRAMES["login 4"], FRAMES["logged in"]),
        (FRAMES["write content"], FRAMES["content written"]),
        (FRAMES["login"], FRAMES["logged in"]),
        (FRAMES["scan 25"], FRAMES["scan 25 taken"]),
        (FRAMES["read scan"], FRAMES["scan is 25"]),
        (FRAMES["write range"], FRAMES["range written"]),
        (FRAMES["read range"], FRAMES["range is"]),
        (FRAMES["write content"], FRAMES["content written"]),
        (FRAMES["read content"], FRAMES["content is"]),
        (FRAMES["write content rssi"], FRAMES["content written"]),
        (FRAMES["write content all"], FRAMES["content written"]),
        (FRAMES["write range 180"], FRAMES["range written"]),
        (FRAMES["store"], framed("sAN mEEwriteall ", b"\1")),
        (FRAMES["set time"], FRAMES["time set"]),
        (FRAMES["stop"], framed("sAN LMCstopmeas ", b"\0")),
        (FRAMES["standby"], framed("sAN LMCstandby ", b"\0")),
        (FRAMES["start"], framed("sAN LMCstartmeas ", b"\0")),
        (FRAMES["run"], framed("sAN Run ", b"\1")),
        (FRAMES["read contamination"], FRAMES["clean"]),
        (FRAMES["subscribe"], FRAMES["subscribed"]),
        (FRAMES["unsubscribe"], FRAMES["unsubscribed"]),
        (framed("sRN FREchoFilter"), FRAMES["unknown variable"]),
    ]
    for command, answer in conversation:
        assert bench.ask(command) == answer, command
    bench.listen(0.5)
    assert bench.ask(FRAMES["read device state"]) == FRAMES["device ready"]
    assert payloads(bench.ask(FRAMES["read state"]))[0].startswith(b"sRA STlms \0\7\0\0\x0812:34:5")


def test_the_telegrams_printed_in_the_sheet_are_encoded_byte_for_byte() -> None:
    when = datetime(2021, 3, 2, 12, 34, 56, 789000)
    common = {
        "status": b"\0\0", "telegrams": 0xF770, "scans": 0xC, "scan_us": 0x742AF1D6,
        "sent_us": 0x742AFE0A, "outputs": b"\4\0", "shots": 360,
    }  # fmt: skip

    def row(name: bytes, raw: list[int], *at: int, **kind: bool | float) -> Channel:
        return Channel(name, np.array(raw, dtype=np.uint16), *at, **kind)  # type: ignore[arg-type]

    at = (900_000, 5000)
    rows = (row(b"DIST1", [1337, 3, 0], *at), row(b"RSSI1", [254, 0, 16], *at, wide=False))
    a = ScanTelegram(frequency=5000, channels=rows, when=when, **common)  # type: ignore[arg-type]
    at = (-450_000, 2500)
    many = (
        row(b"DIST1", [700, 0, 16], *at, scale=2.0),
        row(b"DIST2", [800, 0, 0], *at, scale=2.0),
        row(b"RSSI1", [0xFFFF, 0, 1], *at),
        row(b"RSSI2", [12, 0, 0], *at),
    )
    b = ScanTelegram(frequency=2500, channels=many, encoders=((1000, -5),), name=b"front", **common)  # type: ignore[arg-type]
    for telegram, name, head in ((a, "scan A", b"sSN"), (b, "scan B", b"sRA")):
        assert framed(head + b" LMDscandata ", packed(telegram.values())) == FRAMES[name]
        assert head + b" LMDscandata " + written(telegram.values()) == TEXTS[name]


@pytest.fixture(scope="module")
def session(vectors: Path) -> list[tuple[str, bytes]]:
    """The recorded telegrams in their order: h2d or d2h, bytes."""
    streams = {d: (vectors / f"lms111_session_{d}.bin").read_bytes() for d in ("h2d", "d2h")}
    with (vectors / "lms111_session_index.csv").open(encoding="utf-8") as file:
        rows = [(r["dir"], int(r["offset"]), int(r["length"])) for r in csv.DictReader(file)]
    return [(way, streams[way][at : at + size]) for way, at, size in rows]


def test_the_recorded_host_gets_the_recorded_answers_and_scans_of_the_recorded_layout(
    session: list[tuple[str, bytes]],
) -> None:
    bench = Bench()
    for k, ((way, command), (_, answer)) in enumerate(pairwise(session[:98])):
        if way == "d2h":
            continue
        [ours] = payloads(bench.ask(command))
        theirs = answer[8:-1]
        name = command[12:-1].split(b" ")[0]
        assert ours.split(b" ")[:2] == theirs.split(b" ")[:2]
        if name in {b"field%03d" % k for k in range(10)}:  # drawn by that device's owner
            assert ours == b"sRA " + name + b" \0"
        elif k != 14:  # the first read of the range, which its owner had set before
            assert ours == theirs
    sent = bench.listen(0.6)
    recorded = [t[8:-1] for way, t in session if way == "d2h" and b"sSN LMDscandata " in t]
    for k in (0, 6, 7, 20):
        mine, real = sent[k], recorded[k]
        assert len(framed(mine)) == 1191
        assert mine[:26] == real[:26]  # up to the device status
        assert mine[38:77] == real[38:77]  # inputs .. first channel's head
        assert mine[-23:-9] == real[-23:-9]  # flags, and the date of an unset clock
        assert mine[-2:] == real[-2:]
    assert [telegram[24:26] for telegram in sent[:8]] == [b"\1\0"] * 7 + [b"\0\0"]


def test_beams_are_seen_at_their_own_instants_and_told_after_the_sweep() -> None:
    asked: list[tuple[float, F64, F64]] = []

    def truth(t_first_s: float, times_s: F64, bearings_rad: F64) -> F64:
        asked.append((t_first_s, times_s, bearings_rad))
        return np.linspace(1.0, 6.4, len(times_s))

    bench = Bench(truth)
    bench.fake.noise_m = 0.0
    bench.start(FRAMES["scan 25"])
    sent, came_s = b"", math.nan
    while not sent:
        bench.now_s += 0.0001
        sent, came_s = bench.fake.exchange(bench.now_s, b""), bench.now_s
    [scan] = scans_of(sent)
    [(t_first_s, times_s, bearings_rad)] = asked
    assert t_first_s == times_s[0]
    assert len(times_s) == 1081
    np.testing.assert_allclose(np.diff(times_s), 0.25 / 360 / 25, rtol=1e-6)
    np.testing.assert_allclose(np.degrees(bearings_rad[[0, 540, -1]]), [-135, 0, 135], atol=1e-9)
    assert raw_of(scan) == [round(1000 + 5 * k) for k in range(1081)]
    assert scan.sent_us - scan.scan_us == 3100
    assert scan.sent_us * 1e-6 + START_S == pytest.approx(times_s[-1] + 1e-4, abs=2e-6)
    assert 0 <= came_s - (times_s[-1] + 1e-4) < 0.00011


@pytest.mark.parametrize("range_m", [0.3, 19.8, 0.0, 20.5, math.nan, math.inf])
def test_ranges_become_noisy_millimetres_and_nothing_comes_from_afar(range_m: float) -> None:
    bench = Bench(lambda t_s, times_s, bearings_rad: np.full(len(times_s), range_m))
    bench.start()
    raw = np.array([raw_of(scan) for scan in bench.scans(0.1)])
    valid = raw[raw > 16]
    assert raw.shape[1] == 541
    if 0.0 < range_m < 20.0:
        assert len(valid) == raw.size
        assert abs(valid.mean() - 1000 * range_m) < 1.5
        assert 11 < valid.std() < 13
    else:
        assert valid.size < 0.2 * raw.size  # noise around zero


def test_the_output_range_cuts_points_off_and_leaves_the_rest_where_it_was() -> None:
    whole, part = (Bench(lambda t, s, b: b + 4.0, noise_m=0.0) for _ in range(2))
    whole.start(FRAMES["scan 25"])
    part.start(FRAMES["scan 25"], FRAMES["write range 180"])
    all_of_it, some = whole.scans(0.1)[0], part.scans(0.1)[0]
    assert some.channels["DIST1"].layout == (0.0, 0.25, 721)
    assert raw_of(some) == raw_of(all_of_it)[180:901]
    resolution = payloads(part.ask(FRAMES["read range"]))[0][21:25]
    assert resolution == bytes.fromhex("00001388")  # at 0.25 deg as well: the sheet's pitfall
    part.fake.untrue_output_step = False
    assert payloads(part.ask(FRAMES["read range"]))[0][21:25] == bytes.fromhex("000009C4")


@pytest.mark.parametrize(
    ("values", "status"),
    [
        ((5000, 1, 5000, -450_000, 2_250_000), 0),
        ((2500, 1, 2500, -450_000, 2_250_000), 0),
        ((2500, 1, 5000, -450_000, 2_250_000), 0),
        ((5000, 1, 2500, -450_000, 2_250_000), 2),
        ((3500, 1, 2500, -450_000, 2_250_000), 1),
        ((5000, 1, 1000, -450_000, 2_250_000), 2),
        ((3500, 1, 1000, -450_000, 2_250_000), 3),
        ((5000, 1, 5000, -450_001, 2_250_000), 4),
        ((5000, 2, 5000, -450_000, 2_250_000), 5),
    ],
)
def test_only_the_modes_of_the_device_are_taken(values: tuple[int, ...], status: int) -> None:
    bench = Bench()
    bench.ask(FRAMES["login"])
    [answer] = payloads(bench.ask(framed("sMN mLMPsetscancfg ", struct.pack(">IhIii", *values))))
    taken = values if status == 0 else (5000, 1, 5000, -450_000, 2_250_000)
    assert answer[19:] == bytes([status]) + struct.pack(">IhIii", *taken)


@pytest.mark.parametrize(
    ("command", "code"),
    [
        (framed("sMN Fly"), 2),
        (framed("sRN Fly"), 3),
        (framed("sWN Fly ", b"\1"), 3),
        (framed("sRN field030"), 3),
        (framed("sEN Fly ", b"\1"), 0x0F),
        (framed("sXX Fly"), 0x0C),
        (framed(""), 0x0C),
        (framed("sWN STlms ", b"\1"), 0x0A),
        (framed("sMN mLMPsetscancfg ", b"\0\0"), 8),
        (framed("sMN SetAccessMode ", b"\3"), 8),
        (framed("sWN LMPoutputRange ", struct.pack(">HIii", 1, 5000, -450_001, 0)), 4),
        (framed("sWN LMPoutputRange ", struct.pack(">HIii", 1, 5000, 0, 2_250_001)), 4),
        (framed("sWN LMPoutputRange ", struct.pack(">HIii", 1, 5000, 10, 0)), 4),
        (framed("sWN LMDscandatacfg ", bytes(13)), 4),
        (framed("sWN LMDscandatacfg ", b"\1" + bytes(10)), 8),
        (framed("sWN LMDscandatacfg ", b"\1" + bytes(20)), 7),
        (framed("sRN LMDscandata"), 4),
        (framed("sWN LFPmeanfilter ", b"\1\0\1\0"), 4),
        (framed("sWN LFPmeanfilter ", b"\1\0\x65\0"), 4),
        (framed("sWN LFPnto1filter ", b"\2"), 4),
        (framed("sWN MSsuppmode ", b"\2"), 4),
        (framed("sWN EIHstCola ", b"\2"), 4),
    ],
)
def test_a_wrong_command_gets_its_code(command: bytes, code: int) -> None:
    bench = Bench()
    bench.ask(FRAMES["login"])
    assert payloads(bench.ask(command)) == [b"sFA" + struct.pack(">H", code)]


@pytest.mark.parametrize("left_out", ["login", "start", "run", "subscribe"])
def test_there_are_no_scans_if_a_step_is_left_out(left_out: str) -> None:
    bench = Bench()
    for command in ("login", "write content", "start", "run", "subscribe"):
        if command != left_out:
            bench.ask(FRAMES[command])
    assert not bench.scans(0.6)


def test_it_becomes_ready_only_after_spinning_up() -> None:
    bench, states = Bench(), []
    for command in ("read scan", "login", "start", "run"):
        bench.ask(FRAMES[command], 0.01)
        states.append(bench.fake.state)
    assert states == [3, 2, 4, 4]  # some drivers wait for 7 after the start and send Run then
    assert payloads(bench.ask(FRAMES["read device state"]))[0].endswith(b"\0")
    bench.listen(0.3)
    assert payloads(bench.ask(FRAMES["read state"], 0.01))[0][11] == 7


def test_settings_count_from_run_on_and_a_login_ends_measuring() -> None:
    bench = Bench()
    bench.start()
    assert len(bench.scans(0.5)) == pytest.approx(25, abs=1)
    bench.ask(FRAMES["login"])
    assert not bench.scans(0.2)
    assert payloads(bench.ask(FRAMES["read device state"]))[0].endswith(b"\0")
    bench.ask(FRAMES["scan 25"])
    assert bench.fake.head.settings.frequency == 5000
    bench.ask(FRAMES["start"])
    bench.ask(FRAMES["run"])
    scans = bench.scans(1.3)
    assert len(scans) == pytest.approx(25, abs=1)
    assert counters(scans) == list(range(len(scans)))
    assert {(len(raw_of(scan)), scan.clock) for scan in scans} == {(1081, None)}
    assert b"sFA\0\x0a" in payloads(bench.ask(FRAMES["write content"]))  # Run has logged out


def test_a_new_client_finds_it_measuring_but_must_subscribe_and_log_in_again() -> None:
    bench = Bench()
    bench.start(FRAMES["scan 25"])
    bench.scans(0.3)
    bench.fake.reconnected(bench.now_s)
    assert not bench.listen(0.2)
    assert bench.ask(FRAMES["write content"]) == FRAMES["write denied"]
    assert payloads(bench.ask(FRAMES["read state"]))[0][11] == 7
    bench.ask(FRAMES["subscribe"])
    scans = bench.scans(0.2)
    assert len(raw_of(scans[0])) == 1081
    assert counters(scans)[0] > 10
    assert bench.ask(FRAMES["poll"])[8:23] == b"sRA LMDscandata"


@pytest.mark.parametrize(("kept_by", "points"), [("store", 1081), ("read scan", 541)])
def test_without_storing_a_reboot_loses_the_settings(kept_by: str, points: int) -> None:
    bench = Bench()
    bench.start(FRAMES["scan 25"], FRAMES[kept_by])
    bench.scans(0.2)
    bench.fake.reboot(bench.now_s)
    assert not bench.listen(0.5)
    bench.start()
    scans = bench.scans(0.2)
    assert {len(raw_of(scan)) for scan in scans} == {points}
    assert scans[0].sent_us < 1_000_000  # its clock began anew
    [power_ons] = [p for p in payloads(bench.ask(framed("sRN ODpwrc"))) if p.startswith(b"sRA")]
    assert power_ons[-1] == 0x40


def test_content_and_interval_of_the_telegram_are_as_set() -> None:
    bench = Bench()
    everything = bytes.fromhex("0300 01 00 00 0100 01 01 01 01 0003")
    bench.start(framed("sWN LMDscandatacfg ", everything))
    scans = bench.scans(0.5)
    assert {b - a for a, b in pairwise(counters(scans))} == {3}
    scan = scans[0]
    assert list(scan.channels) == ["DIST1", "DIST2", "RSSI1", "RSSI2"]
    assert raw_of(scan)[270] == pytest.approx(5000, abs=60)
    assert set(raw_of(scan, "DIST2")) == set(raw_of(scan, "RSSI2")) == {0}
    assert 0 < min(raw_of(scan, "RSSI1")) <= max(raw_of(scan, "RSSI1")) < 255
    assert (scan.encoders, scan.position) == (((0, 0),), (0.0,) * 7)
    assert (scan.name, scan.comment) == ("not defined", "")
    assert scan.clock is not None
    assert scan.clock[:3] == (1970, 1, 1)


def test_its_clock_wraps_and_drifts_and_paces_the_scans() -> None:
    bench = Bench()
    bench.fake.clock_offset_us = 2**32 - 600_000
    bench.fake.drift_ppm = 10_000.0
    bench.start()
    scans = bench.scans(2.0)
    assert len(scans) == pytest.approx(101, abs=1)
    sent_us = [scan.sent_us for scan in scans]
    assert {(b - a) % 2**32 for a, b in pairwise(sent_us)} <= {19_999, 20_000, 20_001}
    assert sum(b < a for a, b in pairwise(sent_us)) == 1
