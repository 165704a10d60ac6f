"""The driver on a camera's bytes: sweeps at their instants, and in words what is wrong."""

from typing import Any

import numpy as np
import pytest

from core.mapping.rays import check_sweep
from core.records import PointSweep
from fakes.wires.wire import MemoryPort
from hw.registry import SCANNERS, Surroundings
from hw.stripe import images
from hw.stripe.images import MISSING
from hw.stripe.session import PAUSE_S, StripeScanner
from tests.hw.stripe.pictures import Picture
from tests.hw.stripe.test_mjpeg import HEAD, part
from tests.hw.stripe.test_sweep import options_of, rows_of_wall

cv2: Any = pytest.importorskip("cv2", reason="needs OpenCV: pip install 'mapod[camera]'")
REQUEST = b"GET /stream HTTP/1.0\r\n"


def jpeg(away_m: float, width: int = 640, line: bool = True, seed: int = 1) -> bytes:
    picture = Picture(seed, size=(480, width))
    if line:
        picture.line(rows_of_wall(np.full(width, away_m)))
    done, data = cv2.imencode(".jpg", picture.shot(), [cv2.IMWRITE_JPEG_QUALITY, 90])
    assert done
    return bytes(data)


def stamped(data: bytes, at_s: float) -> bytes:
    return part(data).replace(b"\r\n\r\n", b"\r\nX-Timestamp: %.6f\r\n\r\n" % at_s, 1)


AGAIN = jpeg(1.0, seed=2)  # as NEAR, but for its noise
NEAR, FAR, DARK, SMALL = jpeg(1.0), jpeg(2.0), jpeg(1.0, line=False), jpeg(1.0, width=320)


class Bench:
    """The driver, and the camera's end of its wire."""

    def __init__(self, **given: Any) -> None:
        self.port, self.now_s = MemoryPort(), 50.0
        around = Surroundings("tcp://10.0.0.5:8080", 1.0, False)
        self.options = options_of(**given)
        made = SCANNERS["stripe"].make(self.port, self.options, around)
        assert isinstance(made, StripeScanner)
        self.scanner = made
        self.asked = b""

    def run(self, data: bytes = b"", seconds: float = 0.005) -> list[PointSweep]:
        """The camera sends; so long passes, in ticks."""
        sweeps: list[PointSweep] = []
        if data:
            self.port.give(data)
        for _ in range(round(seconds / 0.005)):
            sweeps += list(self.scanner.step(self.now_s))
            self.asked += self.port.take()
            self.now_s += 0.005
        return sweeps

    @property
    def told(self) -> tuple[str, str]:
        return self.scanner.status.state, self.scanner.status.cause


def begun() -> Bench:
    bench = Bench()
    bench.run(seconds=0.02)
    assert bench.asked.startswith(REQUEST)
    assert b"Host: 10.0.0.5\r\n" in bench.asked
    bench.run(HEAD)
    return bench


def ahead_m(sweep: PointSweep) -> float:
    return float(np.nanmedian(sweep.ranges_m[0] * sweep.directions[:, 0]))


def test_each_image_is_a_sweep_at_its_instant() -> None:
    bench = begun()
    for away_m, data in ((1.0, NEAR), (2.0, FAR)):
        whole, came_s = part(data), bench.now_s
        assert bench.run(whole[:5000], 0.02) == []
        (sweep,) = bench.run(whole[5000:], 0.02)
        check_sweep(sweep, bench.options.spec.max_beams)
        assert ahead_m(sweep) == pytest.approx(away_m, rel=0.01)
        assert np.isfinite(sweep.ranges_m).mean() > 0.95
        assert sweep.times_s[0] == pytest.approx(came_s - 0.05)
        assert sweep.arrived_s > came_s
    assert bench.told == ("running", "")
    assert bench.scanner.doubt == ""
    assert bench.scanner.measured()["line_share"] > 0.9


def test_of_images_without_a_stamp_that_come_at_once_the_newest_is_measured_alone() -> None:
    bench = begun()
    (sweep,) = bench.run(part(NEAR) + part(NEAR) + part(FAR))
    assert ahead_m(sweep) == pytest.approx(2.0, rel=0.01)
    assert bench.scanner.measured()["images_passed_over"] == 2


def test_of_stamped_ones_the_two_newest_are_measured_one_a_step() -> None:
    bench = begun()
    assert len(bench.run(stamped(AGAIN, 7.0), 0.1)) == 1
    (near,) = bench.run(stamped(AGAIN, 7.08) + stamped(NEAR, 7.09) + stamped(FAR, 7.1))
    assert bench.scanner.has_heard
    assert bench.scanner.due_s < bench.now_s  # it wants the next step, though no byte may come
    (far,) = bench.run()
    assert not bench.scanner.has_heard
    assert [ahead_m(one) for one in (near, far)] == pytest.approx([1.0, 2.0], rel=0.01)
    assert far.times_s[0] - near.times_s[0] == pytest.approx(0.01, abs=1e-3)
    assert bench.scanner.measured()["images_passed_over"] == 1


def test_another_resolution_is_told_and_the_right_one_goes_on() -> None:
    bench = begun()
    assert len(bench.run(part(NEAR))) == 1
    assert bench.run(part(SMALL)) == []
    assert bench.scanner.status.rejected == 1
    assert len(bench.run(part(AGAIN))) == 1
    for _ in range(10):
        bench.run(part(SMALL), 0.3)
    assert bench.told[0] == "starting"
    assert "320 x 480 px, scanner.image_px has 640 x 480" in bench.told[1]


def test_damaged_images_are_counted_and_the_next_is_measured() -> None:
    bench = begun()
    assert bench.run(part(NEAR[:-900])) == []
    assert bench.run(part(b"\xff\xd8nothing\xff\xd9")) == []
    assert bench.scanner.status.rejected == 2
    assert len(bench.run(part(NEAR))) == 1


def test_without_a_line_it_is_as_good_as_silent_and_nobody_may_drive_by_it() -> None:
    bench = begun()
    assert bench.run(part(DARK)) == []
    assert bench.told == ("running", "")
    assert "sees no line" in bench.scanner.doubt
    assert bench.scanner.is_impaired
    sweeps = [bench.run(part(data), 0.1) for data in (NEAR, AGAIN) * 2]
    assert all(sweeps[1:])  # the first one is weighed by 5 ms
    assert bench.scanner.doubt == ""
    for _ in range(10):
        bench.run(part(DARK), 0.1)  # the same one: black all over has no noise
    assert bench.scanner.status.rejected == 0
    assert bench.run(part(DARK)) == []
    assert "sees no line" in bench.scanner.doubt


def test_silence_and_refusals_are_told_and_it_asks_again() -> None:
    bench = begun()
    bench.run(part(NEAR))
    bench.asked = b""
    bench.run(seconds=2.1)
    assert bench.told == ("starting", "no image from the camera for 2 s")
    bench.port.connected = False
    bench.run()
    bench.port.connected = True
    bench.run(seconds=0.1)
    assert bench.asked.startswith(REQUEST)
    bench.run(b"HTTP/1.0 404 Not Found\r\n\r\n", 0.1)
    assert bench.told == ("starting", "the camera refuses the stream: '404 Not Found'")
    bench.asked = b""
    bench.run(seconds=PAUSE_S + 0.1)
    assert bench.asked.startswith(REQUEST)


def test_the_same_image_again_is_no_measurement_and_is_told() -> None:
    bench = begun()
    assert len(bench.run(part(NEAR))) == 1
    for _ in range(30):
        assert bench.run(part(NEAR), 0.1) == []
    assert bench.scanner.status.rejected == 30
    assert bench.told == ("starting", "the same image again: the camera's picture stands still")


def test_without_opencv_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(images, "maybe_opencv", lambda: None)
    bench = Bench()
    bench.run(seconds=1.0)
    assert bench.told == ("starting", MISSING)
    assert bench.asked == b""
