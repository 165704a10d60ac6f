"""What is told of how late ticks begin, by the app's log of each second."""

from tools.rig.lateness import Lateness, lateness, table_of


def test_it_counts_from_the_second_before_and_tells_the_latest_tick_of_all() -> None:
    def second(
        late_p50_s: float, latest_s: float | None, missed: int, added: int
    ) -> dict[str, object]:
        counted = {"slots_missed": missed, "scans_added": added}
        return {"late_p50_s": late_p50_s, "latest_s": latest_s, **counted}

    seconds = [second(0.9, 0.9, 5, 700), second(0.001, 0.002, 5, 800), second(0.002, None, 6, 898)]
    row = lateness(100.0, seconds)
    assert row == Lateness(100.0, 99.0, (0.001, 0.0, 0.002), 1)
    assert table_of([row]).row_count == 1
