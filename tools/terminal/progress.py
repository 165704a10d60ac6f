"""What a person sees of long work: a bar on stderr, where there is a terminal."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

Advance = Callable[[float, str], None]


@contextmanager
def advancing(what: str, total: float | None) -> Iterator[Advance]:
    """A bar that moves to where it is told: `advance(done, words)`; total None: nobody knows."""
    columns = TextColumn("{task.description}"), BarColumn(), TaskProgressColumn()
    console, left = Console(stderr=True), TimeRemainingColumn()
    with Progress(*columns, left, console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task(what, total=total)

        def advance(done: float, words: str) -> None:
            bar.update(task, completed=done, description=words or what)

        yield advance
