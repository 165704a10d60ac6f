"""The way to a host, from the kernel's own tables: interface, network, speed. Sends nothing."""

import re
import socket
import struct
from dataclasses import dataclass
from pathlib import Path

from hw.ports.url import PortUrl
from tools.doctor.finding import Finding

ROUTES = "proc/net/route"
INTERFACES = "sys/class/net"
UP, GATEWAY = 1, 2  # flags of a route
LEAST_MTU = 1280
LEAST_MBPS = 10


@dataclass(frozen=True, slots=True)
class Route:
    """How packets to an address leave this machine."""

    interface: str
    gateway: str  # "" where the address lies in a network of this machine


def find_path(section: str, parts: PortUrl, root: Path) -> Finding | None:
    """None: not to be told, for the host has no IPv4 address or there are no tables."""
    try:
        address = socket.getaddrinfo(parts.host, None, socket.AF_INET)[0][4][0]
        table = (root / ROUTES).read_text(encoding="ascii")
    except (OSError, UnicodeError):
        return None
    return of_path(section, str(address), table, root)


def of_path(section: str, address: str, table: str, root: Path) -> Finding:
    """By the kernel's table of routes."""
    about = "network"
    if address.startswith("127."):
        return Finding("OK", about, f"{section} {address} is on this machine")
    route = maybe_route(table, address)
    if route is None:
        advice = f"Give an interface an address in the {section}'s network, such as its own plus 1"
        return Finding("warning", about, f"{section} {address}: no route", advice)
    facts, doubts = link_facts(route.interface, root)
    says = f"{section} {address} by {', '.join([route.interface, *facts])}"
    if route.gateway:
        says += f", through {route.gateway}"
        doubts.append(
            f"It is in no network of this machine: connect the {section} directly, or give "
            f"{route.interface} an address in its network"
        )
    return Finding("warning" if doubts else "OK", about, says, "; ".join(doubts))


def maybe_route(table: str, address: str) -> Route | None:
    """The most particular one; of several, that of the least metric."""
    (wanted,) = struct.unpack("=I", socket.inet_aton(address))
    best: tuple[int, int] | None = None
    route = None
    for line in table.splitlines()[1:]:
        name, to, gateway, flags, _, _, metric, mask, *_ = line.split()
        bits = int(mask, 16)
        if not int(flags, 16) & UP or wanted & bits != int(to, 16):
            continue
        rank = bits.bit_count(), -int(metric)
        if best is None or rank > best:
            through = socket.inet_ntoa(struct.pack("=I", int(gateway, 16)))
            best, route = rank, Route(name, through if int(flags, 16) & GATEWAY else "")
    return route


def link_facts(interface: str, root: Path) -> tuple[list[str], list[str]]:
    """What is known of an interface, and what is to be done about it."""
    folder = root / INTERFACES / interface
    facts, doubts = [], []
    mtu, mbps = _number(folder / "mtu"), _number(folder / "speed")
    if _number(folder / "carrier") == 0:
        facts.append("no cable")
        doubts.append("Plug in the cable; look at both ends' lights")
    if mtu is not None:
        facts.append(f"MTU {mtu}")
        if mtu < LEAST_MTU:
            doubts.append(f"Packets are small: sudo ip link set {interface} mtu 1500")
    if mbps is not None and mbps > 0:
        facts.append(f"{mbps} Mb/s")
        if mbps < LEAST_MBPS:
            doubts.append("The line is slow: another cable or port")
    if (folder / "wireless").exists():
        facts.append("wireless")
        doubts.append("Sweeps come late over the air: use a cable")
    return facts, doubts


def _number(path: Path) -> int | None:
    try:
        found = re.fullmatch(r"\s*(-?\d+)\s*", path.read_text(encoding="ascii"))
    except (OSError, UnicodeDecodeError):  # an interface that is down has no speed
        return None
    return int(found[1]) if found else None
