"""The conformance tests find every receiver that is wrong, by its answers alone."""

from collections.abc import Iterator

import pytest

from tests.support.cases import few
from tests.support.link.wrong_receivers import WRONG, WRONG_WITH_KEY
from tools.conformance.exam import Exam
from tools.conformance.in_process import InProcess
from tools.conformance.slow_receiver import SlowReceiver
from tools.conformance.suite import Verdict, chosen, meet, run
from tools.conformance.wire import Geom, digest_body

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


class FirstSheet(SlowReceiver):
    """Right by the sheet's first version, and otherwise wherever that left a choice."""

    def is_after_silence(self, t_ms: int) -> bool:
        """Numbers alone tell what is newer."""
        return False

    def compare(self, body: bytes) -> None:
        """At any time; what follows from it is another's concern."""
        self.digest_ok = digest_body(body[0], self.window())[4:] == body[4:]

    def count(self, now_s: float, seq: int, t_ms: int, begins: bool) -> None:
        """The mask goes on over a restart of the sender."""
        mask = self.mask
        super().count(now_s, seq, t_ms, begins)
        self.mask = mask << 1 & 0xFFFFFFFF | 1 if begins else self.mask

    def adopt(self, geom: Geom) -> None:
        """What came before a restart of the sender still counts as life."""
        seen = self.pose_s, self.map_s
        super().adopt(geom)
        self.pose_s, self.map_s = seen

    def is_other_epoch(self, old: Geom | None, new: Geom) -> bool:
        """Only a new number is a new epoch."""
        return old is None or old.geom_id != new.geom_id


@pytest.mark.parametrize("number", few(["1", "2", "3", "4", "5", "6", "15", "7"], 7))
def test_a_receiver_that_is_right_by_the_first_sheet_fails_only_where_more_is_wanted(
    number: str,
) -> None:
    bench = InProcess(lambda start: FirstSheet(nonce=7 + start), shows_cells=False)
    exam = Exam(bench, share=0.1, strict=False)
    assert meet(exam) == ""
    assert not [verdict for verdict in run(exam, chosen(number), seed=1) if verdict.failure]


def test_more_is_wanted_of_it_where_that_is_asked_for() -> None:
    failed = {verdict.check.number for verdict in verdicts(FirstSheet, "2,15") if verdict.failure}
    assert failed == {"2", "15"}


@pytest.mark.parametrize("key", [None, KEY], ids=["plain", "tagged"])
@pytest.mark.parametrize("number", few(["1", "3", "4", "6", "15", "2", "5"], 5))
def test_the_right_receiver_fails_nowhere(number: str, key: bytes | None) -> None:
    assert not [verdict for verdict in verdicts(SlowReceiver, number, key) if verdict.failure]
