"""The ports of the settings: is the serial line there and permitted, does the host answer.

No byte is sent. A TCP connection is opened and closed, to devices only.
"""

import grp
import os
import socket
import stat
from collections.abc import Iterator
from pathlib import Path

from core.config import Config
from hw.ports.url import PortUrl, parse_url
from tools.doctor.finding import Finding

ANSWER_S = 1.0  # that a host has for its answer
LATENCY_MS = 1  # of an adapter that does not hold bytes back


def find_wires(config: Config, root: Path) -> Iterator[Finding]:
    """Each port of devices and planners; Modbus listens itself, which only a start can try."""
    for section in ("scanner", "ahrs", "drive"):
        yield from _of_port(section, getattr(config, section).port, root)
    for url in config.planner.ports:
        yield from _of_port("planner", url, root)
    for url in config.modbus.ports:
        if url.startswith("serial:"):
            yield from _of_port("modbus", url, root)


def _of_port(section: str, url: str, root: Path) -> Iterator[Finding]:
    parts = parse_url(url)
    if parts.kind == "serial":
        yield of_line(section, parts.path)
        yield from latency_of(section, parts.path, root)
    else:
        yield of_host(section, parts)


def of_line(section: str, path: str) -> Finding:
    """Whether a serial line is there, and may be opened by who asks."""
    try:
        found = os.stat(path)
    except OSError as error:
        advice = f"Plug it in; `mapod devices` says what is where, for [{section}] port"
        return Finding("warning", section, f"{path}: {error.strerror}", advice)
    if not stat.S_ISCHR(found.st_mode):
        advice = f"`mapod devices` says what is where, for [{section}] port"
        return Finding("warning", section, f"{path} is no serial line", advice)
    if not os.access(path, os.R_OK | os.W_OK):
        group = group_name(found.st_gid)
        advice = f"sudo usermod --append --groups {group} {os.environ.get('USER', 'USER')}"
        says = f"{path}: no permission to read and write, its group is {group}"
        return Finding("warning", section, says, f"{advice}; then log in anew")
    return Finding("OK", section, f"{path} is there")


def group_name(number: int) -> str:
    try:
        return grp.getgrgid(number).gr_name
    except KeyError:
        return str(number)


def latency_of(section: str, path: str, root: Path) -> Iterator[Finding]:
    """How long a USB adapter holds bytes back, where it tells."""
    name = os.path.basename(os.path.realpath(path))
    timer = root / "sys/bus/usb-serial/devices" / name / "latency_timer"
    try:
        held_ms = int(timer.read_text(encoding="ascii"))
    except (OSError, ValueError):
        return
    if held_ms > LATENCY_MS:
        advice = "Install the udev rules of tools/flash/99-mapod.rules, and plug it in anew"
        says = f"the adapter of {path} holds bytes back for {held_ms} ms"
        yield Finding("warning", section, says, advice)


def of_host(section: str, parts: PortUrl) -> Finding:
    """Whether a host has an address and a way to it; over TCP, whether it answers."""
    where = f"{parts.kind}://{parts.host}:{parts.port}"
    kind = socket.SOCK_STREAM if parts.kind == "tcp" else socket.SOCK_DGRAM
    advice = f"Check the network, the device's power and [{section}] port"
    try:
        family, _, _, _, address = socket.getaddrinfo(parts.host, parts.port, type=kind)[0]
    except (OSError, UnicodeError):
        return Finding("fault", section, f"{where}: the host has no known address", advice)
    with socket.socket(family, kind) as one:
        one.settimeout(ANSWER_S)
        try:
            one.connect(address)  # over UDP it sends nothing: it only asks for the way
        except OSError as error:
            why = "no answer" if isinstance(error, TimeoutError) else error.strerror
            return Finding("warning", section, f"{where}: {why}", advice)
    return Finding("OK", section, f"{where} {'answers' if parts.kind == 'tcp' else 'has a way'}")
