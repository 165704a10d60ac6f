"""What came of a job, whoever ran it; what a scheduler is; and a bar while they run."""

import time
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TextColumn,
    TimeRemainingColumn,
)
from rich.text import Text

T = TypeVar("T")
R = TypeVar("R")
TOLD_EVERY_S = 5.0  # without a screen


@dataclass(frozen=True, slots=True)
class Failure:
    """Why a job has no result, in words."""

    cause: str


class Scheduler(Protocol):
    """Who has jobs done."""

    def results(
        self, work: Callable[[T], R], tasks: Sequence[T]
    ) -> Generator[tuple[int, R | Failure], None, None]:
        """Each task's place and result, once, as they end; `work` can be imported.

        Raises:
            SchedulerError: nobody is there to do them, or nobody any more.
        """


class SchedulerError(Exception):
    """Jobs cannot be done; the text says why."""


class RateColumn(ProgressColumn):
    """Jobs an hour, a minute or a second, of those that ended here."""

    def render(self, task: Task) -> Text:
        return Text(
            rate_text(task.finished_speed or task.speed or 0.0), style="progress.data.speed"
        )


def rate_text(per_s: float) -> str:
    if not per_s:
        return ""
    for factor, unit in ((1.0, "s"), (60.0, "min")):
        if per_s * factor >= 1.0:
            return f"{per_s * factor:.1f}/{unit}"
    return f"{per_s * 3600.0:.1f}/h"


def with_bar(
    console: Console,
    total: int,
    results: Iterable[R],
    words: Callable[[Sequence[R]], str],
    *,
    done: Sequence[R] = (),
    noun: str = "runs",
) -> Iterator[R]:
    """The same results, with a bar, or a line now and then.

    Args:
        total: of all, with those that were done before.
        words: of all results so far.
    """
    seen: list[Any] = list(done)
    begun_s = told_s = time.monotonic()
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), RateColumn())
    is_drawn = console.is_terminal
    with Progress(*columns, TimeRemainingColumn(), console=console, disable=not is_drawn) as bar:
        task = bar.add_task(noun, total=total, completed=len(seen))
        for result in results:
            seen.append(result)
            now_s = time.monotonic()
            if is_drawn:
                bar.update(task, advance=1, description=words(seen))
            elif now_s - told_s >= TOLD_EVERY_S:
                told_s, rate = now_s, (len(seen) - len(done)) / (now_s - begun_s)
                left = (total - len(seen)) / rate
                text = f"  {len(seen)} of {total} {noun}: {words(seen)}; {left:.0f} s left"
                console.print(text, soft_wrap=True)
            yield result
