"""The list of checks, and what comes of running them against one receiver."""

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from tools.conformance import checks_frames, checks_map, checks_sender, checks_state
from tools.conformance.exam import DeviationError, Exam, UnseenError
from tools.conformance.wire import (
    DIGEST,
    DIGEST_OK,
    FREE,
    NEED_FULL,
    OBSTACLE,
    digest_body,
)

CONTACT_S = 3.0


@dataclass(frozen=True, slots=True)
class Check:
    """One line of the outcome."""

    number: str  # of section 14
    name: str
    run: Callable[[Exam], str]  # gives what was done


@dataclass(frozen=True, slots=True)
class Verdict:
    """What came of a check."""

    check: Check
    outcome: str  # "passed", "failed" or "skipped"
    words: str  # what was done, or why not
    failure: DeviationError | None = None


CHECKS = [
    Check("1", "vectors of section 13", checks_frames.vectors),
    Check("1", "what an ACK tells", checks_frames.answers),
    Check("1", "forms of COBS", checks_frames.cobs_forms),
    Check("2", "DIGEST", checks_map.digests),
    Check("2", "wrap of the grid", checks_map.wraps),
    Check("2", "runs of all lengths", checks_map.long_runs),
    Check("2", "random maps, 5 % loss", checks_map.random_maps),
    Check("3", "errors of one and two bits", checks_frames.bit_errors),
    Check("3", "bursts up to 32 bits", checks_frames.bursts),
    Check("3", "errors in a long frame", checks_frames.long_frames),
    Check("3", "damaged bytes on the line", checks_frames.damaged_stream),
    Check("4", "random bytes, cut frames", checks_frames.junk),
    Check("4", "right CRC, arbitrary body", checks_frames.arbitrary_bodies),
    Check("4", "tags", checks_frames.tags),
    Check("5", "gap and repaired", checks_state.gaps),
    Check("5", "gap and a far move", checks_state.gap_and_jump),
    Check("5", "late and repeated frames", checks_state.order),
    Check("5", "geometry in mid-stream", checks_state.epochs),
    Check("5", "GEOM lost", checks_state.geom_lost),
    Check("5", "sender restart", checks_state.sender_restart),
    Check("5", "receiver restart", checks_state.receiver_restart),
    Check("5", "mapod's sender, repair by ACK", checks_sender.repair_by_ack),
    Check("5", "mapod's sender, by refresh", checks_sender.repair_by_refresh),
    Check("6", "halts: stale", checks_state.halts),
    Check("6", "never heard: stale", checks_state.silence),
    Check("7", "line at 85 %", checks_sender.full_line),
    Check("15", "line cut for long", checks_state.long_cut),
]


def chosen(only: str) -> list[Check]:
    """Those of some numbers, "2,5"; all for "".

    Raises:
        ValueError: a number that no check has.
    """
    wanted = [part.strip() for part in only.split(",") if part.strip()]
    unknown = set(wanted) - {check.number for check in CHECKS}
    if unknown:
        raise ValueError(f"no test has the number {', '.join(sorted(unknown))}")
    return [check for check in CHECKS if not wanted or check.number in wanted]


def meet(exam: Exam, wait_s: float = CONTACT_S) -> str:
    """Find out who is there: its HELLO if it tells one, an ACK, and whether it compares DIGESTs.

    Gives "" when it can be examined, else why not, in words.
    """
    end_s = exam.bench.now_s() + wait_s
    while exam.bench.now_s() < end_s and exam.hello is None and not exam.answers:
        exam.send_pose()
        exam.hear_all(0.3)
    if exam.hello is None and (exam.key or not exam.answers):
        return "no HELLO came" + ("" if exam.answers else " and no ACK")
    exam.begin(5, 4)
    exam.tell([(FREE, 17), (OBSTACLE, 3)])
    exam.answers.clear()
    with contextlib.suppress(DeviationError):
        exam.ask()
        exam.send(exam.next(DIGEST, digest_body(exam.geom.geom_id, exam.model.window())))
        exam.has_digest = bool(exam.ask().status & (DIGEST_OK | NEED_FULL))
    if exam.says_hello() or exam.answers:
        return ""  # one that still says HELLO did not take the GEOM: it is to fail, not to pass by
    return "the receiver sends no ACK: nothing can be seen of it"


def run(exam: Exam, checks: list[Check], seed: int) -> Iterator[Verdict]:
    """Each check in turn, on one receiver; the same numbers by chance whichever others run."""
    for check in checks:
        exam.random.seed(f"{seed} {check.name}")
        try:
            yield Verdict(check, "passed", check.run(exam))
        except DeviationError as failure:
            yield Verdict(check, "failed", failure.what, failure)
        except UnseenError as reason:
            yield Verdict(check, "skipped", reason.why)
