"""The decode bench: what it decodes and damages. How fast that is, it prints; no test asks."""

from tools.bench.decode import altered, costs


def test_every_codec_is_timed_on_whole_frames() -> None:
    measured = costs()
    assert [cost.unit for cost in measured] == ["telegram", "telegram", "packet", "packet", "line"]
    assert all(cost.frames > 10 for cost in measured)


def test_so_many_bytes_are_altered_as_said() -> None:
    clean = bytes(10_000)
    assert sum(byte != 0 for byte in altered(clean, 0.01, seed=3)) == 100
