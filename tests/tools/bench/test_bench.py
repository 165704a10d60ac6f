"""The decode bench times every codec on whole frames."""

import pytest

from tools.bench.bench import altered, costs


@pytest.mark.slow
def test_every_codec_is_timed_on_whole_frames() -> None:
    measured = costs()
    units = ["telegram", "telegram", "reply", "packet", "packet", "line"]
    assert [cost.unit for cost in measured] == units
    assert all(cost.frames > 10 for cost in measured)
    assert sum(byte != 0 for byte in altered(bytes(10_000), 0.01, seed=3)) == 100
