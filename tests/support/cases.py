"""How many cases of a test each run tries, and which are left to `make test-all` and `nightly`."""

from collections.abc import Iterable
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import settings

USUAL = 40  # examples of a property in each run


def few(cases: Iterable[Any], count: int) -> list[Any]:
    """The first so many as they are, the others only for `make test-all`."""
    given = list(cases)
    rest = [case if isinstance(case, tuple) else (case,) for case in given[count:]]
    return [*given[:count], *(pytest.param(*case, marks=pytest.mark.slow) for case in rest)]


def examples(count: int) -> int:
    """So many examples of a property that costs more than most; in proportion for `nightly`."""
    return round(count * settings().max_examples / USUAL)


def cut(stream: bytes, cuts: Iterable[int]) -> list[bytes]:
    """The stream in pieces."""
    edges = [0, *sorted(min(at, len(stream)) for at in cuts), len(stream)]
    return [stream[a:b] for a, b in pairwise(edges)]
