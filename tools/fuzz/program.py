"""What an input is: a little program of instructions, each of a kind, with data of its own.

One byte of kind, two of length (big-endian), and the data. What is cut off is left out.
"""

from collections.abc import Iterator

HEAD_BYTES = 3
MOST_REFUSAL = 2000  # letters


def instruction(kind: int, data: bytes, width: int = 0) -> bytes:
    return bytes([kind | width << 2]) + len(data).to_bytes(2, "big") + data


def instructions_of(program: bytes, most: int) -> Iterator[tuple[int, bytes]]:
    """Kind and data of each, of so many at most; the last may have fewer bytes than it says."""
    at = 0
    for _ in range(most):
        if at + HEAD_BYTES > len(program):
            return
        size = int.from_bytes(program[at + 1 : at + HEAD_BYTES], "big")
        yield program[at], program[at + HEAD_BYTES : at + HEAD_BYTES + size]
        at += HEAD_BYTES + size


def refused(error: Exception, most: int = MOST_REFUSAL) -> int:
    """0, where a refusal is a line that a person can read. Raises AssertionError."""
    told = str(error)
    assert told, "no reason is given"
    assert len(told) <= most, f"a reason of {len(told)} letters"
    assert told.isprintable(), "the reason may steer a terminal"
    return 0
