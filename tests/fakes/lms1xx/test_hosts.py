"""The fake LMS111 as hosts of all kinds meet it: in text, several at once, and popular drivers."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fakes.lms1xx.device import Connected, FakeLms111
from tests.support.bench_lms111 import (
    F64,
    FRAMES,
    TEXTS,
    Bench,
    five_metres,
    framed,
    payloads,
    raw_of,
)


def text_bench(**attributes: object) -> Bench:
    """A fake that speaks CoLa-A."""
    bench = Bench()
    bench.fake.binary = False
    for name, value in attributes.items():
        setattr(bench.fake, name, value)
    return bench


def ask(bench: Bench, text: str, wait_s: float = 0.02) -> str:
    """The text of the answer to a command, which must be one whole telegram."""
    answer = bench.ask(b"\x02" + text.encode() + b"\x03", wait_s)
    assert re.fullmatch(rb"\x02[^\x02\x03]*\x03", answer), answer
    return answer[1:-1].decode()


# --- CoLa-A


def test_each_answer_printed_in_the_sheet_comes_as_text() -> None:
    bench = text_bench()
    for command, answer in (
        ("write range 180", "write denied"),
        ("login", None),
        ("scan 50", "scan 50 taken"),
        ("read scan", "scan is 50"),
        ("write content rssi", None),
        ("set time", None),
    ):
        got = ask(bench, TEXTS[command].decode())
        assert answer is None or got == TEXTS[answer].decode()
        assert answer is not None or not got.startswith("sFA")
    assert ask(bench, "sRN LocationName") == TEXTS["location"].decode()
    assert ask(bench, "sRN DeviceIdent") == TEXTS["ident"].decode()
    assert ask(bench, "sRI 0") == "sRA 0 10 LMS10x_FieldEval 10 V1.36-21.10.2010"
    assert ask(bench, "sRN LMPoutputRange") == TEXTS["range is"].decode()
    assert ask(bench, "sWN LMPoutputRange 1 1388 0 1B7740") == "sWA LMPoutputRange"
    assert ask(bench, "sRN LMPoutputRange") == "sRA LMPoutputRange 1 1388 0 1B7740"


@pytest.mark.parametrize(
    ("command", "refusal"),
    [
        ("sMN mLMPsetscancfg +5000 +1", "sFA 8"),
        ("sMN mLMPsetscancfg +5000 +1 +5000 -450000 +2250000 1", "sFA 7"),
        ("sMN mLMPsetscancfg +5000 +1 +5x00 -450000 +2250000", "sFA 11"),
        ("sMN mLMPsetscancfg \x00\x01", "sFA 11"),
        ("sMN mLMPsetscancfg x00x01", "sFA 11"),
        ("sMN mLMPsetscancfg +5000 +99999 +5000 -450000 +2250000", "sFA 10"),
        ("sWN LMPoutputRange 1 1388 0 FFFFFFF0", "sFA 4"),
        ("sXX Nothing", "sFA C"),
        ("garbage", "sFA 11"),
        ("sRN FREchoFilter", "sFA 3"),
        ("sRN LFPparticle", "sFA 3"),
        ("sMN Nothing", "sFA 2"),
        ("sEN Nothing 1", "sFA F"),
    ],
)
def test_what_is_wrong_in_a_text_is_refused_by_its_code(command: str, refusal: str) -> None:
    bench = text_bench()
    ask(bench, "sMN SetAccessMode 3 F4724744")
    assert ask(bench, command) == refusal


def test_a_text_has_as_many_characters_as_it_says() -> None:
    assert ask(text_bench(), "sRN FirmwareVersion") == "sRA FirmwareVersion 9 V1.80.2  "


def test_a_reboot_is_answered_in_the_old_dialect_and_throws_other_hosts_out() -> None:
    fake = FakeLms111(five_metres, seed=1)
    host, other = fake.connect(100.0), fake.connect(100.0)
    assert host is not None
    assert other is not None
    for frame in (FRAMES["login"], FRAMES["set ascii"]):
        host.exchange(100.0, frame)
    host.exchange(100.1, FRAMES["reboot"])
    assert other.gone
    assert not host.gone
    assert host.exchange(100.2, b"") == framed("sAN mSCreboot ")
    again = fake.connect(100.3)
    assert again is not None
    again.exchange(100.3, b"\x02sRN LocationName\x03")
    assert again.exchange(100.4, b"") == b"\x02sRA LocationName B not defined\x03"


def test_five_thousand_without_a_sign_is_hexadecimal() -> None:
    bench = text_bench()
    ask(bench, "sMN SetAccessMode 03 F4724744")
    assert ask(bench, "sMN mLMPsetscancfg 5000 1 5000 -450000 +2250000").startswith(
        "sAN mLMPsetscancfg 3 "  # 0x5000 is neither a frequency nor a step
    )


def test_each_dialect_is_deaf_to_the_other() -> None:
    assert text_bench().ask(FRAMES["read scan"], 1.0) == b""
    assert Bench().ask(b"\x02sRN LMPscancfg\x03", 1.0) == b""


def test_a_new_dialect_counts_from_the_next_connection_and_may_take_its_time() -> None:
    bench = Bench()
    bench.fake.dialect_change_s = 20.0
    bench.ask(FRAMES["login"])
    assert bench.ask(FRAMES["set ascii"]) == framed("sWA EIHstCola ")  # still in the old one
    bench.fake.reconnected(bench.now_s)
    assert bench.ask(FRAMES["read scan"]) == FRAMES["scan is 50"]
    bench.now_s += 20.0
    bench.ask(b"")
    bench.fake.reconnected(bench.now_s)
    assert ask(bench, "sRN EIHstCola") == "sRA EIHstCola 0"


def test_scans_in_text_say_what_scans_in_binary_say() -> None:
    binary, text = Bench(), text_bench()
    for bench in (binary, text):
        bench.fake.noise_m = 0.0
        bench.fake.settling_scans = 0
    binary.start()
    [scan] = [p for p in payloads(binary.ask(b"", 0.03)) if p.startswith(b"sSN LMDscandata ")][:1]
    for command in ("sMN SetAccessMode 03 F4724744", "sMN LMCstartmeas", "sMN Run"):
        assert not ask(text, command).startswith("sFA")
    text.now_s += text.fake.spin_up_s
    sent = text.ask(b"\x02sEN LMDscandata 1\x03", 0.04)
    tokens = re.findall(rb"\x02(sSN LMDscandata [^\x03]*)\x03", sent)[0].split(b" ")
    start = tokens.index(b"DIST1") + 6
    count = int(tokens[start - 1], 16)
    assert [int(token, 16) for token in tokens[start : start + count]] == raw_of(scan)
    assert tokens[start - 5 : start] == [b"3F800000", b"00000000", b"FFF92230", b"1388", b"21D"]


@settings(max_examples=60)
@given(
    binary=st.booleans(),
    pieces=st.lists(st.one_of(st.binary(max_size=40), st.sampled_from(
        [*FRAMES.values(), *(b"\x02" + text + b"\x03" for text in TEXTS.values())]
    )), max_size=30),
)  # fmt: skip
def test_no_bytes_break_it_and_it_answers_afterwards(binary: bool, pieces: list[bytes]) -> None:
    bench = Bench()
    bench.fake.binary = binary
    for piece in pieces:
        bench.ask(piece[:300])
    bench.now_s += 2.0
    bench.fake.reconnected(bench.now_s)
    spoken = bench.fake.binary
    command = framed("sRN LocationName") if spoken else b"\x02sRN LocationName\x03"
    assert b"not defined" in bench.ask(command)


# --- several hosts


def joined(fake: FakeLms111, now_s: float) -> Connected:
    client = fake.connect(now_s)
    assert client is not None
    return client


def test_two_hosts_have_their_own_login_and_subscription_and_share_the_mirror() -> None:
    fake = FakeLms111(five_metres, seed=1)
    one, two = joined(fake, 100.0), joined(fake, 100.0)
    for frame in (FRAMES["login"], FRAMES["start"], FRAMES["run"], FRAMES["subscribe"]):
        one.exchange(100.1, frame)
    two.exchange(100.1, FRAMES["subscribe"])
    heard = [host.exchange(101.0, b"") for host in (one, two)]
    assert heard[0].count(b"sSN LMDscandata") == heard[1].count(b"sSN LMDscandata") > 20
    two.exchange(101.05, FRAMES["write content"])
    assert FRAMES["write denied"] in two.exchange(101.1, b"")  # the login is the other's
    two.exchange(101.1, FRAMES["login"])
    before = one.exchange(101.2, b"")
    assert one.exchange(102.0, b"").count(b"sSN") == 0, before  # a login stops it for all
    assert fake.state == 2
    two.left(102.0)
    assert joined(fake, 102.0).exchange(102.1, b"") == b""


# --- drivers that people use


def test_a_driver_that_polls_for_readiness_and_reads_all_fields_is_content() -> None:
    bench = Bench()
    assert payloads(bench.ask(FRAMES["read device state"])) == [b"sRA SCdevicestate \1"]
    bench.ask(FRAMES["login"])
    assert payloads(bench.ask(FRAMES["read device state"])) == [b"sRA SCdevicestate \0"]
    for command in (FRAMES["start"], FRAMES["run"]):
        bench.ask(command)
    for _ in range(10):
        [answer] = payloads(bench.ask(framed("sRN SCdevicestate")))
        if answer == b"sRA SCdevicestate \1":
            break
        bench.now_s += 1.0
    assert answer == b"sRA SCdevicestate \1"
    for number in range(30):
        [answer] = payloads(bench.ask(framed(f"sRN field{number:03}")))
        assert answer == b"sRA field%03d \0" % number


def test_a_driver_that_reads_each_answer_with_one_read_of_a_hundred_bytes_is_content() -> None:
    bench = text_bench()

    def one_read(command: str) -> str:
        sent = bench.ask(b"\x02" + command.encode() + b"\x03", 0.02)
        assert len(sent) <= 100
        assert sent[:1] + sent[-1:] == b"\x02\x03"
        assert sent.count(b"\x02") == 1
        return sent[1:-1].decode()

    assert one_read("sMN SetAccessMode 03 F4724744") == "sAN SetAccessMode 1"
    assert one_read("sMN mLMPsetscancfg +2500 +1 +2500 -450000 +2250000").startswith(
        "sAN mLMPsetscancfg 0 9C4 1 9C4 FFF92230 225510"
    )
    assert one_read("sRN LMPscancfg") == "sRA LMPscancfg 9C4 1 9C4 FFF92230 225510"
    assert one_read("sWN LMDscandatacfg 01 00 0 0 0 00 00 0 0 0 0 +1") == "sWA LMDscandatacfg"
    assert one_read("sMN LMCstartmeas") == "sAN LMCstartmeas 0"
    assert one_read("sMN Run") == "sAN Run 1"
    states: list[str] = []
    while not states or states[-1] != "7":
        states.append(one_read("sRN STlms").removeprefix("sRA STlms ")[:1])
        assert len(states) < 100
    assert one_read("sEN LMDscandata 1") == "sEA LMDscandata 1"
    sent = bench.ask(b"", 0.2)
    found = re.findall(rb"\x02sSN LMDscandata [^\x02\x03]*\x03", sent)
    assert len(found) >= 4
    assert b" DIST1 3F800000 00000000 FFF92230 9C4 439 " in found[0]
    assert found[0].endswith(b" 0 0 0 0 0 0\x03")


# --- what it measures


def codes_of(bench: Bench, scans: int = 3) -> list[list[int]]:
    return [raw_of(scan) for scan in bench.scans(1.0)[:scans]]


def test_a_second_echo_is_sent_where_there_is_one() -> None:
    def two_echoes(t_first_s: float, times_s: F64, bearings_rad: F64) -> F64:
        return np.array([np.full(len(times_s), 2.0), np.full(len(times_s), 6.0)])

    bench = Bench(two_echoes)
    bench.fake.noise_m = 0.0
    bench.start(FRAMES["write content all"])
    scan = bench.scans(1.0)[10]
    for name, value in ((b"DIST1", 2000), (b"DIST2", 6000)):
        at = scan.index(name) + 21
        assert set(np.frombuffer(scan[at : at + 2 * 541], ">u2").tolist()) == {value}


@pytest.mark.parametrize(("fault", "code"), [("dazzled_rate", 1), ("implausible_rate", 2)])
def test_bad_light_is_told_by_its_code(fault: str, code: int) -> None:
    bench = Bench()
    setattr(bench.fake, fault, 0.25)
    bench.start()
    [codes] = codes_of(bench, 1)
    assert 0.15 * 541 < codes.count(code) < 0.35 * 541


def test_the_filters_filter() -> None:
    odd = iter(range(10_000))

    def blinking(t_first_s: float, times_s: F64, bearings_rad: F64) -> F64:
        return np.full(len(times_s), 3.0 if next(odd) % 2 else 5.0)

    bench = Bench(blinking)
    bench.fake.noise_m = 0.0
    bench.start(framed("sWN LFPnto1filter ", b"\1"))
    assert {code for codes in codes_of(bench) for code in codes} == {3}
    bench = Bench(blinking)
    bench.fake.noise_m = 0.0
    bench.start(framed("sWN LFPmeanfilter ", b"\1\0\2\0"))
    assert {code for codes in codes_of(bench)[1:] for code in codes} == {4000}


def test_a_dirty_window_is_told_when_asked_and_changes_no_undocumented_byte_of_a_scan() -> None:
    bench = Bench()
    bench.fake.contamination, bench.fake.settling_scans = 2, 1
    bench.start()
    assert [scan[24:26] for scan in bench.scans(0.06)] == [b"\1\0", b"\0\0", b"\0\0"]
    bench.ask(FRAMES["unsubscribe"])
    assert bench.ask(FRAMES["read contamination"]) == framed("sRA LCMstate ", b"\2")


def test_models_differ_as_the_sheet_says() -> None:
    bench = Bench()
    bench.fake = FakeLms111(five_metres, 1, model="LMS100-1.23")
    bench.ask(FRAMES["login"])
    assert bench.ask(FRAMES["write range"]) == FRAMES["write denied"]
    assert b"V1.23" in bench.ask(framed("sRN FirmwareVersion"))
    with pytest.raises(ValueError, match="must be one of LMS111, LMS100"):
        FakeLms111(five_metres, 1, model="LMS999")


def test_answers_can_be_lost_late_or_cut_short() -> None:
    bench = Bench()
    bench.fake.answers_lost = 1
    assert bench.ask(FRAMES["login"]) == b""
    assert bench.ask(FRAMES["write content"]) == FRAMES["content written"]  # it had obeyed
    bench.fake.slow_answer_s = 0.5
    assert bench.ask(FRAMES["read scan"], 0.4) == b""
    assert bench.ask(b"", 0.2) == FRAMES["scan is 50"]
    bench.fake.slow_answer_s, bench.fake.cut_next = 0.0, True
    cut = bench.ask(FRAMES["read scan"])
    assert FRAMES["scan is 50"].startswith(cut)
    assert 0 < len(cut) < len(FRAMES["scan is 50"])
    bench.fake.deaf = True
    assert bench.ask(FRAMES["read scan"]) == b""
