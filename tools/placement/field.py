"""Random stepfields: square blocks of random heights, endless by repetition."""

import numpy as np

from core.records import F64

BLOCK_M = 0.10  # edge of a block
STEP_M = 0.05  # heights are multiples of it
BLOCKS = 60  # along an edge, before the field repeats


def flat() -> F64:
    return np.zeros((BLOCKS, BLOCKS))


def stepfield(seed: int, number: int, highest_m: float) -> F64:
    """Heights (BLOCKS, BLOCKS) of blocks [i, j] along x and y, from 0 to `highest_m`."""
    steps = int(highest_m / STEP_M + 1e-9)
    random = np.random.default_rng([seed, number])
    return np.asarray(STEP_M * random.integers(0, steps + 1, (BLOCKS, BLOCKS)))
