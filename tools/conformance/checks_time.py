"""Conformance test 6: *stale* within `stale_ms`, whichever half of the sender halts."""

from collections.abc import Callable

from tools.conformance.exam import Exam, UnseenError
from tools.conformance.wire import (
    FREE,
    GEOM,
    MAP,
    OBSTACLE,
    POSE,
    STALE,
    Ack,
    frame,
    map_body,
    ops_of,
    pose_body,
    sealed,
)

TICK_S = 0.02
ACK_PERIOD_S = 0.1
TRIES = 5
SLACK_S = 0.12  # a machine that does something else meanwhile; nothing of it in process
Tick = Callable[[Exam], None]


def _pose(exam: Exam) -> None:
    exam.send(exam.next(POSE, pose_body()))


def _map(exam: Exam) -> None:
    exam.tell([(FREE, 5)])


def _both(exam: Exam) -> None:
    _pose(exam)
    _map(exam)


def _geom_only(exam: Exam) -> None:
    exam.send(exam.next(GEOM, exam.geom.body()))


def _pose_and_other_epoch(exam: Exam) -> None:
    """The map half goes on in an epoch that was never told."""
    _pose(exam)
    body = map_body(exam.origin, exam.seq, exam.geom.geom_id ^ 1, 0, ops_of([(FREE, 5)]))
    exam.send(exam.next(MAP, body), undecided=True)


def _pose_and_damaged_map(exam: Exam) -> None:
    """The map half goes on, but none of its frames arrives whole."""
    _pose(exam)
    data = bytearray(exam.next_map([(FREE, 5)]))
    data[12] ^= 0x10
    exam.send(bytes(data))


def _pose_and_bad_map(exam: Exam) -> None:
    """The map half writes operations that pass the last cell."""
    _pose(exam)
    exam.send(exam.next_map([(OBSTACLE, 63), (FREE, 63)]))


def _pose_and_old_map(exam: Exam) -> None:
    """The map half repeats an old frame."""
    _pose(exam)
    body = map_body(exam.origin, exam.seq, exam.geom.geom_id, 0, ops_of([(FREE, 5)]))
    exam.send(frame(MAP, exam.seq - 7, exam.t_ms, body, 0, exam.secret))


def _map_and_short_pose(exam: Exam) -> None:
    """The pose half writes frames of another length."""
    _map(exam)
    whole = exam.next(POSE, pose_body()[:-4])
    exam.send(whole if exam.key else sealed(whole[:-4]))


def _nothing(exam: Exam) -> None:
    """The sender halts."""


HALTS: dict[str, Tick] = {
    "the sender halts": _nothing,
    "only the map half halts": _pose,
    "only the pose half halts": _map,
    "nothing but GEOM comes": _geom_only,
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
        _expect_fresh(exam, "both halves go on")
        exam.tail.clear()
        latest_ms.append(_time_until_stale(exam, name, tick, stale_ms) - stale_ms)
        _expect_fresh(exam, f"both again, after: {name}")
    return f"{len(latest_ms)} halts, told at most {max(latest_ms):.0f} ms after stale_ms"


def silence(exam: Exam) -> str:
    """6: a receiver that has never heard both halves is stale."""
    for words, tick in (("only poses", _pose), ("only maps", _map)):
        exam.begin(9, 7)
        if not exam.strict:  # one may count what it had from the run before
            _run(exam, tick, exam.geom.stale_ms / 1000 + ACK_PERIOD_S)
        acks = _run(exam, tick, 0.3)
        told = {ack.status & STALE for ack in acks}
        exam.expect(f"{words} since the start: STALE", {STALE}, told)
    return "only poses, and only maps, from the start"


def _run(exam: Exam, tick: Tick, seconds: float) -> list[Ack]:
    """Ticks for so long; gives the ACKs. `exam.stalled_s`: the longest that we ourselves took."""
    end_s, acks = exam.bench.now_s() + seconds, []
    exam.stalled_s = 0.0
    while exam.bench.now_s() < end_s - 1e-6:
        exam.ticked_s = exam.bench.now_s()
        tick(exam)
        acks += exam.hear_all(TICK_S)
        exam.stalled_s = max(exam.stalled_s, exam.bench.now_s() - exam.ticked_s)
    return acks


def _expect_fresh(exam: Exam, what: str) -> None:
    """No STALE while both halves come; if we ourselves are too slow for that, once more."""
    for _ in range(TRIES):
        _run(exam, _both, 0.1 + ACK_PERIOD_S)
        slowest_s = exam.stalled_s
        told = {ack.status & STALE for ack in _run(exam, _both, 0.4)}
        if max(slowest_s, exam.stalled_s) < exam.geom.stale_ms / 2000:
            exam.expect(f"{what}: STALE", {0}, told)
            return
    raise UnseenError("this machine is too busy: it sends too late itself")


def _time_until_stale(exam: Exam, name: str, tick: Tick, stale_ms: int) -> float:
    """Milliseconds from the last whole tick until an ACK says STALE."""
    slack_s = TICK_S if exam.bench.in_process else TICK_S + SLACK_S
    whole_s, stale_s = exam.ticked_s, stale_ms / 1000
    latest_s = stale_s + ACK_PERIOD_S + slack_s + TICK_S
    slowest_s, passed_s = 0.0, 0.0
    while passed_s < latest_s + slowest_s:
        told = any(ack.status & STALE for ack in _run(exam, tick, TICK_S / 2))
        slowest_s = max(slowest_s, exam.stalled_s - TICK_S)
        passed_s = exam.bench.now_s() - whole_s
        if told and passed_s < stale_s - 0.001:
            raise exam.failed(f"{name}: STALE not before {stale_ms} ms", "0", "STALE")
        if told:
            return passed_s * 1000
    within = f"within {stale_ms} ms, told by an ACK {ACK_PERIOD_S * 1000:.0f} ms later"
    raise exam.failed(f"{name}: STALE", within, f"not after {passed_s * 1000:.0f} ms")
