"""Jobs for the engine of sweeps, which other processes can import."""

import hashlib
import os
import signal
from pathlib import Path

from tools.sweep.rows import Row

ROUNDS = 300_000  # some tenths of a second


def squared(number: int) -> Row:
    """Takes its time."""
    data = b""
    for _ in range(ROUNDS):
        data = hashlib.sha256(data).digest()
    return {"square": number * number, "worker": os.getpid()}


def refused(number: int) -> Row:
    if number == 1:
        raise ValueError("one is refused")
    return {"square": number * number}


def killed(marker: Path) -> Row:
    """The first who does it is killed."""
    if not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return {"done": True}


def always_killed(number: int) -> Row:
    if number == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return {"square": number * number}
