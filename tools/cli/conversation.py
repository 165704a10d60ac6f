"""A conversation with one device, from a tool, in real time: say, and hear until it is enough."""

import argparse
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, Protocol

from core.config import ConfigError
from hw.device import BadFrame, Parser, Port
from hw.ports.url import parse_url
from hw.ports.wires import PortUrlError, open_port
from tools.cli.options import configured, fail

STEP_S = 0.002
BITS_A_BYTE = 10  # on a serial line
OPEN_S = 3.5  # a little longer than a TCP connection may take


class NoAnswerError(Exception):
    """The device does not answer, or the port does not open; the text says which."""


class RefusedError(Exception):
    """The device does not do what it was asked to; the text says why."""


class Line(Protocol):
    """A port, and the time that passes there."""

    port: Port

    def now_s(self) -> float: ...

    def wait(self) -> None: ...


class RealLine:
    """A port of this machine. It is for tools: it sleeps."""

    def __init__(self, url: str) -> None:
        self.port = open_port(url)

    def now_s(self) -> float:
        return time.monotonic()

    def wait(self) -> None:
        time.sleep(STEP_S)


LINE: Callable[[str], Line] = RealLine  # what a URL leads to


class Conversation:
    """One port and the parser of what arrives there."""

    def __init__(self, url: str, parser: Parser) -> None:
        self.heard = bytearray()  # everything that arrived
        self._line, self._parser = LINE(url), parser
        self.now_s, self._port = self._line.now_s, self._line.port
        self._baud = parse_url(url).baud

    def open(self) -> None:
        """Waits for the port. Raises NoAnswerError: it does not open in time, with the cause."""
        until_s = self.now_s() + OPEN_S
        while not self._port.poll(self.now_s()):
            if self.now_s() >= until_s:
                raise NoAnswerError(self._port.cause)
            self._line.wait()

    def line_s(self, size: int) -> float:
        """How long so many bytes take on a serial line; 0 elsewhere."""
        return size * BITS_A_BYTE / self._baud if self._baud else 0.0

    def say(self, data: bytes) -> None:
        self._port.write(data)

    def hear(self, seconds: float) -> Iterator[Any]:
        """Events, for at most so long; what belongs to no frame is left out."""
        until_s = self.now_s() + seconds
        while (now_s := self.now_s()) < until_s:
            if not self._port.poll(now_s):
                raise NoAnswerError(self._port.cause)
            for piece in self._port.read():
                self.heard += piece
                for event in self._parser.feed(now_s, piece):
                    if not isinstance(event, BadFrame):
                        yield event
            self._line.wait()

    def ask(
        self, request: bytes, is_answer: Callable[[Any], bool], seconds: float = 1.0, tries: int = 3
    ) -> Any:
        """The event that answers a request, which is repeated. Raises NoAnswerError: none came."""
        for _ in range(tries):
            self.say(request)
            for event in self.hear(seconds):
                if is_answer(event):
                    return event
        raise NoAnswerError(f"no answer within {tries * seconds:.2g} s")

    def close(self) -> None:
        self._port.close()


@contextmanager
def conversation(url: str, parser: Parser) -> Iterator[Conversation]:
    """An open conversation. Raises NoAnswerError: the port does not open."""
    talk = Conversation(url, parser)
    try:
        talk.open()
        yield talk
    finally:
        talk.close()


def print_what(
    act: Callable[[Conversation], Iterable[str]],
    command: str,
    section: str,
    options: argparse.Namespace,
    new_parser: Callable[[str], Parser],
) -> int:
    """Prints what comes of a conversation over --port, or the port of a section of --config.

    Exit status: 0 done, 1 refused or silent, 2 wrong use.
    """
    try:
        url = options.port or getattr(configured(options.config), section).port
        if not url:
            raise ConfigError(f"{options.config}: [{section}] driver is 'none', there is no port")
        with conversation(url, new_parser(url)) as talk:
            for line in act(talk):
                print(line, flush=True)
    except (ConfigError, PortUrlError, OSError) as error:
        return fail(command, error)
    except (NoAnswerError, RefusedError) as error:
        return fail(command, error, 1)
    return 0
