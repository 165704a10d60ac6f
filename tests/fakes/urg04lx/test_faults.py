"""What can go wrong with the fake URG-04LX, each by one attribute or event."""

import pytest

from fakes.faults.timetable import Schedule, order_from_text
from fakes.wires.wire import MemoryPort, Wire
from tests.fakes.urg04lx.bench import Bench, replies, scan_of, status

FULL = b"MD0044072501000"


def streaming(**attributes: object) -> Bench:
    """A bench whose stream of one step is quiet just now."""
    bench = Bench()
    bench.ask(b"MD0384038401000", 0.09)
    for name, value in attributes.items():
        setattr(bench.fake, name, value)
    return bench


def test_a_damaged_message_differs_in_one_byte_and_a_lost_line_is_missing() -> None:
    [good] = replies(Bench().ask(b"PP"))
    bad = Bench(), Bench()
    bad[0].fake.damaged_rate = bad[1].fake.lost_line_rate = 1.0
    damaged, shorter = (bench.ask(b"PP") for bench in bad)
    assert sum(a != b for a, b in zip(good, damaged, strict=True)) == 1
    lines = good[:-2].split(b"\n")
    assert shorter[:-2].split(b"\n") in [lines[:k] + lines[k + 1 :] for k in range(len(lines))]
    bad[0].fake.damaged_rate, bad[0].fake.cut_next = 0.0, True
    assert bad[0].ask(b"PP") == good[: len(good) // 2]
    assert bad[0].ask(b"PP") == good


def test_the_serial_number_may_have_a_line_break_and_a_wrong_sum() -> None:
    reply = Bench(splits_serial=True).one(b"VV")
    assert reply.endswith(b"PROT:SCIP 2.0;N\nSERI:H06\n14967;0\n\n")


def test_silence_and_deafness_and_lost_and_late_answers() -> None:
    bench = streaming(mute=True)
    assert bench.hear(0.5) == b""
    bench.fake.mute, bench.fake.deaf = False, True
    assert len(replies(bench.ask(b"QT", 0.5))) == 5
    bench.fake.deaf = False
    assert bench.one(b"QT") == b"QT\n00P\n\n"
    bench.fake.answers_lost = 1
    assert [bench.ask(b"QT") for _ in "12"] == [b"", b"QT\n00P\n\n"]
    for late in ("late_s", "slow_answer_s"):
        setattr(bench.fake, late, 0.2)
        assert (bench.ask(b"QT", 0.15), bench.hear(0.1)) == (b"", b"QT\n00P\n\n")
        setattr(bench.fake, late, 0.0)


def test_a_laser_that_goes_off_by_itself_ends_the_stream_without_a_word() -> None:
    bench = streaming()
    bench.fake.switch_laser_off(bench.now_s)
    assert bench.hear(0.5) == b""
    assert bench.status(b"GD0044072500") == "10"
    bench.fake.laser_fails = True
    assert [bench.status(b"BM"), bench.status(FULL)] == ["01", "10"]


def test_after_a_restart_it_is_as_at_power_on() -> None:
    bench = streaming()
    bench.fake.start_silent_s = 1.0
    bench.fake.restart(bench.now_s)
    assert bench.ask(b"QT", 0.9) == b""
    bench.hear(0.2)
    assert bench.fake.baud == 19200
    assert bench.ask(b"QT") == b"QT\nE\n\n"
    assert bench.ask(b"SCIP2.0") == b"SCIP2.0\n0\n\n"
    assert b"LASR:OFF" in bench.ask(b"II", 0.3)
    assert b"TIME:0005" in bench.ask(b"II", 0.3)


def test_hardware_trouble_ends_a_stream_and_is_told_until_it_is_over() -> None:
    bench = streaming(trouble=60)
    [told] = replies(bench.hear(0.5))
    assert (status(told), told.split(b"\n")[0]) == ("60", b"MD0384038401000")
    assert [bench.status(line) for line in (b"BM", FULL, b"QT")] == ["01", "60", "00"]
    assert b"STAT:Sensor trouble 60." in bench.one(b"II")
    bench.fake.trouble = 0
    assert bench.status(b"BM") == "00"


def test_a_stream_stops_to_check_an_error_and_is_resumed() -> None:
    bench = streaming(trouble=21)
    assert [status(reply) for reply in replies(bench.hear(0.5))] == ["21"]
    bench.fake.trouble = 0
    assert [status(reply) for reply in replies(bench.hear(0.25))][:2] == ["98", "99"]


def test_it_streams_already_when_the_host_connects_and_streams_on_when_it_goes() -> None:
    bench = Bench(fresh=True)
    bench.fake.baud = 750000
    bench.fake.leave_streaming(bench.now_s)
    assert len(replies(bench.hear(1.0), is_cut=True)) == pytest.approx(10, abs=1)
    bench.fake.reconnected(bench.now_s)
    assert bench.hear(0.3).count(b"\n99b\n") == 3
    bench.fake.trouble = 70
    bench.fake.leave_streaming(bench.now_s)  # which it can't
    assert b"99b" not in bench.hear(0.3)[2137:]


def test_frozen_it_tells_the_same_values_with_new_times() -> None:
    bench = streaming(frozen=True)
    told = [scan_of(reply) for reply in replies(bench.hear(0.5))]
    assert len({time_ms for time_ms, _ in told}) == len(told) > 3
    assert len({tuple(values) for _, values in told}) == 1


def test_a_step_can_be_dark_or_tell_what_it_is_set_to() -> None:
    bench = Bench(noise=0.0, remission_at={100: 0.05, 2000: 0.05}, values_at={101: 7, 102: 1 << 40})
    bench.ask(b"BM", 0.3)
    assert scan_of(bench.one(b"GD0099010300"))[1] == [2000, 2019, 7, (1 << 18) - 1, 2000]
    bench.fake.remission = 0.02
    bench.hear(0.2)
    assert scan_of(bench.one(b"GD0099009900"))[1] == [1]


def test_a_command_of_another_model_can_hang_it_until_the_power_is_cycled() -> None:
    bench = Bench(hangs_at_extensions=True)
    assert bench.ask(b"QT") != b""
    assert [bench.ask(line, 0.3) for line in (b"ME0044072501000", b"QT")] == [b"", b""]
    bench.fake.restart(bench.now_s)
    assert bench.ask(b"QT") == b"QT\nE\n\n"


def test_a_command_can_be_refused_and_hardly_any_is_obeyed_while_firmware_is_awaited() -> None:
    bench = Bench(refuse={"PP": "0A"})
    assert bench.ask(b"PP") == b"PP\n0Aa\n\n"
    bench.fake.updates_firmware = True
    told = [bench.status(line) for line in (b"PP", b"BM", b"QT", b"VV", b"II", b"SCIP2.0", b"RS")]
    assert told == ["0I", "0I", "0I", "00", "00", "0E", "00"]


def test_faults_are_ordered_by_a_timetable() -> None:
    bench, port = Bench(), MemoryPort()
    wire = Wire(bench.fake, port, seed=1)
    orders = (
        "leave_streaming@1s",
        "mute@2s-3s",
        "trouble=60@4s",
        "restart@5s",
        "values_at.384=7@0s",
    )
    schedule = Schedule([order_from_text(text) for text in orders], {"": (bench.fake, wire)})
    bench.fake.baud = 500000
    heard = []
    for k in range(60):
        schedule.step(bench.now_s + k * 0.1)
        wire.step(bench.now_s + k * 0.1)
        heard.append(b"".join(port.read()))
    seconds = [b"".join(heard[k : k + 10]) for k in range(0, 60, 10)]
    assert [bool(part) for part in seconds] == [False, True, False, True, True, False]
    assert b"\n60V\n" in seconds[4]
