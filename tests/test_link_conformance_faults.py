"""The conformance tests find every receiver that is wrong, by its answers alone."""

from collections.abc import Iterator

import pytest

from tests.wrong_receivers import WRONG, WRONG_WITH_KEY
from tools.conformance.exam import Exam
from tools.conformance.in_process import InProcess
from tools.conformance.slow_receiver import SlowReceiver
from tools.conformance.suite import Verdict, chosen, meet, run

KEY = bytes(range(32))


def verdicts(
    kind: type[SlowReceiver], number: str, key: bytes | None = None, datagrams: bool = False
) -> Iterator[Verdict]:
    """What the checks of one number say of such a receiver, whose cells they can't see."""
    bench = InProcess(
        lambda start: kind(nonce=7 + start, key=key), datagrams=datagrams, shows_cells=False
    )
    exam = Exam(bench, key=key, share=0.1)
    assert meet(exam) == ""
    return run(exam, chosen(number), seed=1)


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_receiver_is_found_by_its_answers(name: str) -> None:
    number, kind = WRONG[name]
    failures = (verdict.failure for verdict in verdicts(kind, number) if verdict.failure)
    first = next(failures, None)
    assert first is not None
    assert first.expected != first.got


@pytest.mark.parametrize("name", WRONG_WITH_KEY)
def test_a_receiver_that_is_wrong_about_tags_is_found(name: str) -> None:
    kind = WRONG_WITH_KEY[name]
    assert any(verdict.failure for verdict in verdicts(kind, "4", KEY))


@pytest.mark.parametrize("number", ["1", "2", "3", "4", "5", "6", "15"])
def test_the_right_receiver_fails_nowhere(number: str) -> None:
    assert not [verdict for verdict in verdicts(SlowReceiver, number) if verdict.failure]
    assert not [verdict for verdict in verdicts(SlowReceiver, number, KEY) if verdict.failure]
