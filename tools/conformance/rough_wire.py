"""A wire that loses, damages, repeats and swaps what it carries: datagrams or a serial stream."""

import random
from collections import Counter
from dataclasses import dataclass

from tools.conformance.wire import cobs


@dataclass(frozen=True, slots=True)
class Roughness:
    """Chances, per frame."""

    loss: float = 0.0
    burst: float = 0.0  # that a run of losses begins, of up to 40 frames
    damage: float = 0.0
    repeat: float = 0.0  # datagrams only
    swap: float = 0.0  # datagrams only: held back by up to 6 frames


def damaged(chance: random.Random, piece: bytes) -> bytes:
    """Some bits and bytes changed, cut off, left out or put in."""
    data = bytearray(piece)
    for _ in range(chance.choice((1, 1, 2, 3, 8))):
        at = chance.randrange(len(data))
        match chance.randrange(7):
            case 0 | 1 | 2:
                data[at] ^= 1 << chance.randrange(8)
            case 3:
                data[at] = chance.choice((0, 1, 0xFF, chance.randrange(256)))
            case 4:
                del data[at : at + chance.randint(1, 4)]
            case 5:
                data[at:at] = chance.randbytes(chance.randint(1, 3))
            case _:
                data[at:at] = b"\0"
        data = data or bytearray(b"\1")
    return bytes(data)


class RoughWire:
    """One direction. Gives pieces: datagrams, or bytes of a stream cut anywhere."""

    def __init__(self, roughness: Roughness, datagrams: bool, seed: int) -> None:
        self.roughness, self.datagrams = roughness, datagrams
        self.counts = Counter(lost=0, damaged=0, repeated=0, swapped=0)
        self._random = random.Random(seed)
        self._held: list[tuple[int, bytes]] = []  # how many frames it still waits, datagram
        self._burst = 0

    def carry(self, whole: bytes) -> list[bytes]:
        """One frame, without COBS, goes in; what comes out now."""
        rough, chance = self.roughness, self._random
        if not self._burst and chance.random() < rough.burst:
            self._burst = chance.randint(1, 40)
        if self._burst or chance.random() < rough.loss:
            self._burst = max(0, self._burst - 1)
            self.counts["lost"] += 1
            return self._waited()
        piece = whole if self.datagrams else cobs(whole) + b"\0"
        if chance.random() < rough.damage:
            self.counts["damaged"] += 1
            piece = damaged(chance, piece)
        if not self.datagrams:
            at = chance.randrange(len(piece)) if chance.random() < 0.3 else 0
            return [piece[:at], piece[at:]] if at else [piece]
        pieces = [piece]
        if chance.random() < rough.repeat:
            self.counts["repeated"] += 1
            pieces.append(piece)
        if chance.random() < rough.swap:
            self.counts["swapped"] += 1
            self._held.append((chance.randint(1, 6), pieces.pop()))
        return pieces + self._waited()

    def _waited(self) -> list[bytes]:
        """Datagrams that were held back long enough."""
        self._held = [(left - 1, piece) for left, piece in self._held]
        due = [piece for left, piece in self._held if left <= 0]
        self._held = [(left, piece) for left, piece in self._held if left > 0]
        return due

    def flush(self) -> list[bytes]:
        """All that was held back."""
        due = [piece for _, piece in self._held]
        self._held = []
        return due
