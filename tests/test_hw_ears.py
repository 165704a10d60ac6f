"""Being told of arrivals by the kernel: once for each, on any kind of descriptor."""

import asyncio
import os
import tty
from collections.abc import Callable

import pytest

from hw.ears import News


class Poked:
    """The part of an asyncio loop that News needs, called by hand."""

    def __init__(self) -> None:
        self.readers: dict[int, Callable[[], object]] = {}

    def add_reader(self, fd: int, callback: Callable[[], object], /) -> None:
        """Keep it."""
        self.readers[fd] = callback

    def remove_reader(self, fd: int, /) -> None:
        """Forget it."""
        del self.readers[fd]

    def poke(self) -> None:
        """As if the kernel had told of something, be it true or not."""
        for callback in list(self.readers.values()):
            callback()


def pipe() -> tuple[int, int]:
    return os.pipe()


def terminal() -> tuple[int, int]:
    """(the end that is read, the other end) of a pty in raw mode."""
    master, slave = os.openpty()
    tty.setraw(slave)
    return slave, master


@pytest.mark.parametrize("kind", [pipe, terminal])
def test_each_arrival_is_told_once_read_or_not(kind: Callable[[], tuple[int, int]]) -> None:
    reader, writer = kind()
    loop, told = Poked(), list[int]()
    news = News(loop)
    news.add_reader(reader, lambda: told.append(len(told)))

    async def until_told(count: int) -> None:
        real = asyncio.get_running_loop()
        came = asyncio.Event()
        (fd,) = loop.readers

        def poke() -> None:
            loop.poke()
            came.set()

        real.add_reader(fd, poke)
        while len(told) < count:
            await asyncio.wait_for(came.wait(), 10)
            came.clear()
        real.remove_reader(fd)

    for count in (1, 2):  # what came first is never read, and not told again
        os.write(writer, b"bytes")
        asyncio.run(until_told(count))
        loop.poke()
        assert len(told) == count
    news.close()
    assert loop.readers == {}
    os.close(reader)
    os.close(writer)


def test_what_was_there_before_is_told_at_once() -> None:
    reader, writer = os.pipe()
    os.write(writer, b"early")
    loop, told = Poked(), list[int]()
    news = News(loop)
    news.add_reader(reader, lambda: told.append(1))
    loop.poke()
    assert told == [1]
    news.close()
    os.close(reader)
    os.close(writer)


def test_a_reader_may_be_taken_away_by_another_and_after_its_descriptor_has_closed() -> None:
    (one, first), (two, second) = os.pipe(), os.pipe()
    loop, told = Poked(), list[str]()
    news = News(loop)

    def heard(name: str, other: int) -> None:
        told.append(name)
        news.remove_reader(other)

    news.add_reader(one, lambda: heard("one", two))
    news.add_reader(two, lambda: heard("two", one))
    os.write(first, b"1")
    os.write(second, b"2")
    loop.poke()
    assert len(told) == 1
    left = one if told == ["one"] else two
    os.close(left)
    news.remove_reader(left)
    loop.poke()
    assert len(told) == 1
    news.close()
    for fd in {one, two, first, second} - {left}:
        os.close(fd)
