"""Cases of a parametrized test of which a few are enough for each run."""

from collections.abc import Iterable
from typing import Any

import pytest


def few(cases: Iterable[Any], count: int) -> list[Any]:
    """The first so many as they are, the others only for `make test-all`."""
    given = list(cases)
    rest = [case if isinstance(case, tuple) else (case,) for case in given[count:]]
    return [*given[:count], *(pytest.param(*case, marks=pytest.mark.slow) for case in rest)]
