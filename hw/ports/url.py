"""The grammar of port URLs, pure text: checked before any port opens."""

import re
from dataclasses import dataclass
from typing import Literal
from urllib.parse import parse_qsl, urlsplit

ALLOWED = (
    "allowed are tcp://host:port, udp://host:port and "
    "serial:///path?baud=9600&parity=N|E|O&bytesize=7|8&stopbits=1|2"
)
BAUDS = range(50, 4_000_001)
LINE_VALUES = {"parity": ("N", "E", "O"), "bytesize": ("8", "7"), "stopbits": ("1", "2")}
DEFAULTS = {key: values[0] for key, values in LINE_VALUES.items()}


class PortUrlError(Exception):
    """A port URL that can't be used; the text says what was given and what is allowed."""


@dataclass(frozen=True, slots=True)
class PortUrl:
    """What a URL says: host and port of tcp and udp, the rest of serial."""

    kind: Literal["tcp", "udp", "serial"]
    host: str = ""
    port: int = 0
    path: str = ""
    baud: int | None = None  # None: the wire has no such thing
    parity: str = "N"
    bytesize: int = 8
    stopbits: int = 1


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
            return _parse_serial(url, parts.netloc, parts.path, parts.query)
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


def _parse_serial(url: str, netloc: str, path: str, query: str) -> PortUrl:
    if netloc or len(path) < 2:
        raise PortUrlError(
            f"{url!r}: three slashes and a path must follow 'serial:', as in serial:///dev/ttyS0"
        )
    try:
        pairs = parse_qsl(query, keep_blank_values=True, strict_parsing=bool(query))
    except ValueError:
        raise PortUrlError(f"{url!r}: {query!r} is not key=value&key=value; {ALLOWED}") from None
    given = dict(pairs)
    if len(given) < len(pairs):
        raise PortUrlError(f"{url!r}: each key may be given once")
    if unknown := sorted(given.keys() - {"baud", *LINE_VALUES}):
        raise PortUrlError(f"{url!r}: unknown key {unknown[0]!r}; {ALLOWED}")
    baud = given.pop("baud", "")
    if not (re.fullmatch(r"\d{1,7}", baud, re.ASCII) and int(baud) in BAUDS):
        is_given = f"is {baud!r}" if baud else "is missing"
        raise PortUrlError(f"{url!r}: baud must be within {BAUDS[0]}..{BAUDS[-1]}, {is_given}")
    for key, value in given.items():
        if value not in LINE_VALUES[key]:
            allowed = " or ".join(LINE_VALUES[key])
            raise PortUrlError(f"{url!r}: {key} must be {allowed}, is {value!r}")
    line = DEFAULTS | given
    return PortUrl(
        "serial",
        path=path,
        baud=int(baud),
        parity=line["parity"],
        bytesize=int(line["bytesize"]),
        stopbits=int(line["stopbits"]),
    )
