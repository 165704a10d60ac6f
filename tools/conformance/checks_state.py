"""Conformance test 5: what sets *suspect* and what clears it, orders, epochs, runs, restarts."""

from tools.conformance.exam import Exam, UnseenError
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
)

FIRST_NUMBERS = [1, 65_530, 32_765, 65_535, 0, 40_000]  # where gaps and `repaired` wrap


def _gap_in(exam: Exam, lost: int) -> int:
    """Frames that get lost, and one that shows it; gives the newest that is missing."""
    for _ in range(lost):
        exam.next_map([(OBSTACLE, 1)])
    gap = exam.seq
    exam.send(exam.next(POSE, pose_body()))
    return gap


def gaps(exam: Exam) -> str:
    """5: a gap sets *suspect*, `repaired` clears it, not one frame too early."""
    numbers = 0
    for k in exam.rounds(len(FIRST_NUMBERS)):
        exam.begin(12, 9, first_seq=FIRST_NUMBERS[k % len(FIRST_NUMBERS)])
        exam.tell([(FREE, 108)])
        exam.check("no frame lost")
        for lost in (1, 3):
            gap = _gap_in(exam, lost)
            exam.expect("a gap sets suspect", SUSPECT, exam.check("a gap").status & SUSPECT)
            for early in (0x7FFF, 33, 1):
                exam.send(exam.next_map([], repaired=gap - early))
                exam.check(f"repaired {early} before the gap")
            exam.send(exam.next(GEOM, exam.geom.body()))
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
        exam.begin(12, 9)
        exam.tell([(FREE, 108)])
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
        exam.begin(8, 8, first_seq=FIRST_NUMBERS[k % len(FIRST_NUMBERS)])
        exam.tell([(FREE, 64)])
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
            body = map_body(exam.origin, exam.seq, exam.geom.geom_id, 0, ops_of([(OBSTACLE, 64)]))
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
        exam.send(exam.next(GEOM, exam.geom.body()))
        exam.check("the same GEOM again")
        _gap_in(exam, 1)
        stray = map_body(exam.origin, exam.seq, exam.geom.geom_id ^ 0x55, 0, b"\x82")
        exam.send(exam.next(MAP, stray), undecided=True)
        exam.check("a MAP frame of an epoch that was never told")
        exam.geom = Geom(exam.geom.geom_id + 1 & 0xFF, width, height, exam.geom.session)
        exam.send(exam.next(GEOM, exam.geom.body()))
        exam.check("a new epoch, no map yet")
        exam.tell([(OBSTACLE, 2), (FREE, 3)])
        exam.check("a new epoch")
    return "same size and other sizes, with a gap open"


def geom_lost(exam: Exam) -> str:
    """5: a GEOM frame gets lost: nothing of the new epoch goes into the old map."""
    exam.begin(12, 9)
    exam.tell([(FREE, 108)])
    exam.check("before")
    old = exam.geom
    exam.geom = Geom(old.geom_id + 1 & 0xFF, 12, 9, old.session)
    exam.next(GEOM, exam.geom.body())
    for _ in range(4):
        body = map_body(exam.origin, exam.seq, exam.geom.geom_id, 0, ops_of([(OBSTACLE, 50)]))
        exam.send(exam.next(MAP, body), undecided=True)
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
        exam.begin(12, 9, first_seq=20_000)
        exam.tell([(FREE, 108)])
        _gap_in(exam, 1)
        exam.check("before")
        geom_id = exam.geom.geom_id ^ (0 if exam.strict else 0x80)
        exam.seq = (20_000 + step) & 0xFFFF
        exam.begun_seq = exam.seq
        exam.geom = Geom(geom_id, 12, 9, exam.geom.session ^ 0x1234)
        exam.send(exam.next(GEOM, exam.geom.body()))
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
        exam.begin(12, 9, first_seq=65_400)
        exam.tell([(FREE, 108)])
        _gap_in(exam, 1)
        exam.check("before")
        exam.skipped_ms += later_ms
        exam.seq = (exam.seq + step) & 0xFFFF
        exam.send(exam.next(POSE, pose_body()))
        exam.check(f"a POSE {later_ms} ms later")
        exam.tell([(OBSTACLE, 2)])
        exam.check(f"a map {later_ms} ms later")
    return "cuts of 50 s to 50 minutes, by the sender's clock"


def receiver_restart(exam: Exam) -> str:
    """5: a receiver that was switched off says HELLO until a GEOM comes, and holds nothing."""
    exam.begin(12, 9)
    exam.tell([(FREE, 108)])
    exam.check("before")
    if not exam.bench.restart():
        raise UnseenError("the receiver can't be switched off from here")
    exam.hello, heard = None, exam.bench.now_s()
    exam.hear_all(0.6)
    if exam.hello is None:
        raise exam.failed("HELLO after a restart", "within 0.6 s", "none")
    exam.send(exam.next_map([(OBSTACLE, 5)]), undecided=True)
    exam.hear_all(0.1)
    exam.begin(12, 9)
    exam.tell([(OBSTACLE, 3)])
    exam.check("after a restart")
    exam.hello, hello = None, exam.hello
    exam.hear_all(0.6)
    silent, exam.hello = exam.hello is None, hello
    exam.expect("no HELLO once a GEOM has come", True, silent)
    return f"HELLO, then GEOM and map, in {exam.bench.now_s() - heard:.1f} s"
