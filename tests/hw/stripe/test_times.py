"""Times of images: the camera's, by the least delayed of them; too late is of no use."""

import numpy as np
import pytest

from hw.device import BadFrame
from hw.stripe.mjpeg import Jpeg
from hw.stripe.times import ImageTimes

LATENCY_S, CAMERA_S = 0.05, 1.7e9 - 1000.0  # what its clock is ahead


def jpeg(exposed_s: float, delay_s: float, ahead_s: float = CAMERA_S) -> Jpeg:
    came_s = exposed_s + LATENCY_S + delay_s
    return Jpeg(b"", came_s, came_s, round((exposed_s + ahead_s) * 1e6))


def fed(times: ImageTimes, first_s: float, count: int = 60) -> list[float]:
    """Errors of the instants of images that are delayed by chance."""
    delays_s = np.random.default_rng(1).exponential(0.01, count)
    errors = []
    for k, delay_s in enumerate(delays_s):
        exposed_s = times.exposed_s(jpeg(first_s + k / 30.0, float(delay_s)))
        assert isinstance(exposed_s, float)
        errors.append(exposed_s - first_s - k / 30.0)
    return errors


def test_with_stamps_delays_of_chance_cost_little() -> None:
    times = ImageTimes(LATENCY_S)
    errors = np.abs(fed(times, 50.0))
    assert errors[30:].max() < 0.002
    assert errors[30:].max() < times.uncertainty_s < 0.02


def test_without_a_stamp_the_arrival_counts() -> None:
    times = ImageTimes(LATENCY_S)
    assert times.exposed_s(Jpeg(b"", 3.0, 3.1)) == 3.0 - LATENCY_S
    assert times.uncertainty_s == 0.01


def test_late_images_are_told_however_late_and_those_behind_them_are_believed() -> None:
    times = ImageTimes(LATENCY_S)
    fed(times, 50.0)
    for k, late_s in enumerate((0.5, 3.0, 60.0)):
        told = times.exposed_s(jpeg(53.0 + k, late_s))
        assert isinstance(told, BadFrame)
        assert told.reason == f"an image that comes {late_s:g} s late"
    assert np.abs(fed(times, 120.0)[30:]).max() < 0.002


def test_images_from_a_store_are_late_though_older_ones_came_before() -> None:
    times = ImageTimes(LATENCY_S)
    fed(times, 50.0)
    for ago_s in (1.0, 5.0, 30.0):
        told = times.exposed_s(jpeg(52.5 - ago_s, ago_s))
        assert isinstance(told, BadFrame)
    assert np.abs(fed(times, 60.0)[30:]).max() < 0.002


@pytest.mark.parametrize(("back_s", "away_s"), [(CAMERA_S, 10.0), (1200.0, 3600.0), (61.0, 0.1)])
def test_a_clock_that_begins_anew_is_believed_from_its_second_image_on_and_counted(
    back_s: float, away_s: float
) -> None:
    times = ImageTimes(LATENCY_S)
    fed(times, 50.0)
    at_s = 52.0 + away_s
    assert isinstance(times.exposed_s(jpeg(at_s, 0.0, CAMERA_S - back_s)), BadFrame)
    exposed_s = times.exposed_s(jpeg(at_s + 0.1, 0.0, CAMERA_S - back_s))
    assert isinstance(exposed_s, float)
    assert abs(exposed_s - at_s - 0.1) < 0.001
    assert times.restarts == 1


def test_one_damaged_stamp_is_one_refused_image() -> None:
    times = ImageTimes(LATENCY_S)
    fed(times, 50.0)
    assert isinstance(times.exposed_s(jpeg(53.0, 0.0, 0.0)), BadFrame)
    assert np.abs(fed(times, 54.0)[30:]).max() < 0.002
    assert times.restarts == 0


@pytest.mark.parametrize(
    ("stored_hz", "sent_hz"),
    [(30.0, 36.0), (30.0, 300.0), (30.0, 20.0), (30.0, 30.0), (15.0, 15.0)],
    ids=["drained slowly", "drained at once", "filled", "never drained", "at half the rate"],
)
def test_images_from_a_store_are_late_however_long_that_lasts(
    stored_hz: float, sent_hz: float
) -> None:
    times = ImageTimes(LATENCY_S)
    fed(times, 50.0, 600)
    for k in range(180):
        exposed_s, came_s = 71.0 + k / stored_hz, 80.0 + k / sent_hz
        if came_s - exposed_s > 0.5:
            assert isinstance(times.exposed_s(jpeg(exposed_s, came_s - exposed_s)), BadFrame)
    assert times.restarts == 0
