"""The ports of the settings: is the serial line there and permitted, does the host answer.

No byte is sent. A TCP connection is opened and closed, to devices only.
"""

import ctypes
import grp
import os
import socket
import stat
import time
from collections.abc import Iterator
from pathlib import Path

from core.config import Config
from core.driving.control import links_refusal
from hw.ports.folder import images_of
from hw.ports.kinect import INDEX, LIBRARY
from hw.ports.url import PortUrl, parse_url
from hw.ports.v4l2 import KERNEL, Kernel, fault_of_camera
from tools.doctor.finding import Finding
from tools.doctor.network import find_path

ANSWER_S = 1.0  # that a host has for its answer
SLOW_ANSWER_S = 0.05  # of a host in the same network
LATENCY_MS = 1  # of an adapter that does not hold bytes back


def find_wires(config: Config, root: Path) -> Iterator[Finding]:
    """Each port of devices and planners; Modbus listens itself, which only a start can try."""
    for section in ("scanner", "ahrs"):
        yield from _of_port(section, getattr(config, section).port, root)
    if config.drive.port:
        yield from _of_port("drive", config.drive.port, root)
    else:
        yield Finding("OK", "drive", "there is none: nothing commands motors")
    if config.depth is not None and config.has_camera:
        yield from _of_port("depth", config.depth.port, root)
    yield from of_place(config)
    for url in config.planner.ports:
        yield from _of_port("planner", url, root)
    for url in config.modbus.ports:
        if url.startswith("serial:"):
            yield from _of_port("modbus", url, root)


def of_place(config: Config) -> Iterator[Finding]:
    """Whether somebody can tell the place, where no wheels do."""
    if config.motion.source != "external":
        return
    if refusal := links_refusal(config.planner.ports, bool(config.planner.key_file)):
        advice = "Set [planner] key_file, or a port of this machine or a serial line"
        yield Finding("fault", "motion", f"no pose is taken on any port: {refusal}", advice)
        return
    says = "the place comes as EXTERNAL_POSE frames, over a planner's port"
    yield Finding("OK", "motion", f"{says}; mapod has no map until they come")


def _of_port(section: str, url: str, root: Path) -> Iterator[Finding]:
    parts = parse_url(url)
    if parts.kind == "serial":
        yield of_line(section, parts.path)
        yield from latency_of(section, parts.path, root)
    elif parts.kind == "v4l2":
        yield of_camera(section, parts.path, KERNEL)
    elif parts.kind == "folder":
        yield of_folder(section, parts.path)
    elif parts.kind in ("kinect", "fakenect"):
        yield of_kinect(section, parts)
    else:
        yield of_host(section, parts)
        if section == "scanner" and (path := find_path(section, parts, root)):
            yield path


def of_line(section: str, path: str, what: str = "serial line") -> Finding:
    """Whether a serial line, or what else is meant, is there and may be opened by who asks."""
    try:
        found = os.stat(path)
    except OSError as error:
        advice = f"Plug it in; `mapod devices` says what is where, for [{section}] port"
        return Finding("warning", section, f"{path}: {error.strerror}", advice)
    if not stat.S_ISCHR(found.st_mode):
        advice = f"`mapod devices` says what is where, for [{section}] port"
        return Finding("warning", section, f"{path} is no {what}", advice)
    if not os.access(path, os.R_OK | os.W_OK):
        group = group_name(found.st_gid)
        advice = f"sudo usermod --append --groups {group} {os.environ.get('USER', 'USER')}"
        says = f"{path}: no permission to read and write, its group is {group}"
        return Finding("warning", section, says, f"{advice}; then log in anew")
    return Finding("OK", section, f"{path} is there")


def of_camera(section: str, path: str, kernel: Kernel) -> Finding:
    """Whether a camera is there, may be opened, and gives images that are of use."""
    found = of_line(section, path, "camera")
    if found.level != "OK":
        return found
    try:
        fd = kernel.open(path)
        try:
            why = fault_of_camera(kernel, fd)
        finally:
            kernel.close(fd)
    except OSError as error:
        why = f"can't be asked: {error.strerror}"
    if why:
        advice = "`mapod devices` tells what each camera gives"
        return Finding("warning", section, f"{path} {why}", advice)
    return Finding("OK", section, f"{path} is a camera with MJPEG")


def of_folder(section: str, path: str) -> Finding:
    """Whether images are there to be played."""
    try:
        images = images_of(Path(path))
    except (OSError, ValueError) as error:
        advice = "docs/devices.md tells what such a folder has"
        return Finding("warning", section, f"{path}: {error}", advice)
    says = f"{path} has {len(images)} images over {images[-1][0]:.1f} s; no camera is read"
    return Finding("OK", section, says)


def of_kinect(section: str, parts: PortUrl) -> Finding:
    """Whether the library is there that reads one, and a dump if one is to be played."""
    try:
        ctypes.CDLL(LIBRARY)
    except OSError as error:
        return Finding("fault", section, f"libfreenect: {error}", "apt install libfreenect0.5")
    if parts.kind == "fakenect" and not (Path(parts.path) / INDEX).is_file():
        advice = "docs/protocols/kinect.md tells what a dump has"
        return Finding("warning", section, f"{parts.path} has no {INDEX}", advice)
    what = f"the dump {parts.path}" if parts.kind == "fakenect" else f"Kinect {parts.number}"
    return Finding("OK", section, f"{LIBRARY} is there; only a start opens {what}")


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
        began_s = time.monotonic()
        try:
            one.connect(address)  # over UDP it sends nothing: it only asks for the way
        except OSError as error:
            why = "no answer" if isinstance(error, TimeoutError) else error.strerror
            return Finding("warning", section, f"{where}: {why}", advice)
        took_s = time.monotonic() - began_s
    if parts.kind != "tcp":
        return Finding("OK", section, f"{where} has a way")
    return of_answer(section, where, took_s)


def of_answer(section: str, where: str, took_s: float) -> Finding:
    """How long a connection took: there and back."""
    says = f"{where} answers in {1000 * took_s:.1f} ms"
    if took_s > SLOW_ANSWER_S:
        advice = "The way is slow: a cable of its own, no switch under load between"
        return Finding("warning", section, says, advice)
    return Finding("OK", section, says)
