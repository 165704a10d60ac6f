"""The decode bench: what it claims of damaged streams, as a ratio within one run."""

import pytest

from tools.bench.decode import Cost, altered, costs


@pytest.fixture(scope="module")
def measured() -> list[Cost]:
    return costs()


@pytest.mark.slow
def test_every_codec_is_timed_on_whole_frames(measured: list[Cost]) -> None:
    assert [cost.unit for cost in measured] == ["telegram", "telegram", "packet", "packet", "line"]
    assert all(cost.frames > 10 for cost in measured)


def test_so_many_bytes_are_altered_as_said() -> None:
    clean = bytes(10_000)
    assert sum(byte != 0 for byte in altered(clean, 0.01, seed=3)) == 100
