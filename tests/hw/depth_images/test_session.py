"""The driver against the fake Kinect: images at their instants, and in words what is wrong."""

import numpy as np
import pytest

from fakes.kinect.faults import Form
from hw.depth_images.session import BLIND, LEAST_SILENCE_S, NO_TIME, PAUSE_S, SAME, START_S
from tests.support.devices.bench_kinect import Bench, points_of

BACK_S = PAUSE_S + 0.5  # within which it delivers again once a fault is over


def begun() -> Bench:
    bench = Bench()
    assert bench.run(0.5)
    assert bench.told == ("running", "")
    return bench


@pytest.mark.parametrize(("form", "seconds"), [("raw", 0.4), ("mm", 0.4), ("png", 2.0)])
def test_each_form_gives_images_of_the_world_at_their_instants(form: Form, seconds: float) -> None:
    bench = Bench(form)
    images = bench.run(seconds)
    assert bench.told == ("running", "")
    assert len(images) >= seconds * 30 - 3
    assert bench.camera.status.missed == bench.camera.status.rejected == 0
    latency_s = 0.0 if form == "png" else bench.fake.latency_s  # of a data set: as it tells
    exposed_s = np.array(bench.fake.exposed_s) + bench.fake.latency_s - latency_s
    for image in images:
        assert np.abs(exposed_s - image.t_s).min() < 2e-6  # stamps are in microseconds
    assert len({id(image.camera) for image in images}) == 1
    image, truth = images[-1], bench.fake.truth
    assert truth is not None
    points = points_of(image)
    off = points[..., 0] - truth.truth_m
    assert np.isfinite(off[:, :-8]).all()
    assert np.nanmax(np.abs(off) / truth.truth_m**2) < 0.006  # 1.8 raw values
    assert np.nanmax(np.abs(points[..., 2] + 0.6)[truth.raw.shape[0] // 2 :]) < 1.0
    left, right = np.nanmean(points[:, 0, 1]), np.nanmean(points[:, -10, 1])
    assert left > 0.0 > right
    assert not image.numbers.flags.writeable


@pytest.mark.parametrize(
    ("fault", "value", "why"),
    [
        ("frozen", True, SAME),
        ("untimed", True, NO_TIME),
        ("stamp_late_s", 0.4, "an image that comes 0.4 s late"),
        ("stamp_late_s", -0.1, "s early"),
        ("small", True, "an image of 32 x 24 px, its camera has 64 x 48"),
        ("cut_rate", 1.0, "a part that does not end where it says"),
    ],
)
def test_what_is_of_no_use_is_refused_told_and_over_when_it_is_over(
    fault: str, value: float, why: str
) -> None:
    bench = begun()
    before = getattr(bench.fake, fault)
    setattr(bench.fake, fault, value)
    bench.run(0.1)
    heard_s = bench.camera.status.heard_s
    assert bench.run(LEAST_SILENCE_S + 0.4) == []
    assert bench.camera.status.heard_s == heard_s
    assert any(why in reason for reason in bench.reasons)
    assert bench.camera.status.state == "starting"
    assert why in bench.told[1]
    setattr(bench.fake, fault, before)
    assert bench.run(BACK_S + 0.3)
    assert bench.told == ("running", "")


@pytest.mark.parametrize(
    ("fault", "why"),
    [
        ("no_camera", "an image, and no camera.toml before it"),
        ("wrong_matrix", "camera.toml has a camera matrix that can't be: fx 580, cx 31.5"),
    ],
)
def test_without_a_lens_that_can_be_nothing_is_delivered(fault: str, why: str) -> None:
    bench = Bench()
    setattr(bench.fake, fault, True)
    assert bench.run(START_S + 0.5) == []
    assert any(why in reason for reason in bench.reasons)
    assert why in bench.told[1]
    setattr(bench.fake, fault, False)
    bench.port.connected = False
    bench.run(0.1)
    bench.port.connected = True
    assert bench.run(0.5)


def test_who_sees_nothing_is_as_good_as_silent_and_says_so() -> None:
    bench = begun()
    bench.fake.all_invalid = True
    bench.run(0.1)
    assert bench.run(3.0) == []
    assert bench.told == ("running", "")
    assert bench.camera.doubt == BLIND
    assert bench.camera.is_impaired
    assert bench.now_s - bench.camera.status.heard_s > 2.9
    bench.fake.all_invalid = False
    assert bench.run(0.5)
    assert bench.camera.doubt == ""


def test_silence_is_a_loss_and_images_after_it_come_again() -> None:
    bench = begun()
    bench.fake.mute = True
    bench.run(LEAST_SILENCE_S + 0.2)
    assert bench.told == ("starting", f"no image from the camera for {LEAST_SILENCE_S:g} s")
    assert bench.camera.status.losses == 1
    bench.fake.mute = False
    assert bench.run(BACK_S)


def test_damage_now_and_then_costs_the_damaged_images_alone() -> None:
    bench = begun()
    bench.fake.damaged_rate = 0.3
    images = bench.run(3.0)
    assert 40 < len(images) < 80
    assert bench.camera.status.rejected > 5
    assert bench.told == ("running", "")
    truth = np.nanmedian(points_of(images[-1])[..., 0])
    assert abs(truth - np.nanmedian(points_of(images[0])[..., 0])) < 0.01


def test_of_frames_between_two_steps_the_newest_is_taken() -> None:
    bench = begun()
    for _ in range(25):
        bench.wire.step(bench.now_s)
        bench.now_s += 0.004
    images = bench.camera.step(bench.now_s)
    assert len(images) == 1
    assert bench.camera.measured()["frames_passed_over"] == 2
    assert bench.camera.status.missed == 2
