"""The one place that names the compiler of the per-beam and per-cell kernels."""

from collections.abc import Callable
from typing import ParamSpec, TypeVar, cast

import numba

P = ParamSpec("P")
R = TypeVar("R")


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile with Numba to machine code, kept on disk beside the source; strict IEEE arithmetic.

    No fast-math and no threads: the same input gives the same bits.
    """
    return cast(Callable[P, R], numba.njit(cache=True)(function))
