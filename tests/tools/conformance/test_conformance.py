"""All conformance tests on mapod's own receivers, Python and C, on both wires, with and without
key.

Each receiver is also asked directly for what it holds: cell by cell, *suspect*, *stale*.
"""

import pytest

from tests.support.cases import few
from tests.support.link.planner_sender import VECTORS as SHEET
from tests.support.link.planner_sender import vector
from tools.conformance.__main__ import KEY, RECEIVERS
from tools.conformance.exam import Exam
from tools.conformance.in_process import InProcess
from tools.conformance.suite import CHECKS, Verdict, chosen, meet, run
from tools.conformance.vectors import VECTOR_GEOM, VECTORS, tagged
from tools.conformance.wire import GEOM, MAP, POSE, cobs, frame, map_body, op, pose_body


def examined(
    name: str, only: str, share: float, key: bytes | None = None, datagrams: bool = True
) -> list[Verdict]:
    """The verdicts on one of the receivers; it passes."""
    bench = InProcess(lambda start: RECEIVERS[name](start, key), datagrams=datagrams)
    exam = Exam(bench, key=key, share=share)
    assert meet(exam) == ""
    assert exam.has_digest
    verdicts = list(run(exam, chosen(only), seed=2))
    assert [verdict for verdict in verdicts if verdict.failure] == []
    return verdicts


@pytest.mark.parametrize("name", RECEIVERS)
@pytest.mark.parametrize(
    ("datagrams", "key"),
    few([(False, KEY), (True, None), (False, None), (True, KEY)], 1),
    ids=["stream-tagged", "datagrams-plain", "stream-plain", "datagrams-tagged"],
)
def test_own_receivers_pass_all_that_is_asked_of_others(
    name: str, key: bytes | None, datagrams: bool
) -> None:
    verdicts = examined(name, "", 0.05, key, datagrams)
    skipped = {verdict.check.name for verdict in verdicts if verdict.outcome == "skipped"}
    allowed = {"forms of COBS", "damaged bytes on the line"} if datagrams else set()
    assert skipped == allowed | (set() if key else {"tags"})
    assert len(verdicts) == len(CHECKS)


@pytest.mark.parametrize("name", RECEIVERS)
def test_every_error_of_one_and_two_bits_and_every_burst_is_refused(name: str) -> None:
    words = {verdict.check.name: verdict.words for verdict in examined(name, "3", share=1.0)}
    done, _, of, *_ = words["errors of one and two bits"].split()
    assert (int(done), int(of)) == (28_920, 28_920)
    done, _, of, *_ = words["bursts up to 32 bits"].split()
    assert int(done) == int(of) == 4 * sum(240 - length + 1 for length in range(3, 33))


@pytest.mark.slow
@pytest.mark.parametrize("name", RECEIVERS)
def test_maps_of_up_to_401_by_401_cells_equal_those_of_the_model(name: str) -> None:
    examined(name, "2", share=0.12)


@pytest.mark.parametrize("name", RECEIVERS)
@pytest.mark.parametrize("half", [POSE, MAP])
def test_stale_comes_at_stale_ms_to_the_millisecond(name: str, half: int) -> None:
    receiver = RECEIVERS[name](0, None)
    receiver.feed_datagram(10.0, frame(GEOM, 1, 1000, VECTOR_GEOM.body()))
    bodies = {POSE: pose_body(), MAP: map_body((0, 0), 1, 7, 0, op(1, 9))}
    receiver.feed_datagram(10.0, frame(half, 2, 1000, bodies[half]))
    assert receiver.stale(10.0)
    other = MAP if half == POSE else POSE
    receiver.feed_datagram(10.1, frame(other, 3, 1100, bodies[other]))
    assert not receiver.stale(10.149)
    assert receiver.stale(10.151)


@pytest.mark.parametrize("name", VECTORS)
def test_the_vectors_here_are_those_of_the_sheet(name: str) -> None:
    plain = bytes.fromhex(VECTORS[name])
    assert plain == vector(name)
    assert cobs(plain) + b"\0" == vector(f"{name}_serial")
    if f"{name}_auth" in SHEET:
        assert tagged(plain) == vector(f"{name}_auth")
