"""What an image of a laser's line costs, from bytes to points: `python -m tools.bench.stripe`.

The images of the fake camera of robots/ragno.toml are taken as they come over HTTP: parsed, checked
whether they are whole, decoded, searched for the line, and made rays. Plain OpenCV and NumPy do of
the same what they can without a loop: decode, brightest place of each column, centre of gravity,
ranges; no check, no second line, no doubt. Times are of the CPU, medians; the ratio of both
compares between machines, and busy hours of one.
"""

import math
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from config_file import load_config
from core.records import F64
from fakes.stripe.device import FakeStripe
from fakes.stripe.http import head, part
from fakes.stripe.jpeg import jpeg_from_image
from fakes.world.simple import Ground
from hw.stripe.images import MISSING, Decoder, maybe_opencv
from hw.stripe.jpeg import fault_of_image
from hw.stripe.mjpeg import Jpeg, MjpegParser
from hw.stripe.options import StripeOptions
from hw.stripe.sweep import SweepMaker

SETTINGS = Path(__file__).resolve().parents[2] / "robots" / "ragno.toml"
GROUND = "wall:0.9"
IMAGES, ROUNDS = 8, 25
REACH_PX = 4  # rows to either side of the brightest, whose centre of gravity is taken
LEAST = 20.0  # levels


def images(count: int) -> list[bytes]:
    """JPEGs of the fake camera."""
    fake = FakeStripe(Ground(GROUND).met, 1)
    return [jpeg_from_image(fake.camera.image(k / fake.rate_hz), fake) for k in range(count)]


class PlainPeer:
    """The same by OpenCV's and NumPy's own functions."""

    def __init__(self, options: StripeOptions) -> None:
        self._options, self._opencv = options, maybe_opencv()
        (fx, fy), (cx, cy) = options.focal_px, options.centre_px
        self._matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        self._distortion = np.array(options.distortion)

    def ranges_m(self, jpeg: bytes) -> tuple[F64, F64]:
        """Rows of the line (w,), NaN: none, and ranges."""
        cv2, options = self._opencv, self._options
        image = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
        blue, green, red = cv2.split(image)
        signal = red.astype(np.float32) - 0.5 * green - 0.5 * blue
        smooth = cv2.blur(signal, (1, 3))
        u, rows = np.arange(image.shape[1]), np.argmax(smooth, axis=0)
        rows = np.clip(rows, REACH_PX, len(image) - 1 - REACH_PX)
        near = rows + np.arange(-REACH_PX, REACH_PX + 1)[:, None]
        weights = np.maximum(0.0, signal[near, u] - signal[near[[0, -1]], u].max(axis=0))
        with np.errstate(invalid="ignore", divide="ignore"):
            places = (weights * near).sum(axis=0) / weights.sum(axis=0)
        places[smooth[rows, u] < LEAST] = np.nan
        pixels = np.stack([u, np.nan_to_num(places)], axis=1)[:, None]
        p, q = cv2.undistortPoints(pixels, self._matrix, self._distortion)[:, 0].T
        ahead_m = options.baseline_m / (math.tan(math.radians(options.laser_deg)) - q)
        return places, np.where(np.isnan(places), np.nan, ahead_m * np.sqrt(1.0 + p * p + q * q))


def median_ms(work: Callable[[int], Any]) -> float:
    """CPU time of a round, given its number."""
    spent_s = []
    for k in range(ROUNDS * IMAGES):
        begun_s = time.thread_time()
        work(k % IMAGES)
        spent_s.append(time.thread_time() - begun_s)
    return 1e3 * float(np.median(spent_s))


class Line:
    """Images of one camera, and how they become points."""

    def __init__(self) -> None:
        options = load_config(SETTINGS.read_text(encoding="utf-8")).scanner.options
        assert isinstance(options, StripeOptions)
        self.image_px, self.maker = options.image_px, SweepMaker(options)
        w, h = options.image_px
        self.decoder, self.peer = Decoder((w, h)), PlainPeer(options)
        self._parser = MjpegParser(options.most_bytes)

    def begin(self) -> None:
        """With images there, and kernels compiled."""
        self.maker.warm()
        self.jpegs = images(IMAGES)
        self._parts = [part(jpeg, 0, True) for jpeg in self.jpegs]
        self._parser.feed(0.0, head())

    def whole(self, k: int) -> None:
        """From bytes to points."""
        for event in self._parser.feed(0.0, self._parts[k % IMAGES]):
            if isinstance(event, Jpeg):
                self.maker.sweep(np.asarray(self.decoder.image(event.data)), 0.0, 0.0)

    def plain(self, k: int) -> None:
        """The same, by others' functions."""
        self.peer.ranges_m(self.jpegs[k % IMAGES])


def main() -> int:
    line = Line()
    decoder, maker = line.decoder, line.maker
    if decoder.is_missing:
        print(f"mapod: {MISSING}", file=sys.stderr)
        return 1
    line.begin()
    jpegs, (w, h) = line.jpegs, line.image_px
    decoded = [np.asarray(decoder.image(jpeg)) for jpeg in jpegs]
    ms, peer_ms = median_ms(line.whole), median_ms(line.plain)
    check_ms = median_ms(lambda k: fault_of_image(jpegs[k]))
    image_ms = median_ms(lambda k: decoder.image(jpegs[k]))
    sweep_ms = median_ms(lambda k: maker.sweep(decoded[k], 0.0, 0.0))
    print(
        f"mapod: an image of {w} x {h} px, {len(jpegs[0]) / 1000:.0f} kB, from bytes to points: "
        f"{ms:.2f} ms (whole? {check_ms:.2f}, decoding {image_ms - check_ms:.2f}, line and rays "
        f"{sweep_ms:.2f}); plain OpenCV and NumPy {peer_ms:.2f} ms; {ms / peer_ms:.2f} times"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
