"""The fake camera on its wire, as bytes; simulated time."""

import io
import re
from typing import Any

import numpy as np
import pytest
from PIL import Image

from fakes.stripe.device import Client, FakeStripe
from fakes.world.simple import Ground

GET = b"GET /stream HTTP/1.0\r\n\r\n"
HEAD = (
    b"HTTP/1.0 200 OK\r\nConnection: close\r\nCache-Control: no-store\r\n"
    b"Content-Type: multipart/x-mixed-replace; boundary=imagefollows\r\n\r\n--imagefollows\r\n"
)
PART = re.compile(
    rb"Content-Type: image/jpeg\r\nContent-Length: (\d+)\r\nX-Timestamp: (\d+\.\d{6})\r\n\r\n"
)
MARK = b"\r\n--imagefollows\r\n"


class Bench:
    """A fake that looks at the floor, and a host's end of its wire."""

    def __init__(self, **attributes: Any) -> None:
        self.fake = FakeStripe(Ground("floor").met, 1)
        self.fake.jitter_s = 0.0
        self.now_s = 100.0
        self.set(**attributes)

    def set(self, **attributes: Any) -> None:
        for name, value in attributes.items():
            setattr(self.fake, name, value)

    def run(self, seconds: float, sent: bytes = b"", guest: Client | None = None) -> bytes:
        got = b""
        for _ in range(round(seconds / 0.005)):
            got += (guest or self.fake).exchange(self.now_s, sent)
            sent = b""
            self.now_s += 0.005
        return got


def parts_of(stream: bytes) -> list[tuple[float, bytes]]:
    """(camera's time, file) of whole parts one behind the other; fails on anything else."""
    parts = []
    while found := PART.match(stream):
        end = found.end() + int(found[1])
        assert stream[end : end + len(MARK)] == MARK
        parts.append((float(found[2]), stream[found.end() : end]))
        stream = stream[end + len(MARK) :]
    assert stream == b""
    return parts


def test_who_asks_gets_a_head_and_thirty_images_a_second_with_their_times() -> None:
    bench = Bench()
    assert bench.run(0.5) == b""
    assert bench.run(0.02, GET[:9]) == b""
    stream = bench.run(1.0, GET[9:])
    assert stream.startswith(HEAD)
    parts = parts_of(stream[len(HEAD) :])
    assert 28 <= len(parts) <= 30
    times_s = [t_s for t_s, _ in parts]
    assert np.diff(times_s) == pytest.approx(1 / 30, abs=1e-5)
    picture = Image.open(io.BytesIO(parts[0][1]))
    picture.load()
    assert (picture.format, picture.size) == ("JPEG", (640, 480))


def test_it_repeats_the_images_that_it_has_drawn_if_told_to() -> None:
    bench = Bench(repeated=3)
    parts = parts_of(bench.run(0.3, GET)[len(HEAD) :])
    files = [file for _, file in parts]
    assert len(files) >= 6
    assert len(set(files)) == 3
    assert files[3:6] == files[:3]
    assert len({t_s for t_s, _ in parts}) == len(parts)


@pytest.mark.parametrize(
    ("request_", "answer"),
    [
        (b"GET /other HTTP/1.1\r\nHost: a\r\n\r\n", b"HTTP/1.0 404 Not Found\r\n"),
        (b"POST /stream HTTP/1.0\r\n\r\n", b"HTTP/1.0 405 Method Not Allowed\r\n"),
        (b"\xff\x00\r\n\r\n", b"HTTP/1.0 400 Bad Request\r\n"),
        (b"x" * 5000, b"HTTP/1.0 400 Bad Request\r\n"),
    ],
)
def test_anything_else_is_refused_and_its_connection_ends(request_: bytes, answer: bytes) -> None:
    bench = Bench()
    guest = bench.fake.connect(bench.now_s)
    assert bench.run(0.2, request_, guest).startswith(answer)
    assert guest.gone


def test_two_hosts_see_the_same_images_and_one_that_has_left_gets_no_more() -> None:
    bench = Bench()
    one, two = (bench.fake.connect(bench.now_s) for _ in range(2))
    bench.run(0.01, GET, one)
    bench.run(0.01, GET, two)
    first, second = bench.run(0.2, b"", one), bench.run(0.005, b"", two)
    assert len(parts_of(first)) > 3
    assert parts_of(first)[1] in parts_of(second.removeprefix(HEAD))
    two.left(bench.now_s)
    bench.run(0.1, b"", two)  # what was on its way
    assert bench.run(0.2, b"", two) == b""


def test_unplugged_its_streams_end_and_who_asks_hears_why() -> None:
    bench = Bench()
    guest = bench.fake.connect(bench.now_s)
    assert len(bench.run(0.3, GET, guest)) > len(HEAD)
    bench.set(gone=True)
    bench.run(0.2, b"", guest)
    assert guest.gone
    again = bench.fake.connect(bench.now_s)
    assert bench.run(0.1, GET, again).startswith(b"HTTP/1.0 503 ")
    bench.set(gone=False)
    assert bench.run(0.3, GET, bench.fake.connect(bench.now_s)).startswith(HEAD)


def test_faults_of_its_images() -> None:
    bench = Bench()
    bench.run(0.3, GET)

    def files() -> list[bytes]:
        return [data for _, data in parts_of(bench.run(0.2))]

    bench.run(0.1)
    whole = files()
    assert len(set(whole)) == len(whole)
    bench.set(frozen=True)
    bench.run(0.1)
    assert len(set(files())) == 1
    bench.set(frozen=False, truncated_rate=1.0)
    bench.run(0.1)
    assert not any(data.endswith(b"\xff\xd9") for data in files())
    bench.set(truncated_rate=0.0, torn_rate=1.0)
    bench.run(0.1)
    torn = files()
    assert all(data.endswith(b"\xff\xd9") for data in torn)
    assert min(map(len, torn)) < 0.9 * min(map(len, whole))
    bench.set(torn_rate=0.0, image_px=(320, 240))
    bench.run(0.1)
    assert {Image.open(io.BytesIO(data)).size for data in files()} == {(320, 240)}


def test_faults_of_its_pace() -> None:
    bench = Bench()
    bench.run(0.3, GET)
    before = parts_of(bench.run(0.3))[-1][0]
    bench.set(late_s=0.3)
    assert bench.run(0.28) == b""
    after = parts_of(bench.run(0.1))
    assert after[0][0] == pytest.approx(before + 1 / 30, abs=0.034)
    bench.set(late_s=0.0, mute=True)
    assert bench.run(0.5) == b""
    bench.set(mute=False, rate_hz=10.0)
    bench.run(0.2)
    assert len(parts_of(bench.run(1.0))) == 10


def test_cameras_that_tell_less() -> None:
    bench = Bench(tells_length=False, tells_time=False)
    stream = bench.run(0.3, GET).removeprefix(HEAD)
    assert stream.startswith(b"Content-Type: image/jpeg\r\n\r\n\xff\xd8")
