"""The loop's slots: which one comes next after a step that took too long."""

import pytest

from main import slots_until_next


@pytest.mark.parametrize(
    ("since_due_s", "slots"),
    [(0.0, 1), (0.004, 1), (0.0052, 1), (0.0074, 1), (0.0076, 2), (0.0124, 2), (0.0126, 3)],
)
def test_a_slot_is_late_for_half_its_time_and_missed_from_there_on(
    since_due_s: float, slots: int
) -> None:
    assert slots_until_next(since_due_s, 0.005) == slots
