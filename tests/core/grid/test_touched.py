"""Cells that a scan has met, against a dict."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from core.grid.touched import Touched, touch

SCANS = st.lists(st.lists(st.integers(0, 8), max_size=12), max_size=5)


@given(scans=SCANS)
def test_each_cell_is_noted_once_a_scan_and_begins_with_nothing_said(
    scans: list[list[int]],
) -> None:
    touched = Touched.none(9)
    for scan in scans:
        touched.used[0], model = 0, dict[int, int]()
        for at in scan:
            slot = touch(at, touched)
            assert touched.bits[slot] == model.get(at, 0)
            model[at] = model.get(at, 0) + 1
            touched.bits[slot] += 1
        assert touched.at[: touched.used[0]].tolist() == list(model)
        assert np.array_equal(touched.bits[: touched.used[0]], list(model.values()))
