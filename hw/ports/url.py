"""The grammar of port URLs, pure text: checked before any port opens."""

import re
from dataclasses import dataclass
from typing import Literal
from urllib.parse import SplitResult, parse_qsl, urlsplit

ALLOWED = (
    "allowed are tcp://host:port, udp://host:port, "
    "serial:///path?baud=9600&parity=N|E|O&bytesize=7|8&stopbits=1|2, and for a camera "
    "v4l2:///path?width=640&height=480&rate=30&exposure_us=2000 and folder:///path, and for a "
    "Kinect kinect:///NUMBER?format=mm|raw and fakenect:///path"
)
EXAMPLES = {
    "serial": "serial:///dev/ttyS0",
    "v4l2": "v4l2:///dev/video0",
    "folder": "folder:///tmp/images",
    "kinect": "kinect:///0?format=mm",
    "fakenect": "fakenect:///tmp/dump",
}
BAUDS = range(50, 4_000_001)
LINE_VALUES = {"parity": ("N", "E", "O"), "bytesize": ("8", "7"), "stopbits": ("1", "2")}
CAMERA_VALUES = {"width": range(32, 4097), "height": range(32, 4097), "rate": range(1, 121)}
EXPOSURES_US = range(100, 1_000_001)
KINECTS, FORMATS = range(8), ("mm", "raw")
CAMERAS = ("v4l2", "folder", "kinect", "fakenect")  # kinds that carry images alone
DEFAULTS = {key: values[0] for key, values in LINE_VALUES.items()}


class PortUrlError(Exception):
    """A port URL that can't be used; the text says what was given and what is allowed."""


@dataclass(frozen=True, slots=True)
class PortUrl:
    """What a URL says: host and port of tcp and udp, then what is serial's, then a camera's."""

    kind: Literal["tcp", "udp", "serial", "v4l2", "folder", "kinect", "fakenect"]
    host: str = ""
    port: int = 0
    path: str = ""
    baud: int | None = None  # None: the wire has no such thing
    parity: str = "N"
    bytesize: int = 8
    stopbits: int = 1
    size: tuple[int, int] = (0, 0)  # width and height of its images
    rate_hz: int = 0
    exposure_us: int | None = None  # None: as the camera likes
    number: int = 0  # of a Kinect
    is_raw: bool = False  # its depths are raw values, not millimetres


def parse_url(url: str) -> PortUrl:
    """The parts of a port URL.

    >>> url = parse_url("tcp://192.168.0.1:2112")
    >>> url.kind, url.host, url.port
    ('tcp', '192.168.0.1', 2112)
    >>> url = parse_url("serial:///dev/ax3500?baud=9600&parity=E&bytesize=7")
    >>> url.path, url.baud, url.bytesize, url.parity, url.stopbits
    ('/dev/ax3500', 9600, 7, 'E', 1)

    Raises:
        PortUrlError: no such kind of port, or a part missing, unknown or out of range.
    """
    try:
        parts = urlsplit(url)
    except ValueError as error:
        raise PortUrlError(f"{url!r}: {error}; {ALLOWED}") from None
    if re.search(r"[\s\x00-\x1f#]", url):
        raise PortUrlError(f"{url!r}: no space, control character or '#' may be in it; {ALLOWED}")
    match parts.scheme:
        case "tcp" | "udp" as kind:
            return _parse_socket(url, kind)
        case "serial":
            return _parse_serial(url, _path(url, parts), _given(url, parts.query))
        case "v4l2":
            return _parse_camera(url, _path(url, parts), _given(url, parts.query))
        case "folder" | "fakenect" as kind:
            if parts.query:
                raise PortUrlError(f"{url!r}: nothing may follow the path; {ALLOWED}")
            return PortUrl(kind, path=_path(url, parts), is_raw=kind == "fakenect")
        case "kinect":
            return _parse_kinect(url, _path(url, parts), _given(url, parts.query))
        case scheme:
            raise PortUrlError(f"{url!r}: no such kind of port {scheme!r}; {ALLOWED}")


def _parse_socket(url: str, kind: Literal["tcp", "udp"]) -> PortUrl:
    found = re.fullmatch(r"\w+://(\[[0-9A-Fa-f:.%]+\]|[^\[\]:/?@]+):(\d{1,5})", url, re.ASCII)
    if found is None:
        raise PortUrlError(f"{url!r}: must be {kind}://host:port")
    host, port = found[1].strip("[]"), int(found[2])
    if not 1 <= port <= 65535:
        raise PortUrlError(f"{url!r}: the port must be within 1..65535, is {port}")
    return PortUrl(kind, host=host, port=port)


def _path(url: str, parts: SplitResult) -> str:
    if parts.netloc or len(parts.path) < 2:
        raise PortUrlError(
            f"{url!r}: three slashes and a path must follow '{parts.scheme}:', as in "
            f"{EXAMPLES[parts.scheme]}"
        )
    return parts.path


def _given(url: str, query: str) -> dict[str, str]:
    """By key."""
    try:
        pairs = parse_qsl(query, keep_blank_values=True, strict_parsing=bool(query))
    except ValueError:
        raise PortUrlError(f"{url!r}: {query!r} is not key=value&key=value; {ALLOWED}") from None
    given = dict(pairs)
    if len(given) < len(pairs):
        raise PortUrlError(f"{url!r}: each key may be given once")
    return given


def _number(url: str, given: dict[str, str], key: str, allowed: range) -> int:
    """Takes it from what is given."""
    text = given.pop(key, "")
    if re.fullmatch(r"\d{1,7}", text, re.ASCII) and int(text) in allowed:
        return int(text)
    is_given = f"is {text!r}" if text else "is missing"
    raise PortUrlError(f"{url!r}: {key} must be within {allowed[0]}..{allowed[-1]}, {is_given}")


def _parse_serial(url: str, path: str, given: dict[str, str]) -> PortUrl:
    if unknown := sorted(given.keys() - {"baud", *LINE_VALUES}):
        raise PortUrlError(f"{url!r}: unknown key {unknown[0]!r}; {ALLOWED}")
    baud = _number(url, given, "baud", BAUDS)
    for key, value in given.items():
        if value not in LINE_VALUES[key]:
            allowed = " or ".join(LINE_VALUES[key])
            raise PortUrlError(f"{url!r}: {key} must be {allowed}, is {value!r}")
    line = DEFAULTS | given
    return PortUrl(
        "serial",
        path=path,
        baud=baud,
        parity=line["parity"],
        bytesize=int(line["bytesize"]),
        stopbits=int(line["stopbits"]),
    )


def _parse_camera(url: str, path: str, given: dict[str, str]) -> PortUrl:
    if unknown := sorted(given.keys() - {"exposure_us", *CAMERA_VALUES}):
        raise PortUrlError(f"{url!r}: unknown key {unknown[0]!r}; {ALLOWED}")
    is_set = "exposure_us" in given
    exposure_us = _number(url, given, "exposure_us", EXPOSURES_US) if is_set else None
    width, height, rate_hz = (_number(url, given, key, CAMERA_VALUES[key]) for key in CAMERA_VALUES)
    return PortUrl(
        "v4l2", path=path, size=(width, height), rate_hz=rate_hz, exposure_us=exposure_us
    )


def _parse_kinect(url: str, path: str, given: dict[str, str]) -> PortUrl:
    if unknown := sorted(given.keys() - {"format"}):
        raise PortUrlError(f"{url!r}: unknown key {unknown[0]!r}; {ALLOWED}")
    if not re.fullmatch(r"/[0-7]", path, re.ASCII):
        allowed = f"{KINECTS[0]}..{KINECTS[-1]}"
        raise PortUrlError(
            f"{url!r}: the camera's number must be within {allowed}, is {path[1:]!r}"
        )
    form = given.get("format", "")
    if form not in FORMATS:
        is_given = f"is {form!r}" if form else "is missing"
        raise PortUrlError(f"{url!r}: format must be {' or '.join(FORMATS)}, {is_given}")
    return PortUrl("kinect", path=path, number=int(path[1:]), is_raw=form == "raw")
