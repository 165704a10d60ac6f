"""Long inputs by chance: what a target is given as seeds, damaged, doubled, cut and shuffled.

Coverage finds the way into code with small inputs; long ones show what a device does to mapod that
goes on and on. The same seed gives the same inputs.
"""

import random
from collections.abc import Iterator, Sequence
from itertools import accumulate

from tools.fuzz.program import instruction, instructions_of

STREAM_BYTES = 65_536
WHOLE_SHARE = 0.5  # of the pieces: as they are
ODD_SHARE = 0.02  # of the instructions: of another kind
PIECE_BYTES = 8192  # of one instruction, at most


def damaged(chance: random.Random, data: bytes) -> bytes:
    """Some bytes changed, cut out, doubled or put in."""
    content = bytearray(data)
    for _ in range(chance.randint(1, 4)):
        at, size = chance.randrange(len(content) + 1), chance.randint(1, 8)
        match chance.randrange(5):
            case 0 if at < len(content):
                content[at] ^= 1 << chance.randrange(8)
            case 1:
                content[at : at + size] = chance.randbytes(size)
            case 2:
                del content[at : at + size]
            case 3:
                content[at:at] = content[at : at + 4 * size]
            case _:
                content[at:at] = chance.choice((b"\xff", b"\0", b"\x02", b"\r")) * size
    return bytes(content)


def streams(seeds: Sequence[bytes], seed: int, most: int, joined: int) -> Iterator[bytes]:
    """Programs of at most STREAM_BYTES, for ever.

    Args:
        most: instructions of one; what is behind is not run.
        joined: pieces of kind RAW become one up to so many bytes, as a device's stream comes.
    """
    chance = random.Random(seed)
    given = [one for program in seeds for one in instructions_of(program, len(program)) if one[1]]
    weights = list(accumulate(1 + len(data) for _, data in given))
    while True:
        program, steps = bytearray(), 0
        while steps < most:
            [(kind, data)] = chance.choices(given, cum_weights=weights)
            whole = _maybe_damaged(chance, data)
            while kind == 0 and len(whole) < joined:
                [(_, data)] = chance.choices(given, cum_weights=weights)
                whole += _maybe_damaged(chance, data)
            kind ^= 1 << chance.randrange(8) if chance.random() < ODD_SHARE else 0
            told = bytes([kind]) + instruction(0, whole[:PIECE_BYTES])[1:]
            if len(program) + len(told) > STREAM_BYTES:
                break
            program += told
            steps += 1
        yield bytes(program)


def _maybe_damaged(chance: random.Random, data: bytes) -> bytes:
    return data if chance.random() < WHOLE_SHARE else damaged(chance, data)
