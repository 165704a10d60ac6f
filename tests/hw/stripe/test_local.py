"""The driver on a camera of this machine, and on a folder: the same session, the same sweeps."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core.records import PointSweep
from fakes.stripe.video import FakeVideo
from hw.device import Port
from hw.ports.camera import CameraPort
from hw.ports.url import parse_url
from hw.ports.wires import open_port
from hw.registry import SCANNERS, Surroundings
from tests.hw.stripe.test_session import AGAIN, NEAR
from tests.hw.stripe.test_sweep import options_of
from tests.support.machine.real_wires import until

pytest.importorskip("cv2", reason="needs OpenCV: pip install 'mapod[camera]'")
STEP_S = 0.005


def bare(jpeg: bytes) -> bytes:
    """Without its tables of codes, as cameras on USB send it."""
    while (at := jpeg.find(b"\xff\xc4")) > 0:
        jpeg = jpeg[:at] + jpeg[at + 2 + int.from_bytes(jpeg[at + 2 : at + 4], "big") :]
    return jpeg


class Bench:
    """The driver on a port, stepped until something is so."""

    def __init__(self, port: Port, url: str) -> None:
        self.scanner = SCANNERS["stripe"].make(port, options_of(), Surroundings(url, 1.0, False))
        self.now_s, self.sweeps = 50.0, list[PointSweep]()

    def until(self, is_so: Callable[[], bool]) -> None:
        def stepped() -> bool:
            self.now_s += STEP_S
            self.sweeps += [
                one for one in self.scanner.step(self.now_s) if isinstance(one, PointSweep)
            ]
            return is_so()

        until(stepped)


def test_a_camera_measures_is_unplugged_and_measures_again(tmp_path: Path) -> None:
    node, video = tmp_path / "video0", FakeVideo()
    node.touch()
    url = f"v4l2://{node}?width=640&height=480&rate=30"
    kernel: Any = video
    port = CameraPort(parse_url(url), kernel)
    bench, status = Bench(port, url), None
    status = bench.scanner.status
    shown = [bare(NEAR), bare(AGAIN)]

    def measures() -> bool:
        """The next image, 20 ms after its exposure."""
        video.show(shown[0], bench.now_s - 0.02)
        shown.reverse()
        return bool(bench.sweeps)

    bench.until(measures)
    assert status.state == "running"
    assert bench.sweeps[0].ranges_m.shape == (1, 640)
    assert np.isfinite(bench.sweeps[0].ranges_m).mean() > 0.9
    video.unplug()
    node.unlink()
    bench.until(lambda: status.state == "closed")
    assert status.cause == f"no such device {node}"
    bench.sweeps.clear()
    video.plug()
    node.touch()
    bench.until(measures)
    assert (status.state, status.losses) == ("running", 1)  # a thread of its own may be late
    port.close()


def test_a_folder_measures_at_its_times_and_then_says_that_it_is_over(tmp_path: Path) -> None:
    for k, image in enumerate((NEAR, AGAIN, NEAR)):
        (tmp_path / f"{k}.jpg").write_bytes(image)
    (tmp_path / "times.csv").write_text("0.jpg,100.0\n1.jpg,100.1\n2.jpg,100.25\n")
    port = open_port(f"folder://{tmp_path}")
    bench = Bench(port, f"folder://{tmp_path}")
    bench.until(lambda: "are sent" in bench.scanner.status.cause)
    assert len(bench.sweeps) == 3
    at_s = np.array([sweep.times_s[0] for sweep in bench.sweeps])
    np.testing.assert_allclose(np.diff(at_s), [0.1, 0.15], atol=STEP_S)
    assert bench.scanner.status.state == "closed"
    port.close()
