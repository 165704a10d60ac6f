"""The kinds of links that the soak runs over, and the sender's port in it."""

import random
from dataclasses import dataclass

from tools.conformance.rough_wire import Roughness
from tools.conformance.wire import Splitter


@dataclass(frozen=True, slots=True)
class Leg:
    """One kind of link."""

    number: int
    datagrams: bool
    keyed: bool
    way_back: bool
    c_answers: bool  # the C receiver's answers go back, not the Python one's
    size: int
    baud: int | None
    roughness: Roughness

    @property
    def words(self) -> str:
        """For a person."""
        kind = "UDP" if self.datagrams else f"serial {self.baud}"
        back = ("C answers" if self.c_answers else "Python answers") if self.way_back else "no ACK"
        return f"{kind}, {'AUTH' if self.keyed else 'no AUTH'}, {back}, {self.size} x {self.size}"


def leg_of(number: int, seed: int) -> Leg:
    """All kinds in eight legs; sizes and chances differ from leg to leg."""
    chance = random.Random(f"{seed} leg {number}")
    datagrams, keyed = number % 2 == 0, number // 2 % 2 == 0
    loss = chance.choice((0.01, 0.05, 0.15))
    rough = Roughness(
        loss=loss,
        burst=0.002,
        damage=chance.choice((0.005, 0.03)),
        repeat=0.03 if datagrams else 0.0,
        swap=0.03 if datagrams else 0.0,
    )
    return Leg(
        number,
        datagrams,
        keyed,
        way_back=number // 4 % 2 == 0,
        c_answers=number // 8 % 2 == (number // 2 % 2),
        size=chance.randint(5, 40),
        baud=None if datagrams else chance.choice((115_200, 230_400, 921_600)),
        roughness=rough,
    )


class SoakPort:
    """Keeps what the sender writes, and gives it what comes back."""

    cause, opened, backlog = "", 1, 0

    def __init__(self, datagrams: bool) -> None:
        self.datagrams = datagrams
        self.answers: list[bytes] = []
        self.written: list[bytes] = []
        self._splitter = Splitter()

    def fileno(self) -> int:
        """None."""
        return -1

    def poll(self, now_s: float) -> bool:
        """Always open."""
        return True

    def read(self) -> list[bytes]:
        """What has come back."""
        answers, self.answers = self.answers, []
        return answers

    def write(self, data: bytes) -> None:
        """Whole frames, without COBS."""
        frames = [data] if self.datagrams else self._splitter.feed(data)
        self.written += [whole or b"" for whole in frames]

    def close(self) -> None:
        """Nothing is held."""
