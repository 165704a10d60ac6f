"""Conformance tests 5 and 7 with mapod's own sender: repair, restarts, a line that is full."""

from tools.conformance.exam import Exam
from tools.conformance.sender_bench import TICK_S, SenderBench
from tools.conformance.wire import STALE

LOSS = 0.05
BAUD, LINE_SHARE = 115_200, 0.85


def _drive(exam: Exam, hears: bool) -> str:
    """Changes, moves, losses, a silence, a new epoch and a restart of the sender."""
    exam.needs_map()
    side = max(3, min(31, int(exam.max_cells**0.5)))
    bench = SenderBench(exam, size=side, loss=LOSS, hears=hears)
    ticks = max(60, round(300 * exam.share))
    bench.run(ticks)
    bench.world.trusted = False
    bench.run(10)
    bench.world.trusted = True
    bench.world.erase()
    bench.run(ticks // 2)
    stale = [ack.status & STALE for ack in exam.hear_all(0.5)]
    exam.expect("the sender is silent for 0.5 s: STALE", True, any(stale))
    bench.run(ticks // 3)
    bench.start_sender()
    bench.run(ticks // 2)
    bench.finish()
    frames = bench.link.frames_sent
    return f"{bench.compared} maps compared, {frames} frames of the last run, {LOSS:.0%} loss"


def repair_by_ack(exam: Exam) -> str:
    """5: what gets lost is told again, for the ACKs show it."""
    return _drive(exam, hears=True)


def repair_by_refresh(exam: Exam) -> str:
    """5: what gets lost is told again by the rolling refresh, without any way back."""
    return _drive(exam, hears=False)


def full_line(exam: Exam) -> str:
    """7: with more changes than the line carries, no tick is late by more than one."""
    exam.needs_map()
    side = max(3, min(101, int(exam.max_cells**0.5)))
    bench = SenderBench(exam, size=side, loss=0.0, baud=BAUD)
    rate, per_tick = BAUD / 10, BAUD / 10 * TICK_S  # bytes that the line carries
    waiting, most, written = 0.0, 0.0, 0
    begun_s = tick_s = exam.bench.now_s()
    for _ in range(max(100, round(250 * exam.share))):
        bench.run(1, changes=60, move_every=0)
        now_s = exam.bench.now_s()
        waiting += bench.port.wires - written - rate * (now_s - tick_s)
        waiting, written, tick_s = max(0.0, waiting), bench.port.wires, now_s
        most = max(most, waiting)
    exam.expect("bytes that wait a tick later: at most a tick's", True, most <= per_tick)
    share = written / (rate * (tick_s - begun_s))
    exam.expect("share of the line that is used: at most 0.85", True, share <= LINE_SHARE + 0.02)
    bench.finish()
    return f"{share:.0%} of {BAUD} baud in use, never more than {most / per_tick:.1f} ticks behind"
