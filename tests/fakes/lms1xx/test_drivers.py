"""The fake LMS111 with hosts that do things in their own order, or in no order at all."""

import re
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fakes.lms1xx.device import Client, FakeLms111
from tests.support.cases import examples
from tests.support.devices.bench_lms111 import START_S, Bench, five_metres, payloads
from tests.support.devices.lms111_vectors import FRAMES, TEXTS, framed, texted


@pytest.mark.parametrize("run_first", [True, False], ids=["Run, then ready", "ready, then Run"])
def test_drivers_that_read_each_answer_with_one_read_of_a_hundred_bytes_are_content(
    run_first: bool,
) -> None:
    bench = Bench(binary=False)
    states = ["sRN STlms"] * 15
    for command, said in (
        ("sMN SetAccessMode 03 F4724744", "sAN SetAccessMode 1"),
        (
            "sMN mLMPsetscancfg +2500 +1 +2500 -450000 +2250000",
            "sAN mLMPsetscancfg 0 9C4 1 9C4 FFF92230 225510",
        ),
        ("sRN LMPscancfg", "sRA LMPscancfg 9C4 1 9C4 FFF92230 225510"),
        ("sWN LMDscandatacfg 01 00 0 0 0 00 00 0 0 0 0 +1", "sWA LMDscandatacfg"),
        ("sRN LMPoutputRange", TEXTS["range is"].decode()),
        ("sMN LMCstartmeas", "sAN LMCstartmeas 0"),
        *((state, "sRA STlms ") for state in ([] if run_first else states)),
        ("sMN Run", "sAN Run 1"),
        *((state, "sRA STlms ") for state in (states if run_first else [])),
    ):
        answer = bench.say(command, 0.05)
        assert answer.startswith(said)
        assert len(answer) <= 98
    assert bench.say("sRN STlms").startswith("sRA STlms 7 0 8 00:00:")
    heard = bench.ask(texted("sEN LMDscandata 1"), 0.5)
    assert texted("sEA LMDscandata 1") in heard
    found = re.findall(rb"\x02sSN LMDscandata [^\x02\x03]*\x03", heard)
    assert len(found) == pytest.approx(12, abs=1)
    for scan in found:
        assert b" DIST1 3F800000 00000000 FFF92230 9C4 439 " in scan
        assert scan.endswith(b" 0 0 0 0 0 0\x03")


def test_standby_stops_the_mirror_and_starting_needs_no_second_login() -> None:
    bench = Bench()
    bench.start()
    assert bench.scans(0.2)
    assert b"sFA\0\1" in payloads(bench.ask(FRAMES["stop"]))
    bench.ask(FRAMES["login"])
    for command, state in (("start", 4), ("standby", 2), ("start", 4), ("stop", 2)):
        bench.ask(FRAMES[command])
        assert bench.fake.state == state


def joined(fake: FakeLms111, now_s: float) -> Client:
    client = fake.connect(now_s)
    assert client is not None
    return client


def test_two_hosts_have_their_own_login_and_subscription_and_share_the_mirror() -> None:
    fake = FakeLms111(five_metres, seed=1)
    one, two = joined(fake, 100.0), joined(fake, 100.0)
    for name in ("login", "start", "run", "subscribe"):
        one.exchange(100.1, FRAMES[name])
    two.exchange(100.1, FRAMES["subscribe"])
    heard = [host.exchange(101.0, b"") for host in (one, two)]
    assert heard[0].count(b"sSN LMDscandata") == heard[1].count(b"sSN LMDscandata") > 20
    two.exchange(101.05, FRAMES["write content"])
    assert FRAMES["write denied"] in two.exchange(101.1, b"")  # the login is the other's
    two.exchange(101.1, FRAMES["login"])
    before = one.exchange(101.2, b"")
    assert one.exchange(102.0, b"").count(b"sSN") == 0, before  # a login stops it for all
    assert fake.state == 2


def test_no_more_hosts_get_in_than_it_has_room_for() -> None:
    fake = FakeLms111(five_metres, 1)
    fake.max_clients = 2
    one, two = joined(fake, 0.0), joined(fake, 0.0)
    assert fake.connect(0.1) is None
    for _ in range(2):
        two.left(0.2)
    joined(fake, 0.3).exchange(0.3, FRAMES["read scan"])
    assert fake.connect(0.4) is None
    assert one.exchange(0.4, b"") == b""


def test_a_reboot_is_answered_in_the_old_dialect_and_throws_other_hosts_out() -> None:
    fake = FakeLms111(five_metres, seed=1)
    host, other = joined(fake, 100.0), joined(fake, 100.0)
    for frame in (FRAMES["login"], FRAMES["set ascii"]):
        host.exchange(100.0, frame)
    host.exchange(100.1, FRAMES["reboot"])
    assert (other.gone, host.gone) == (True, False)
    assert host.exchange(100.2, b"") == framed("sAN mSCreboot ")
    again = joined(fake, 100.3)
    again.exchange(100.3, texted("sRN LocationName"))
    assert again.exchange(100.4, b"") == texted("sRA LocationName B not defined")


def test_after_power_up_hosts_are_refused_then_not_heard_then_served() -> None:
    fake = FakeLms111(five_metres, 1)
    fake.refuse_connections_s, fake.start_silent_s = 5.0, 10.0
    fake.exchange(100.0, b"")
    assert fake.connect(104.9) is None
    client = joined(fake, 105.0)
    client.exchange(109.0, FRAMES["read scan"])
    assert client.exchange(109.5, b"") == b""
    client.exchange(110.0, FRAMES["read scan"])
    assert client.exchange(110.1, b"") == FRAMES["scan is 50"]
    fake.reboot(111.0)
    assert fake.connect(115.0) is None


COMMANDS = {
    True: [FRAMES[name] for name in sorted(set(FRAMES) - {"scan A", "scan B", "reboot"})],
    False: [texted(text) for text in TEXTS.values()],
}
ANSWERS = {
    True: re.compile(rb"s(FA..|[RWA]A .+|[AE][NA] .+)", re.DOTALL),
    False: re.compile(rb"\x02s(FA [0-9A-F]+|[RWA][AN] [^\x02\x03]+)\x03"),
}


@settings(max_examples=examples(15))
@given(st.data(), st.booleans(), st.floats(0.02, 0.7))
def test_in_any_order_each_command_gets_one_answer_or_refusal(
    data: st.DataObject, binary: bool, wait_s: float
) -> None:
    bench = Bench(binary=binary)
    for command in data.draw(st.lists(st.sampled_from(COMMANDS[binary]), max_size=20)):
        payload = command[8:-1] if binary else command[1:-1]
        if payload[:3] not in (b"sRN", b"sWN", b"sMN", b"sEN"):
            continue
        heard = bench.ask(command, wait_s)
        answers = [p for p in payloads(heard) if p[:3] != b"sSN"] if binary else [heard]
        [answer] = answers
        assert ANSWERS[binary].fullmatch(answer)
        assert b"sFA" in answer or payload.split(b" ")[1] in answer


PIECES = st.lists(
    st.binary(max_size=40)
    | st.sampled_from([*FRAMES.values(), *COMMANDS[False]])
    | st.builds(
        framed,
        st.sampled_from(["sRN", "sWN", "sMN", "sEN", "sRI0", "sMN SetAccessMode "])
        | st.text(st.characters(codec="latin-1"), max_size=12),
        st.binary(max_size=30),
    ),
    max_size=20,
)


@settings(max_examples=examples(20))
@given(st.booleans(), PIECES, st.floats(0.0, 3.0))
def test_no_bytes_break_it_and_it_answers_afterwards(
    binary: bool, pieces: list[bytes], step_s: float
) -> None:
    bench = Bench(binary=binary)
    for piece in pieces:
        bench.ask(piece[:300], step_s)
    bench.now_s += 2.0
    bench.fake.reconnected(bench.now_s)
    command = framed if bench.fake.binary else texted
    assert b"not defined" in bench.ask(command("sRN LocationName"))


@settings(max_examples=examples(10))
@given(st.lists(st.integers(0, 400)))
def test_where_the_hosts_stream_is_cut_makes_no_difference(cuts: list[int]) -> None:
    names = ("login", "scan 25", "write content rssi", "read state", "start", "run", "subscribe")
    stream = b"".join(FRAMES[name] for name in names)
    edges = [0, *sorted(min(cut, len(stream)) for cut in cuts), len(stream)]
    whole, cut = Bench(), Bench()
    whole.fake.exchange(START_S, stream)
    for a, b in pairwise(edges):
        assert cut.fake.exchange(START_S, stream[a:b]) == b""
    assert cut.listen(0.4) == whole.listen(0.4)


@settings(max_examples=examples(20))
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
