"""What no number of a saved state can be beyond."""

from typing import Any

import numpy as np
import numpy.typing as npt

from core.config import Config
from core.saved.encoding import Arrays, StateError

MOST_M = 1e6  # no place and no height is farther off
MOST_S = 1e9  # nor anything longer ago
MOST_CELLS = 100_000_000  # nor a cell's index
MOST_SCANS = 2**31 - 2  # as many as a record can number


def check_within(name: str, array: npt.NDArray[Any], least: float, most: float) -> None:
    """Let an array pass that lies within bounds; NaN is within nothing."""
    if array.size and not (array.min() >= least and array.max() <= most):
        raise StateError(f"{name}: holds what can't be; it must lie within {least:g}..{most:g}")


def check_places(arrays: Arrays, kept: tuple[str, ...], config: Config) -> None:
    """Let cells pass that lie in the grid, in order, and of which all fields are there."""
    at = arrays["cells.at"]
    check_within("cells.corner", arrays["cells.corner"], -MOST_CELLS, MOST_CELLS)
    check_within("cells.at", at, 0, config.map.cells**2 - 1)
    if (np.diff(at) <= 0).any():
        raise StateError("cells.at: holds a cell twice, or out of order")
    for name in kept:
        field = arrays[f"cells.{name}"]
        if field.shape != at.shape:
            raise StateError(f"cells.{name}: has {len(field)} cells, cells.at has {len(at)}")
