"""A client that others wrote, OpenCV's VideoCapture, and the fake on real loopback TCP."""

import threading
from contextlib import closing
from typing import Any

import numpy as np
import pytest

from fakes.stripe.device import FakeStripe
from fakes.wires.sockets import TcpWire
from fakes.world.simple import Ground

cv2: Any = pytest.importorskip("cv2", reason="needs OpenCV: pip install 'mapod[camera]'")
FFMPEG = cv2.CAP_FFMPEG in cv2.videoio_registry.getStreamBackends()


@pytest.mark.skipif(not FFMPEG, reason="this build of OpenCV reads no streams")
def test_it_reads_the_stream_and_sees_the_line() -> None:
    fake, done = FakeStripe(Ground("wall:1.2").met, 1), threading.Event()
    fake.tilt_deg = 0.0
    with closing(TcpWire(fake)) as wire:

        def serve() -> None:
            steps = 0
            while not done.wait(0.001):
                steps += 1
                wire.step(100.0 + steps * 0.002)

        server = threading.Thread(target=serve)
        server.start()
        try:
            url = f"http://127.0.0.1:{wire.port}/stream"
            capture = cv2.VideoCapture(url, cv2.CAP_FFMPEG)
            assert capture.isOpened()
            for _ in range(5):
                is_read, image = capture.read()
                assert is_read
                assert image.shape == (480, 640, 3)
            capture.release()
        finally:
            done.set()
            server.join()
    light = image[:, :, 2].astype(float) - image[:, :, :2].mean(axis=2)
    height_m = 0.12 - np.tan(np.radians(11.0))
    assert np.median(light.argmax(axis=0)) == pytest.approx(239.5 - 600 * height_m, abs=1.0)
