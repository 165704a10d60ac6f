"""Questions and answers with a camera, by CoLa-2 or CoLa-B; what it refuses, in words.

One question at a time. By CoLa-2 an answer repeats the request's number: one with another number is
a fault of the stream. By CoLa-B it repeats the name, but for refusals, which tell none.
Source: visionary sheet, sections 2 to 4.
"""

from typing import Any

from hw.exchange import Exchange, StartAgainError, Steps
from hw.visionary.access import (
    CHALLENGE_BYTES,
    LEVELS,
    REFUSALS,
    SALT_BYTES,
    password_hash,
    response,
)
from hw.visionary.cola import REQUESTS, Reply, arguments, encode_cola_2, encode_cola_b, flexstring
from hw.visionary.options import Level

SESSION_S = 30  # without a question, after which the camera forgets us
ANSWER_S = 1.0
CLIENT = "mapod"
ACCESS_DENIED, UNKNOWN_METHOD, UNKNOWN_VARIABLE = 0x01, 0x02, 0x03
UNDERFLOW, DENIED, NO_ROOM, NO_SESSION = 0x08, 0x0A, 0x21, 0x22
ERRORS = {
    ACCESS_DENIED: "access is denied",
    UNKNOWN_METHOD: "it knows no such method",
    UNKNOWN_VARIABLE: "it knows no such variable",
    0x04: "a value is out of its range",
    0x05: "its data is not valid",
    UNDERFLOW: "arguments are missing",
    DENIED: "it must not be written without logging in",
    0x0D: "it is busy",
    NO_ROOM: "it has no room for one more session",
    NO_SESSION: "it does not know the session any more",
}
ANSWERS = {"RN": "RA", "WN": "WA", "MN": "AN", "Ox": "OA", "Cx": "CA"}


def describe_error(error: int) -> str:
    """
    >>> describe_error(0x22), describe_error(0x51)
    ('it does not know the session any more (error 22)', 'error 51')
    """
    known = ERRORS.get(error)
    return f"{known} (error {error:X})" if known else f"error {error:X}"


class Conversation:
    """One camera on its control port.

    Args:
        is_cola_2: else CoLa-B is spoken.
    """

    def __init__(self, exchange: Exchange, is_cola_2: bool) -> None:
        self.exchange, self._is_cola_2 = exchange, is_cola_2
        self._session = self._request = 0
        self.is_open = False  # a session, where there are any

    def encode(self, letters: str, name: str, data: bytes = b"") -> bytes:
        """A command; by CoLa-2 it gets the next number."""
        rest = arguments(name, data) if name else data
        if not self._is_cola_2:
            return encode_cola_b(letters, rest)
        self._request = (self._request + 1) % REQUESTS
        return encode_cola_2(self._session, self._request, letters, rest)

    def ask(self, letters: str, name: str, data: bytes = b"") -> Steps[Reply]:
        """The answer, or the refusal, to a command.

        Raises:
            StartAgainError: none comes, or another one.
        """

        def maybe_answer(event: Any) -> Reply | None:
            return event if isinstance(event, Reply) else None

        out = self.encode(letters, name, data)
        reply = yield from self.exchange.ask(out, maybe_answer, ANSWER_S)
        if reply is None:
            raise StartAgainError(f"the camera does not answer {name or letters}")
        is_its = reply.letters == "FA" or (reply.letters, reply.name) == (ANSWERS[letters], name)
        if not is_its or (self._is_cola_2 and reply.request != self._request):
            raise StartAgainError(f"the camera answers {name or letters} with something else")
        return reply

    def must(self, letters: str, name: str, data: bytes = b"") -> Steps[Reply]:
        """The same where nothing goes on without a good answer."""
        reply = yield from self.ask(letters, name, data)
        if reply.letters == "FA":
            why = describe_error(reply.error)
            raise StartAgainError(f"the camera refuses {name or letters}: {why}")
        return reply

    def maybe_read(self, name: str) -> Steps[bytes | None]:
        """What a variable has; None where the camera has none of that name."""
        reply = yield from self.ask("RN", name)
        if reply.letters == "FA" and reply.error == NO_SESSION:
            raise StartAgainError(f"the camera: {describe_error(reply.error)}")
        return reply.data if reply.letters == "RA" else None

    def maybe_number(self, name: str, size: int) -> Steps[int | None]:
        """The same of an unsigned number of so many bytes."""
        data = yield from self.maybe_read(name)
        return int.from_bytes(data, "big") if data is not None and len(data) == size else None

    def open(self) -> Steps[None]:
        """A session, where the protocol has sessions."""
        self._session, self.is_open = 0, False
        if self._is_cola_2:
            reply = yield from self.must("Ox", "", bytes([SESSION_S]) + flexstring(CLIENT))
            self._session, self.is_open = reply.session, True

    def log_in(self, level: Level, password: str) -> Steps[str]:
        """Why it was refused, in words; "" if not. Newer firmware has no log-in by hash alone."""
        if not self._is_cola_2:
            reply = yield from self._by_hash(level, password)
            if reply.letters != "FA":
                return "" if reply.data[:1] == b"\x01" else REFUSALS[2]
            if reply.error not in (ACCESS_DENIED, UNKNOWN_METHOD):
                return describe_error(reply.error)
        return (yield from self._by_challenge(level, password))

    def log_out(self) -> Steps[None]:
        yield from self.must("MN", "Run")

    def _by_hash(self, level: Level, password: str) -> Steps[Reply]:
        data = bytes([LEVELS[level][0]]) + password_hash(password).to_bytes(4, "big")
        return (yield from self.ask("MN", "SetAccessMode", data))

    def _by_challenge(self, level: Level, password: str) -> Steps[str]:
        """By the older form if the camera gives a challenge unasked for which level."""
        number, salt_bytes = LEVELS[level][0], 0
        reply = yield from self.ask("MN", "GetChallenge")
        if reply.letters == "FA" and reply.error == UNDERFLOW:
            reply = yield from self.ask("MN", "GetChallenge", bytes([number]))
            salt_bytes = SALT_BYTES
        if reply.letters == "FA":
            return describe_error(reply.error)
        if len(reply.data) < 1 + CHALLENGE_BYTES + salt_bytes or reply.data[0]:
            return "it gives no challenge"
        challenge, salt = reply.data[1:17], reply.data[17 : 17 + salt_bytes]
        data = response(level, password, challenge, salt) + bytes([number])
        reply = yield from self.ask("MN", "SetUserLevel", data)
        if reply.letters == "FA":
            return describe_error(reply.error)
        result = reply.data[0] if reply.data else 255
        return REFUSALS.get(result, f"it says {result}") if result else ""
