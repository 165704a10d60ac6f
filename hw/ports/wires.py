"""Wires by URL: TCP, UDP and serial lines that open, lose and reopen without ever waiting.

    tcp://host:port    udp://host:port    serial:///path?baud=9600&parity=E&bytesize=7&stopbits=1

For a camera on this machine, and for images of one, in the form of a web camera's answer:

    v4l2:///dev/video0?width=640&height=480&rate=30&exposure_us=2000    folder:///path
    kinect:///0?format=mm    fakenect:///path

A host's name is looked up once, in open_port, before the loop runs; nothing after it waits.
Time is what poll() is told. Source: Modbus sheet, section 6, for serial lines and ptys.

When it is tried again. What costs nobody anything is tried often, so that a device is found soon
after it is back; what a device has to bear, or can't become better soon, is tried ever less often.
  - A host that does not answer is asked anew every CONNECT_S, without end: one small packet each,
    while the kernel would wait 1, 2, 4 s between its own. One that needs longer to answer is too
    far away to keep a map fresh.
  - A host that refuses is there, its service not yet: after 0.2, 0.4, then each CHEAP_LAST_S. So
    with what the kernel knows without asking: that no way leads there.
  - A serial path that is not there is looked at, not opened, every RETRY_FIRST_S; as soon as it is
    there, or another than the one that failed (new device node, new owner), it is opened.
  - A connection dropped because nothing was heard on it is renewed at once: it was long enough.
  - Whatever opens and brings nothing, or fails otherwise: after 0.2, 0.4, .. RETRY_LAST_S.
"""

import socket
from collections.abc import Callable
from dataclasses import replace

from hw.device import Port
from hw.ports.serial import SerialPort
from hw.ports.sockets import Address, TcpPort, UdpPort
from hw.ports.url import PortUrl, PortUrlError, parse_url

__all__ = ["PortUrlError", "open_port", "parse_url", "ports_beside"]


def open_port(url: str) -> Port:
    """The port of a URL, not opened yet: polling does that.

    Raises:
        PortUrlError: no such kind of port, a part missing or out of range, a host without address.
    """
    parts = parse_url(url)
    match parts.kind:
        case "serial":
            return SerialPort(parts)
        case "v4l2":
            from hw.ports.camera import CameraPort  # as for folders: for who has one

            return CameraPort(parts)
        case "folder":
            from hw.ports.folder import FolderPort

            return FolderPort(parts)
        case "kinect" | "fakenect":
            from hw.ports.kinect import KinectPort

            return KinectPort(parts)
        case "tcp":
            return TcpPort(parts, _address(url, parts))
        case "udp":
            return UdpPort(parts, _address(url, parts))


def ports_beside(url: str) -> Callable[[int], Port]:
    """Gives TCP ports of a URL's host by their numbers, not opened yet.

    Its name is looked up now: so a device may tell a port while the loop runs.

    Raises:
        PortUrlError: no URL of TCP, or a host without address.
    """
    parts = parse_url(url)
    if parts.kind != "tcp":
        raise PortUrlError(f"{url!r}: must be tcp://host:port")
    family, (host, _, *rest) = _address(url, parts)
    return lambda number: TcpPort(replace(parts, port=number), (family, (host, number, *rest)))


def _address(url: str, peer: PortUrl) -> tuple[int, Address]:
    """Family and address; only a name that is no number is looked up."""
    kind = socket.SOCK_STREAM if peer.kind == "tcp" else socket.SOCK_DGRAM
    try:
        try:
            found = socket.getaddrinfo(peer.host, peer.port, type=kind, flags=socket.AI_NUMERICHOST)
        except socket.gaierror:
            found = socket.getaddrinfo(peer.host, peer.port, type=kind)
    except (OSError, UnicodeError):
        raise PortUrlError(f"{url!r}: the host {peer.host!r} has no known address") from None
    family, _, _, _, address = found[0]
    return family, address
