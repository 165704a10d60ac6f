"""What a person sees of long work: a bar on stderr, where there is a terminal, and no log."""

import logging
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

import structlog
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

T = TypeVar("T")
Advance = Callable[[float, str], None]


def quiet() -> None:
    """No log: what a simulated robot says would drown a person."""
    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(logging.ERROR))


def _bar() -> Progress:
    columns = TextColumn("{task.description}"), BarColumn(), TaskProgressColumn()
    console = Console(stderr=True)
    return Progress(
        *columns, TimeRemainingColumn(), console=console, disable=not console.is_terminal
    )


def progress(what: str, things: Iterable[T], total: int) -> Iterator[T]:
    with _bar() as bar:
        yield from bar.track(things, total, description=what)


@contextmanager
def advancing(what: str, total: float | None) -> Iterator[Advance]:
    """A bar that moves to where it is told: `advance(done, words)`; total None: nobody knows."""
    with _bar() as bar:
        task = bar.add_task(what, total=total)

        def advance(done: float, words: str) -> None:
            bar.update(task, completed=done, description=words or what)

        yield advance
