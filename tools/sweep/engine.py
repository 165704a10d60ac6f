"""Jobs into rows: what was done before is not done again, what ends is kept, then told."""

from collections.abc import Callable, Generator, Mapping
from contextlib import closing
from dataclasses import dataclass
from typing import TypeVar

from tools.sweep.jobs import Failure, Scheduler
from tools.sweep.rows import FAILED, Row, Rows

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Done:
    """A job that has ended."""

    key: str
    row: Row

    @property
    def failed(self) -> str:
        """Why it has no figures; "": it has."""
        return str(self.row.get(FAILED, ""))


def done_before(tasks: Mapping[str, object], rows: Rows | None) -> list[Done]:
    """Of these jobs, by key."""
    kept = {} if rows is None else rows.kept
    return [Done(key, kept[key]) for key in tasks if key in kept]


def run_missing(
    work: Callable[[T], Row], tasks: Mapping[str, T], rows: Rows | None, scheduler: Scheduler
) -> Generator[Done, None, None]:
    """The other jobs, as they end; each is on disk before it is told. None: nothing is kept.

    Raises:
        SchedulerError: nobody does jobs any more. OSError: the disk takes no rows.
    """
    kept = {} if rows is None else rows.kept
    missing = [key for key in tasks if key not in kept]
    with closing(scheduler.results(work, [tasks[key] for key in missing])) as results:
        for at, result in results:
            row = {FAILED: result.cause} if isinstance(result, Failure) else result
            if rows is not None:
                rows.add(missing[at], row)
            yield Done(missing[at], row)
