"""What two devices are compared by: facts with names, how far they may differ; differences."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from tools.cli.conversation import Conversation

Sort = Literal["same", "near", "own"]

NOT_THERE = "not told"
SILENT = "no answer"
DELAY_FACTOR, DELAY_S = 5.0, 0.05  # answers may take that much longer, or so many seconds
END_S = 0.015  # by which the first and the last of what is counted may have been late
UNEVEN_SHARE, UNEVEN_MS = 0.5, 5.0
SPREAD_SHARE = 0.7  # noise of more than thrice as much is another noise


@dataclass(frozen=True, slots=True)
class Fact:
    """One thing that was found out about a device.

    Sorts: "same": both must say it alike; "near": numbers within `share` of each other, or within
    `slack`; "own": each device's own, listed and never a difference.
    """

    value: str | float
    sort: Sort = "same"
    share: float = 0.0
    slack: float = 0.0
    unit: str = ""  # of a number

    def __str__(self) -> str:
        if isinstance(self.value, str):
            return self.value
        return f"{self.value:.4g} {self.unit}".rstrip()


Portrait = dict[str, Fact]


@dataclass(frozen=True, slots=True)
class Difference:
    """One fact of which the two say different things; counts: more than a device's own matter."""

    name: str
    real: str
    fake: str
    counts: bool


def differences(real: Portrait, fake: Portrait) -> list[Difference]:
    """All that differs, in the order of the real device's facts; what only one has comes last."""
    found = []
    for name in [*real, *(name for name in fake if name not in real)]:
        one, other = real.get(name), fake.get(name)
        if one is None or other is None:
            known = one or other
            assert known is not None
            found.append(Difference(name, _said(one), _said(other), known.sort != "own"))
        elif not _agree(one, other):
            found.append(Difference(name, str(one), str(other), one.sort != "own"))
    return found


def _said(fact: Fact | None) -> str:
    return NOT_THERE if fact is None else str(fact)


def _agree(one: Fact, other: Fact) -> bool:
    a, b = one.value, other.value
    if isinstance(a, str) or isinstance(b, str) or one.sort != "near":
        return a == b
    return abs(a - b) <= max(one.slack, one.share * max(abs(a), abs(b)))


def delay_fact(seconds: float) -> Fact:
    return Fact(seconds * 1000, "near", 1.0 - 1.0 / DELAY_FACTOR, DELAY_S * 1000, "ms")


def rate_fact(hertz: float, passed_s: float, share: float = 0.002) -> Fact:
    """How often something came in so many seconds; share: by which two devices' clocks differ."""
    return Fact(hertz, "near", share + END_S / passed_s, 0.0, "1/s")


def pace_facts(
    name: str, arrivals_s: Sequence[float], share: float = 0.002
) -> Iterator[tuple[str, Fact]]:
    """Rate, and how unevenly it arrives, of what came at these instants."""
    if len(arrivals_s) < 3:
        yield f"{name}: rate", Fact(f"{len(arrivals_s)} came")
        return
    gaps_s, passed_s = np.diff(arrivals_s), arrivals_s[-1] - arrivals_s[0]
    yield f"{name}: rate", rate_fact(len(gaps_s) / passed_s, passed_s, share)
    uneven_ms = float(np.percentile(np.abs(gaps_s - np.median(gaps_s)), 95)) * 1000
    uneven = Fact(uneven_ms, "near", UNEVEN_SHARE, UNEVEN_MS, "ms")
    yield f"{name}: unevenness of arrival, p95", uneven


def noise_fact(spread: float, unit: str) -> Fact:
    return Fact(spread, "near", SPREAD_SHARE, 0.0, unit)


def number_facts(name: str, values: Sequence[float], unit: str, sort: Sort = "own") -> Portrait:
    if not len(values):
        return {f"{name}: values": Fact("none")}
    low, middle, high = np.percentile(np.asarray(values, dtype=float), [0, 50, 100])
    return {
        f"{name}: {word}": Fact(float(value), sort, 0.1, 0.0, unit)
        for word, value in (("least", low), ("median", middle), ("greatest", high))
    }


def reply_to(
    talk: Conversation,
    question: bytes,
    is_answer: Callable[[Any], bool],
    seconds: float,
    tries: int = 2,
) -> tuple[Any, float] | None:
    """The answer and its delay, s; None: none within `seconds`, `tries` times."""
    for _ in range(tries):
        asked_s = talk.now_s()
        talk.say(question)
        for event in talk.hear(seconds):
            if is_answer(event):
                return event, talk.now_s() - asked_s
    return None


def counts_in_words(counts: Mapping[Any, int]) -> str:
    """Which values came, and how often each, for a person.

    >>> counts_in_words({1: 48, 2: 1})
    '1 (48 x), 2 (1 x)'
    """
    return ", ".join(f"{value} ({count} x)" for value, count in sorted(counts.items())) or "none"
