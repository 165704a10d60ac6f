"""The fake controller against its sheet: bytes, numbers, commands, parameters."""

from pathlib import Path

import pytest

from fakes.ax3500.encoders import hex_from_counter
from tests.support.devices.bench_ax3500 import Bench

LOW, HIGH = -(2**31), 2**31 - 1
SHEET_COUNTERS = [  # section 5; those of the manual and those that follow from its rule
    *((0, "0"), (5, "5"), (8, "08"), (250, "0FA"), (2000, "7D0"), (128, "080"), (65535, "0FFFF")),
    *((91011186, "56CB872"), (HIGH, "7FFFFFFF"), (-1, "F"), (-6, "A"), (-5, "B"), (-235, "F15")),
    *((-2000, "830"), (-128, "80"), (-65536, "F0000"), (-7986091, "862455"), (LOW, "80000000")),
]
REFUSED = [
    # section 9, and what is left out here
    *("#", "# 20", "?S", "?C", "?FF", "?F", "?BS", "%EESAV", "%EELD", "%RRRRRR", "^EPPR"),
    *("^EPPR 1", "!G 1 500", "!EX", "!MG", "\x05", "\x06", "!D", "!d", "$84", "?", "!", "%", "^"),
    *("*", "hello", "?Q", "?Q3", "?Q7", "?Q00", "?QA", "?EE", " ?E", "? E", "!Q3", "!Q9", "!Q"),
    *("?K", "?D", "?W", "!Q4", "!Q7", "?Z", "?Q0" * 100),
    # parameters and values that there are not
    *("^00 04", "^01 07", "^01 08", "^07 05", "^0F 40", "^8A 00", "^89 00", "^12 00", "^7F 01"),
    *("^00  01", "^00 1", "^0 01", "^00 01 ", "^00 011", "^000", "^0", "^12", "^7F", "*A2 40"),
    *("*8C 00", "^GG", "^00 0G"),
    # motor commands
    *("!A80", "!AFF", "!A7", "!A", "!A7FF", "!A 7F", "!A7G", "!E7F"),
]


def rows(path: Path) -> list[list[str]]:
    lines = path.read_text(encoding="ascii").splitlines()
    return [line.split("\t") for line in lines if not line.startswith("#")]


def test_the_transcript_of_the_sheet_byte_by_byte() -> None:
    bench = Bench("rc", log_numbers=16)
    bench.fake.parameters[0x01] = 0xC5
    bench.fake.restart(bench.now_s)
    up = bench.run(0.7 + 34 * 0.008)
    assert up.startswith(b"Roboteq v1.9b 06/01/07\rs\rEncoder v1.7\r00\r:0000")
    for reads_end_with in (b"+\r", b""):
        bench.fake.plus_after_read = bool(reads_end_with)
        bench.fake.mode = "rc"
        assert bench.fake.exchange(bench.now_s, b"\r" * 10).endswith(b"OK\r")
        for sent, returned in ((b"^8A\r", b"68\r"), (b"^01\r", b"C5\r"), (b"^89\r", b"00\r")):
            answer = bench.fake.exchange(bench.now_s, sent)
            assert answer == sent + returned + reads_end_with
        assert bench.fake.exchange(bench.now_s, b"?E\r") == b"?E\r70\r6C\r"
        assert bench.fake.exchange(bench.now_s, b"!Q2\r") == b"!Q2\r+\r"
        zero = int(bench.wheels.turned[0]), int(bench.wheels.turned[1])
        bench.place(zero[0] + 250, zero[1] - 235)
        assert bench.fake.exchange(bench.now_s, b"?Q0\r") == b"?Q0\r0FA\r"
        assert bench.fake.exchange(bench.now_s, b"?Q1\r") == b"?Q1\rF15\r"
        bench.place(zero[0] + 2000, zero[1] - 2000)
        before = bench.fake.exchange(bench.now_s, b"?Q")
        bench.fake.send_w()
        after = bench.fake.exchange(bench.now_s, b"0\r")
        assert before + after == b"?QW0\r7D0\r"
        assert bench.fake.exchange(bench.now_s, b"?Q1\r") == b"?Q1\r830\r"
        assert bench.fake.exchange(bench.now_s, b"!a5\r") == b"!a5\r-\r"
        assert bench.run(3.01) == b"WWW"
    assert bench.run(0.0, b"%rrrrrr\r") == b"%rrrrrr\r"
    assert bench.run(0.71).startswith(b"Roboteq")


def test_counters_are_written_as_the_sheet_and_the_vectors_say(vectors: Path) -> None:
    table = [(int(count), text) for count, text, _ in rows(vectors / "ax3500_counter_replies.tsv")]
    assert len(table) == 16
    for count, text in SHEET_COUNTERS + table:
        bench = Bench()
        bench.place(count, -1 - count)
        assert bench.ask("?Q0") == [text]
        bench.place(-1 - count, count)
        assert bench.ask("?q1") == [text]
        assert Bench(counter_offset=(count, 0)).ask("?Q0") == [text]
    bench.wheels.turned = [4.9, -0.1]  # an edge counts when it has passed
    assert (bench.ask("?Q0"), bench.ask("?q1")) == (["4"], ["F"])


def test_scaled_values_are_written_as_in_the_vectors(vectors: Path) -> None:
    table = rows(vectors / "ax3500_scaled_replies.tsv")
    assert len(table) == 15
    for query, byte, text in table:
        value, bench = float(text.split()[0]), Bench()
        if query == "?M":
            bench.fake.celsius = value, -40.0
        elif text.endswith("main"):
            bench.fake.battery_v = value
        else:
            bench.fake.internal_v = value
        assert bench.ask(query)[text.endswith("internal")] == byte


def test_each_query_gives_its_values() -> None:
    bench = Bench(
        amps=(5.5, 0.0), analog_v=(0.0, 2.5, 5.0, 3.76), celsius=(25.4, 50.0), inputs=(1, 0)
    )
    bench.drive(64, -127)
    for query, lines in (
        ("?V", ["40", "7F"]),
        ("?v", ["40", "7F"]),
        ("?A", ["0B", "00"]),
        ("?P", ["81", "00"]),
        ("?R", ["7F", "40"]),
        ("?M", ["98", "5D"]),
        ("?E", ["70", "6C"]),
        ("?I", ["01", "00", "01"]),
        ("?Q2", ["0"]),
        ("^8a", ["68", "+"]),
        ("*A2", ["00", "+"]),
    ):
        assert bench.ask(query) == lines, query


def test_what_it_does_not_know_is_echoed_and_refused_and_changes_nothing() -> None:
    bench = Bench()
    before = dict(bench.fake.parameters)
    for line in REFUSED:
        assert bench.ask(line) == ["-"], line
    assert (bench.fake.parameters, bench.fake.flash_writes) == (before, 0)
    assert bench.wheels.powers == []
    assert bench.ask("?Q0") == ["0"]


@pytest.mark.parametrize("minus", [True, False])
def test_a_lone_cr_is_echoed_and_nul_and_lf_belong_to_no_line(minus: bool) -> None:
    bench = Bench(minus_on_empty=minus)
    assert bench.ask("") == (["-"] if minus else [])
    assert bench.run(0.0, b"?\x00\nE\r") == b"?\x00\nE\r70\r6C\r"
    assert bench.run(0.0, bytes(b | 0x80 for b in b"?E\r")) == b"?E\r70\r6C\r"


def test_relative_reads_clear_and_sums_add_up() -> None:
    bench = Bench()
    bench.place(30, 12)
    assert [bench.ask(q) for q in ("?Q2", "?Q4", "?Q4", "?Q2")] == [["2A"], ["1E"], ["0"], ["0C"]]
    bench.place(33, 17)
    assert [bench.ask(q) for q in ("?Q6", "?Q0", "?Q1")] == [["14"], ["0"], ["0"]]
    bench.place(34, 19)
    assert [bench.ask(q) for q in ("?Q5", "?Q0", "?Q1")] == [["2"], ["1"], ["0"]]


@pytest.mark.parametrize(
    ("rollover", "above", "below"), [("wrap", LOW + 2, HIGH - 2), ("zero", 2, -2)]
)
def test_a_counter_goes_on_beyond_either_end(rollover: str, above: int, below: int) -> None:
    bench = Bench(rollover=rollover, counter_offset=(HIGH, LOW))
    assert (bench.ask("?Q0"), bench.ask("?Q1")) == (["7FFFFFFF"], ["80000000"])
    bench.place(3, -3)
    assert bench.ask("?Q0") == [hex_from_counter(above)]
    assert bench.ask("?Q1") == [hex_from_counter(below)]


def test_parameters_are_permanent_at_once_and_take_effect_later() -> None:
    bench = Bench()
    assert bench.ask("^00") == ["01", "+"]
    assert bench.ask("^00 02") == ["+"]
    assert (bench.ask("^00"), bench.fake.mode) == (["02", "+"], "rs232")
    assert bench.run(0.0, b"^FF\r") == b"^FF\r"
    assert bench.run(0.11) == b"+\r"
    assert (bench.fake.mode, bench.fake.flash_writes) == ("rs232_watchdog", 1)
    assert bench.ask("^00 00") == ["+"]
    bench.fake.restart(bench.now_s)
    assert b"OK" not in bench.run(0.71)
    assert bench.fake.mode == "rc"


def test_motor_commands_reach_the_wheels() -> None:
    bench = Bench()
    for line in ("!A7F", "!b40", "!a00", "!B01"):
        assert bench.ask(line) == ["+"]
    full, half, least = 1.0, 64 / 127, 1 / 127
    assert bench.wheels.powers == [(full, 0.0), (full, -half), (0.0, -half), (0.0, least)]
    assert bench.ask("?V") == ["00", "01"]
    assert [bench.ask(line) for line in ("!C", "!c")] == [["+"], ["+"]]
    assert bench.fake.outputs == {"C": False, "D": False}


@pytest.mark.parametrize("mode", [0x01, 0xC5])
def test_in_mixed_mode_channel_one_is_speed_and_channel_two_steers(mode: int) -> None:
    bench = Bench()
    assert bench.ask(f"^01 {mode:02X}") == ["+"]
    bench.run(0.11, b"^FF\r")
    bench.drive(64, 10)
    bench.drive(127, 10)
    assert bench.wheels.powers == [(74 / 127, 54 / 127), (1.0, 117 / 127)]
