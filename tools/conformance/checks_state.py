"""Conformance tests 5, 6 and 15: what makes a receiver doubt its map, and what ends that.

Gaps and what repairs them, orders, epochs, restarts; *stale* whichever half of the sender halts.
"""

from collections.abc import Callable
from typing import NamedTuple

from tools.conformance.exam import Exam, UnseenError
from tools.conformance.sender import TICK_S
from tools.conformance.wire import (
    FREE,
    GEOM,
    MAP,
    NEED_GEOM,
    OBSTACLE,
    POSE,
    STALE,
    SUSPECT,
    UNKNOWN,
    Geom,
    frame,
    map_body,
    ops_of,
    pose_body,
    sealed,
)

ACK_PERIOD_S = 0.1
TRIES = 5
SLACK_S = 0.12  # a machine that does something else meanwhile; nothing of it in process
FIRST_NUMBERS = [1, 65_530, 32_765, 65_535, 0, 40_000]  # where gaps and `repaired` wrap


def _gap_in(exam: Exam, lost: int) -> int:
    """Frames that get lost, and one that shows it; gives the newest that is missing."""
    for _ in range(lost):
        exam.next_map([(OBSTACLE, 1)])
    gap = exam.seq
    exam.send_pose()
    return gap


def gaps(exam: Exam) -> str:
    """5: a gap sets *suspect*, `repaired` clears it, not one frame too early."""
    numbers = 0
    for k in exam.rounds(len(FIRST_NUMBERS)):
        exam.begin_free(12, 9, first_seq=FIRST_NUMBERS[k % len(FIRST_NUMBERS)])
        exam.check("no frame lost")
        for lost in (1, 3):
            gap = _gap_in(exam, lost)
            exam.expect("a gap sets suspect", SUSPECT, exam.check("a gap").status & SUSPECT)
            for early in (0x7FFF, 33, 1):
                exam.send(exam.next_map([], repaired=gap - early))
                exam.check(f"repaired {early} before the gap")
            exam.send_geom()
            exam.check("GEOM of the same epoch while suspect")
            exam.send(exam.next_map([], repaired=gap + (lost - 1)))
            exam.expect("repaired clears suspect", 0, exam.check("repaired").status & SUSPECT)
            numbers += lost
        first = _gap_in(exam, 1)
        second = _gap_in(exam, 1)
        exam.send(exam.next_map([], repaired=first))
        exam.check("repaired up to the first of two gaps")
        exam.send(exam.next_map([], repaired=second))
        exam.check("repaired up to the second gap")
    return f"{numbers} frames lost, numbers from {FIRST_NUMBERS}"


def gap_and_jump(exam: Exam) -> str:
    """5: all cells UNKNOWN clear *suspect* as well."""
    for step in ((12, 0), (0, -9), (-12, 9), (1, 1)):
        exam.begin_free(12, 9)
        _gap_in(exam, 1)
        origin = exam.origin[0] + step[0], exam.origin[1] + step[1]
        exam.send(exam.next_map([(OBSTACLE, 3)], origin=origin))
        exam.check(f"suspect, and the window moves by {step}")
        exam.send(exam.next_map([], repaired=exam.seq))
        exam.check("repaired")
    return "moves by a whole window, and by less"


def order(exam: Exam) -> str:
    """5: older and repeated frames are dropped in silence; newer ones count over the wrap."""
    for k in exam.rounds(len(FIRST_NUMBERS)):
        exam.begin_free(8, 8, first_seq=FIRST_NUMBERS[k % len(FIRST_NUMBERS)])
        late = exam.next_map([(OBSTACLE, 9)])
        exam.tell([(FREE, 3)])
        again = exam.next_map([(OBSTACLE, 1), (FREE, 3)], repaired=exam.seq)
        bad = exam.ask().bad_frames
        for data in (late, again, again):
            exam.send(data)
        ack = exam.check("frames that come late and twice")
        exam.expect("dropped in silence: bad_frames", bad, ack.bad_frames)
        for ahead in (0x7FFE, 0x2000, 1, 2):
            exam.seq = (exam.seq + ahead - 1) & 0xFFFF
            exam.tell([(OBSTACLE, 2)])
            exam.check(f"a number {ahead} ahead")
            body = exam.map_body([(OBSTACLE, 64)])
            for behind in (0, 1, 40, 0x7FFF, 0x8000):
                exam.send(frame(MAP, exam.seq - behind, exam.t_ms, body, 0, exam.secret))
            exam.check("numbers up to 32 768 behind")
    return "late, repeated, and up to 32 768 behind; leaps ahead of up to 32 766"


def epochs(exam: Exam) -> str:
    """5: the geometry changes in mid-stream."""
    exam.begin(12, 9)
    for width, height in ((12, 9), (9, 12), (30, 4), (4, 30)):
        cells = exam.geom.width * exam.geom.height
        exam.tell([(FREE, cells - 1), (OBSTACLE, 1)])
        exam.send_geom()
        exam.check("the same GEOM again")
        _gap_in(exam, 1)
        stray = map_body(exam.origin, exam.seq, exam.geom.geom_id ^ 0x55, 0, b"\x82")
        exam.send(exam.next(MAP, stray), undecided=True)
        exam.check("a MAP frame of an epoch that was never told")
        exam.geom = Geom(exam.geom.geom_id + 1 & 0xFF, width, height, exam.geom.session)
        exam.send_geom()
        exam.check("a new epoch, no map yet")
        exam.tell([(OBSTACLE, 2), (FREE, 3)])
        exam.check("a new epoch")
    return "same size and other sizes, with a gap open"


def geom_lost(exam: Exam) -> str:
    """5: a GEOM frame gets lost: nothing of the new epoch goes into the old map."""
    exam.begin_free(12, 9)
    exam.check("before")
    old = exam.geom
    exam.geom = Geom(old.geom_id + 1 & 0xFF, 12, 9, old.session)
    exam.next(GEOM, exam.geom.body())
    for _ in range(4):
        exam.send(exam.next(MAP, exam.map_body([(OBSTACLE, 50)])), undecided=True)
    new, exam.geom = exam.geom, old
    ack = exam.check("MAP frames of an epoch whose GEOM was lost")
    exam.expect("a gap is known", SUSPECT, ack.status & SUSPECT)
    if exam.strict:
        exam.expect("NEED_GEOM is told", NEED_GEOM, ack.status & NEED_GEOM)
    exam.geom = new
    exam.send(exam.next(GEOM, new.body()))
    exam.tell([(OBSTACLE, 4)])
    exam.check("its GEOM at last")
    return "the new epoch's MAP frames are ignored until its GEOM comes"


def sender_restart(exam: Exam) -> str:
    """5: a new session restarts the count, wherever it begins, and forgets every cell."""
    for step in (-5000, 0, 3, 0x7FFF, -0x8000):
        exam.begin_free(12, 9, first_seq=20_000)
        _gap_in(exam, 1)
        exam.check("before")
        geom_id = exam.geom.geom_id ^ (0 if exam.strict else 0x80)
        exam.seq = (20_000 + step) & 0xFFFF
        exam.begun_seq = exam.seq
        exam.geom = Geom(geom_id, 12, 9, exam.geom.session ^ 0x1234)
        exam.send_geom()
        ack = exam.check("a new session")
        if exam.strict:
            exam.expect("a new session: stale until its map comes", STALE, ack.status & STALE)
        exam.tell([(UNKNOWN, 1), (OBSTACLE, 1)])
        exam.check("a new session, and its map")
    return "numbers that go back, go on, and leap"


def long_cut(exam: Exam) -> str:
    """15: after a minute without a frame the next counts, whatever its number; all is UNKNOWN."""
    if not exam.strict:
        raise UnseenError("said by this copy of the sheet alone; --strict examines it")
    for later_ms, step in ((60_000, -300), (61_000, 0), (50_000, 5), (3_000_000, 0x7FFF)):
        exam.begin_free(12, 9, first_seq=65_400)
        _gap_in(exam, 1)
        exam.check("before")
        exam.skipped_ms += later_ms
        exam.seq = (exam.seq + step) & 0xFFFF
        exam.send_pose()
        exam.check(f"a POSE {later_ms} ms later")
        exam.tell([(OBSTACLE, 2)])
        exam.check(f"a map {later_ms} ms later")
    return "cuts of 50 s to 50 minutes, by the sender's clock"


def receiver_restart(exam: Exam) -> str:
    """5: a receiver that was switched off says HELLO until a GEOM comes, and holds nothing."""
    exam.begin_free(12, 9)
    exam.check("before")
    if not exam.bench.restart():
        raise UnseenError("the receiver can't be switched off from here")
    begun_s = exam.bench.now_s()
    if not exam.says_hello():
        raise exam.failed("HELLO after a restart", "within 0.6 s", "none")
    exam.send(exam.next_map([(OBSTACLE, 5)]), undecided=True)
    exam.hear_all(0.1)
    exam.begin(12, 9)
    exam.tell([(OBSTACLE, 3)])
    exam.check("after a restart")
    exam.expect("no HELLO once a GEOM has come", True, not exam.says_hello())
    return f"HELLO, then GEOM and map, in {exam.bench.now_s() - begun_s:.1f} s"


# Test 6: halts

Tick = Callable[[Exam], None]


def _both(exam: Exam) -> None:
    exam.send_pose()
    _map(exam)


def _map(exam: Exam) -> None:
    exam.tell([(FREE, 5)])


def _pose_and_other_epoch(exam: Exam) -> None:
    """The map half goes on in an epoch that was never told."""
    exam.send_pose()
    body = map_body(exam.origin, exam.seq, exam.geom.geom_id ^ 1, 0, ops_of([(FREE, 5)]))
    exam.send(exam.next(MAP, body), undecided=True)


def _pose_and_damaged_map(exam: Exam) -> None:
    """The map half goes on, but none of its frames arrives whole."""
    exam.send_pose()
    data = bytearray(exam.next_map([(FREE, 5)]))
    data[12] ^= 0x10
    exam.send(bytes(data))


def _pose_and_bad_map(exam: Exam) -> None:
    """The map half writes operations that pass the last cell."""
    exam.send_pose()
    exam.send(exam.next_map([(OBSTACLE, 63), (FREE, 63)]))


def _pose_and_old_map(exam: Exam) -> None:
    """The map half repeats an old frame."""
    exam.send_pose()
    body = exam.map_body([(FREE, 5)])
    exam.send(frame(MAP, exam.seq - 7, exam.t_ms, body, 0, exam.secret))


def _map_and_short_pose(exam: Exam) -> None:
    """The pose half writes frames of another length."""
    _map(exam)
    whole = exam.next(POSE, pose_body()[:-4])
    exam.send(whole if exam.key else sealed(whole[:-4]))


HALTS: dict[str, Tick] = {
    "the sender halts": lambda exam: None,
    "only the map half halts": Exam.send_pose,
    "only the pose half halts": _map,
    "nothing but GEOM comes": Exam.send_geom,
    "maps of another epoch": _pose_and_other_epoch,
    "maps that are damaged": _pose_and_damaged_map,
    "maps whose operations do not fit": _pose_and_bad_map,
    "an old map again and again": _pose_and_old_map,
    "poses of another length": _map_and_short_pose,
}


def halts(exam: Exam) -> str:
    """6: *stale* no later than `stale_ms`, and not while both halves go on."""
    latest_ms = []
    for k in range(2 * len(HALTS) if exam.share > 0.5 else len(HALTS)):
        name, tick = list(HALTS.items())[k % len(HALTS)]
        stale_ms = (150, 300, 700)[k // len(HALTS) % 2 + (k % 2)]
        exam.begin(9, 7, stale_ms=stale_ms)
        whole_s = _expect_fresh(exam, "both halves go on")
        exam.tail.clear()
        latest_ms.append(_time_until_stale(exam, name, tick, whole_s) - stale_ms)
        _expect_fresh(exam, f"both again, after: {name}")
    return f"{len(latest_ms)} halts, told at most {max(latest_ms):.0f} ms after stale_ms"


def silence(exam: Exam) -> str:
    """6: a receiver that has never heard both halves is stale."""
    for words, tick in (("only poses", Exam.send_pose), ("only maps", _map)):
        exam.begin(9, 7)
        if not exam.strict:  # one may count what it had from the run before
            _run(exam, tick, exam.geom.stale_ms / 1000 + ACK_PERIOD_S)
        exam.expect(f"{words} since the start: STALE", {STALE}, _run(exam, tick, 0.3).told)
    return "only poses, and only maps, from the start"


class _Ticks(NamedTuple):
    """Ticks of the sender, one after the other."""

    told: set[int]  # STALE or 0, by the ACKs of that time
    last_s: float  # when the last of them began
    slowest_s: float  # the longest that we ourselves took for one


def _run(exam: Exam, tick: Tick, seconds: float) -> _Ticks:
    """Ticks for so long."""
    now_s = exam.bench.now_s
    end_s, last_s, slowest_s, told = now_s() + seconds, now_s(), 0.0, set[int]()
    while now_s() < end_s - 1e-6:
        last_s = now_s()
        tick(exam)
        told |= {ack.status & STALE for ack in exam.hear(TICK_S)}
        slowest_s = max(slowest_s, now_s() - last_s)
    return _Ticks(told, last_s, slowest_s)


def _expect_fresh(exam: Exam, what: str) -> float:
    """No STALE while both halves come; if we ourselves are too slow for that, once more.

    Gives when the last of both were sent.
    """
    for _ in range(TRIES):
        before = _run(exam, _both, 0.1 + ACK_PERIOD_S)
        ticks = _run(exam, _both, 0.4)
        if max(before.slowest_s, ticks.slowest_s) < exam.geom.stale_ms / 2000:
            exam.expect(f"{what}: STALE", {0}, ticks.told)
            return ticks.last_s
    raise UnseenError("this machine is too busy: it sends too late itself")


def _time_until_stale(exam: Exam, name: str, tick: Tick, whole_s: float) -> float:
    """Milliseconds from the last whole tick until an ACK says STALE."""
    stale_ms, slack_s = exam.geom.stale_ms, TICK_S if exam.bench.in_process else TICK_S + SLACK_S
    latest_s = stale_ms / 1000 + ACK_PERIOD_S + slack_s + TICK_S
    slowest_s, passed_s = 0.0, 0.0
    while passed_s < latest_s + slowest_s:
        ticks = _run(exam, tick, TICK_S / 2)
        slowest_s = max(slowest_s, ticks.slowest_s - TICK_S)
        passed_s = exam.bench.now_s() - whole_s
        if STALE in ticks.told:
            if passed_s < stale_ms / 1000 - 0.001:
                raise exam.failed(f"{name}: STALE not before {stale_ms} ms", "0", "STALE")
            return passed_s * 1000
    within = f"within {stale_ms} ms, told by an ACK {ACK_PERIOD_S * 1000:.0f} ms later"
    raise exam.failed(f"{name}: STALE", within, f"not after {passed_s * 1000:.0f} ms")
