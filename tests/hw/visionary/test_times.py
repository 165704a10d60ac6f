"""Instants of frames: a steady clock, one that is set, one that restarts, frames that are late."""

import pytest

from hw.device import BadFrame
from hw.visionary.times import FORGET_S, LATE_S, FrameTimes

PERIOD_MS, DELAY_S, LATENCY_S = 33, 0.04, 0.03
CALENDAR_MS = 1_795_358_159_123


class Frames:
    """A camera's: stamps and arrivals in step, until a test makes them otherwise."""

    def __init__(self, period_ms: int = PERIOD_MS) -> None:
        self.times = FrameTimes(float(PERIOD_MS), LATENCY_S)
        self.times.begin(float(PERIOD_MS))
        self.t_ms, self.period_ms, self.ahead_ms = 0, period_ms, CALENDAR_MS

    def off_s(self, frames: int = 1, late_s: float = 0.0) -> float | BadFrame:
        """By what the instant of the next frame is wrong, beside the delay that is not told."""
        self.t_ms += frames * self.period_ms
        began_s = self.t_ms / 1000 + DELAY_S + late_s
        told = self.times.exposed_s(self.ahead_ms + self.t_ms, frames, began_s)
        if isinstance(told, BadFrame):
            return told
        return told + LATENCY_S - DELAY_S - self.t_ms / 1000

    def run(self, count: int) -> None:
        for _ in range(count):
            assert self.off_s() == pytest.approx(0.0, abs=1e-3)


def test_a_frame_that_was_held_up_keeps_its_instant_and_one_that_is_too_late_is_refused() -> None:
    frames = Frames()
    frames.run(60)
    assert frames.times.locked
    assert frames.off_s(late_s=LATE_S - 0.02) == pytest.approx(0.0, abs=1e-3)
    late = frames.off_s(late_s=0.4)
    assert isinstance(late, BadFrame)
    assert late.reason == "a frame that comes 0.4 s late"
    frames.run(30)


@pytest.mark.parametrize("by_ms", [-3_600_000, -1500, -300, 300, 1500, 3_600_000, -(10**12)])
def test_a_clock_that_is_set_moves_no_instant(by_ms: int) -> None:
    frames = Frames()
    frames.run(60)
    frames.ahead_ms += by_ms
    frames.run(60)
    assert frames.times.settings == 1
    assert frames.times.locked


def test_frames_that_never_came_are_no_setting_of_the_clock() -> None:
    frames = Frames()
    frames.run(30)
    assert frames.off_s(frames=9) == pytest.approx(0.0, abs=1e-3)
    frames.run(30)
    assert frames.times.settings == 0


def test_a_camera_that_exposes_longer_is_followed() -> None:
    frames = Frames(period_ms=100)
    frames.run(30)
    frames.period_ms = 40
    frames.run(30)
    assert frames.times.settings == 0


@pytest.mark.parametrize("by_ms", [-3_600_000, 1500])
def test_after_a_pause_the_clock_is_kept_where_it_fits_and_begun_anew_where_not(by_ms: int) -> None:
    frames = Frames()
    frames.run(60)
    frames.t_ms += 5000
    frames.times.begin(float(PERIOD_MS))
    frames.run(1)
    assert frames.times.locked
    frames.t_ms += 5000
    frames.ahead_ms += by_ms
    frames.times.begin(float(PERIOD_MS))
    frames.run(1)
    assert not frames.times.locked
    frames.run(60)
    assert frames.times.locked


def test_frames_that_stay_late_are_refused_for_a_time_and_then_the_usual_ones() -> None:
    frames = Frames()
    frames.run(60)
    for _ in range(3):  # starting anew makes no difference
        frames.times.begin(float(PERIOD_MS))
        late = [frames.off_s(late_s=0.5) for _ in range(round(0.3 * FORGET_S * 1000 / PERIOD_MS))]
        assert all(isinstance(one, BadFrame) for one in late)
    late = [frames.off_s(late_s=0.5) for _ in range(round(0.2 * FORGET_S * 1000 / PERIOD_MS))]
    assert late[-1] == pytest.approx(0.5, abs=1e-3)
    assert frames.times.locked


def test_a_camera_that_restarts_is_believed_at_once() -> None:
    frames = Frames()
    frames.run(60)
    frames.ahead_ms -= 1500
    frames.times.restart()
    frames.run(10)
