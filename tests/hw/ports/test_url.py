"""Port URLs: what they mean, and what is said of those that mean nothing."""

import contextlib
import doctest

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw.ports import url as port_url
from hw.ports.url import PortUrlError, parse_url


@pytest.mark.parametrize(
    ("url", "part"),
    [
        ("", "no such kind of port ''"),
        ("http://host:80", "no such kind of port 'http'"),
        ("tcp://host", "must be tcp://host:port"),
        ("tcp://:80", "must be tcp://host:port"),
        ("tcp://host:80/path", "must be tcp://host:port"),
        ("tcp://user@host:80", "must be tcp://host:port"),
        ("tcp://[::1:80", "'tcp://[::1:80'"),
        ("udp://host:0", "within 1..65535, is 0"),
        ("udp://host:65536", "within 1..65535, is 65536"),
        ("tcp://host:80 ", "no space"),
        ("serial:///dev/mti", "baud must be within 50..4000000, is missing"),
        ("serial:///dev/mti?baud=", "baud must be within"),
        ("serial:///dev/mti?baud=fast", "is 'fast'"),
        ("serial:///dev/mti?baud=5000000", "is '5000000'"),
        ("serial://dev/mti?baud=9600", "three slashes"),
        ("serial:///?baud=9600", "three slashes"),
        ("serial:///dev/mti?baud=9600&parity=X", "parity must be N or E or O, is 'X'"),
        ("serial:///dev/mti?baud=9600&bytesize=9", "bytesize must be 8 or 7, is '9'"),
        ("serial:///dev/mti?baud=9600&stopbits=3", "stopbits must be 1 or 2, is '3'"),
        ("serial:///dev/mti?baud=9600&baud=9600", "given once"),
        ("serial:///dev/mti?baud=9600&rtscts=1", "unknown key 'rtscts'"),
        ("serial:///dev/mti?baud", "is not key=value"),
        ("v4l2:///dev/video0?width=640&height=480", "rate must be within 1..120, is missing"),
        ("v4l2:///dev/video0?width=0&height=480&rate=30", "width must be within 32..4096, is '0'"),
        ("v4l2:///dev/video0?width=640&height=480&rate=30&gain=1", "unknown key 'gain'"),
        ("v4l2:///dev/video0?width=640&height=480&rate=9&exposure_us=", "within 100..1000000"),
        ("v4l2://dev/video0", "as in v4l2:///dev/video0"),
        ("folder://images", "as in folder:///tmp/images"),
        ("folder:///images?loop=1", "nothing may follow the path"),
        ("fakenect:///dump?loop=1", "nothing may follow the path"),
        ("kinect:///0", "format must be mm or raw, is missing"),
        ("kinect:///0?format=m", "format must be mm or raw, is 'm'"),
        ("kinect:///8?format=mm", "the camera's number must be within 0..7, is '8'"),
        ("kinect:///0?format=mm&rate=30", "unknown key 'rate'"),
        ("kinect://0", "as in kinect:///0?format=mm"),
    ],
)
def test_a_url_that_means_nothing_says_what_is_allowed(url: str, part: str) -> None:
    with pytest.raises(PortUrlError) as found:
        parse_url(url)
    assert repr(url) in str(found.value)
    assert part in str(found.value)


def test_a_url_of_each_kind_is_understood() -> None:
    peer = parse_url("udp://[::1]:9750")
    assert (peer.kind, peer.host, peer.port, peer.baud) == ("udp", "::1", 9750, None)
    line = parse_url("serial:///dev/pts/3?stopbits=2&baud=38400&parity=O")
    assert (line.path, line.baud, line.parity) == ("/dev/pts/3", 38400, "O")
    assert (line.bytesize, line.stopbits) == (8, 2)
    camera = parse_url("v4l2:///dev/video0?width=640&height=480&rate=30&exposure_us=2000")
    assert (camera.path, camera.size, camera.rate_hz) == ("/dev/video0", (640, 480), 30)
    assert (camera.exposure_us, camera.baud) == (2000, None)
    folder = parse_url("folder:///tmp/images")
    assert (folder.kind, folder.path) == ("folder", "/tmp/images")
    assert doctest.testmod(port_url).failed == 0


@given(st.text(max_size=30).map("serial:///dev/x?baud=9600&".__add__) | st.text(max_size=40))
def test_any_text_is_a_url_or_a_clear_error(text: str) -> None:
    with contextlib.suppress(PortUrlError):
        parse_url(text)
