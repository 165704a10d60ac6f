"""Which device speaks on which port.

Looks at every serial port (and at those named on the command line, ptys too), finds the motor
controller and the attitude sensor, with --scanner HOST the laser scanner, looks which cameras there
are and what they give, and prints the lines of `mapod.toml`. --udev prints rules that give each
device a name of its own.

It listens first, and asks only what changes nothing: one carriage return and a read for the motor
controller; an MTi is stopped for a moment to say who it is, and measures again; a Hokuyo scanner
that streams, for a host that has gone, is stopped. Close mapod first: a port has one reader.
"""

import os
import re
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from fnmatch import fnmatch
from functools import partial
from glob import glob
from typing import Any

from serial.tools.list_ports_linux import comports

from hw.ax3500.lines import (
    CR,
    ENCODER_BIT,
    LEFT_OUT,
    SEVEN_BITS,
    Line,
    LineParser,
    encode_query,
    maybe_byte,
)
from hw.fingerprint import NAMES, maybe_protocol
from hw.lms1xx.telegrams import new_parser
from hw.mti.frames import Mid, MtFrame, MtParser, encode_frame
from hw.ports.v4l2 import KERNEL, Kernel, fault_of_camera, name_of
from hw.ports.wires import PortUrlError, open_port, parse_url
from hw.urg04lx.conversation import RATES
from hw.urg04lx.scip import ScipParser
from tools.cli import scanner, scip
from tools.cli.conversation import Conversation, NoAnswerError, conversation
from tools.cli.options import fail, parser_of
from tools.doctor.wires import group_name
from tools.terminal.progress import advancing

LIST_PORTS: Any = comports  # pyserial has no types
AX3500_URL = "serial://{path}?baud=9600&parity=E&bytesize=7"
LINE_URL = "serial://{path}?baud={baud}"
SCANNER_PORTS = ("2112", "2111", scip.PORT)
MTI_BAUDS = (115_200, 921_600, 460_800, 230_400, 57_600, 38_400, 19_200, 9_600)
HOKUYO, STRIPE = scanner.HOKUYO, "stripe"
ROBOTS = {HOKUYO: "urg04lx", STRIPE: "ragno"}  # that have such a scanner
CAMERAS = "/dev/video*"
CAMERA_URL = "v4l2://{path}?width=640&height=480&rate=30"
LOGGED = re.compile(rb"(?::[0-9A-F]{24,32}\r){2}")  # in R/C and analog mode; one may be chance
LISTEN_LINE_S = 0.9  # a logging line takes up to 0.27 s: two of them, behind a part of one
LISTEN_DATA_S = 0.12  # ten samples a second at least
ANSWER_S = 0.3
NO_PORTS = (
    "this machine lists no serial port and no camera: plug the adapters in, or name a port; "
    "a scanner is asked with --scanner HOST"
)


@dataclass(frozen=True, slots=True)
class Found:
    """What a port, or a scanner's host, turned out to be."""

    place: str  # path or host
    section: str  # of mapod.toml; "" if none
    url: str
    says: str  # in words
    dialect: str = ""  # of a laser scanner
    driver: str = ""  # where it is not that of the shipped settings


def paths_of(named: list[str], adapters: Mapping[str, Any]) -> list[str]:
    return named or [
        path
        for path in sorted(adapters)
        if adapters[path].vid is not None or not path.startswith("/dev/ttyS")
    ]


def find(path: str) -> Found:
    """What speaks there; the slow line first, for its listening disturbs nobody."""
    heard = bytearray()
    try:
        for probe in (_maybe_controller, _maybe_attitude_sensor, _maybe_scanner):
            found = probe(path, heard)
            if found is not None:
                return found
    except NoAnswerError as error:
        return Found(path, "", "", str(error))
    protocol = maybe_protocol(bytes(heard))
    if protocol is not None:
        return Found(path, "", "", f"none of mapod's: it seems to be {NAMES[protocol]}")
    return Found(path, "", "", f"{len(heard)} bytes of no known protocol" if heard else "silent")


def _maybe_controller(path: str, heard: bytearray) -> Found | None:
    url = AX3500_URL.format(path=path)
    with conversation(url, LineParser()) as talk:
        try:
            for _ in talk.hear(LISTEN_LINE_S):
                pass
            if LOGGED.search(talk.heard.translate(SEVEN_BITS, LEFT_OUT)):
                return Found(path, "drive", url, "motor controller in R/C or analog mode")
            query = "^8A"
            talk.say(CR)
            for _ in range(2):
                talk.say(encode_query(query))
                texts = [event.text for event in talk.hear(ANSWER_S) if isinstance(event, Line)]
                if query in texts:
                    return Found(path, "drive", url, _controller_in_words(texts, query))
            return None
        finally:
            heard += talk.heard


def _controller_in_words(texts: list[str], query: str) -> str:
    for text in texts[texts.index(query) + 1 :]:
        identity = maybe_byte(text)
        if identity is not None:
            encoder = "with" if identity & ENCODER_BIT else "WITHOUT"
            return f"motor controller in RS-232 mode, identity {text}, {encoder} encoder module"
    return "motor controller in RS-232 mode"


def _maybe_attitude_sensor(path: str, heard: bytearray) -> Found | None:
    for baud in MTI_BAUDS:
        url = LINE_URL.format(path=path, baud=baud)
        with conversation(url, MtParser(baud)) as talk:
            streams = any(isinstance(event, MtFrame) for event in talk.hear(LISTEN_DATA_S))
            asked = _maybe_answer(talk, Mid.GoToConfig, tries=2) is not None
            heard += talk.heard if baud == MTI_BAUDS[0] else b""
            if asked:
                says = _sensor_in_words(talk)
                talk.ask(encode_frame(Mid.GoToMeasurement), lambda event: True, ANSWER_S)
                return Found(path, "ahrs", url, f"{says} at {baud} baud")
            if streams:
                says = "attitude sensor that does not hear us: check the line to its receiver"
                return Found(path, "ahrs", url, f"{says}, {baud} baud")
    return None


def _maybe_scanner(path: str, heard: bytearray) -> Found | None:
    """A Hokuyo scanner; by USB it answers at any rate."""
    for baud in RATES:
        url = LINE_URL.format(path=path, baud=baud)
        with conversation(url, ScipParser()) as talk:
            try:
                scip.greet(talk)
                says = f"laser scanner that {', '.join(scip.told(talk, scip.WHO))} at {baud} baud"
                return Found(path, "scanner", url, says, driver=HOKUYO)
            except NoAnswerError:
                continue
    return None


def _maybe_answer(talk: Conversation, mid: Mid, tries: int = 3) -> bytes | None:
    try:
        frame: MtFrame = talk.ask(
            encode_frame(mid), lambda event: event.mid == mid + 1, ANSWER_S, tries
        )
    except NoAnswerError:
        return None
    return frame.data


def _sensor_in_words(talk: Conversation) -> str:
    product, number = _maybe_answer(talk, Mid.ReqProductCode), _maybe_answer(talk, Mid.ReqDID)
    words = ["attitude sensor"]
    words += [] if product is None else [product.decode("ascii", "replace").strip()]
    return " ".join(words if number is None else [*words, number.hex()])


def find_scanner(host: str) -> Found:
    """A laser scanner at HOST or HOST:PORT, whichever of its ports and dialects answers."""
    name, _, port = host.partition(":")
    says = ""
    tries = [(number, number == scip.PORT) for number in SCANNER_PORTS]
    for number, is_scip in [(port, True), (port, False)] if port else tries:
        url = f"tcp://{name}:{number}"
        heard = bytearray()
        try:
            parser = ScipParser() if is_scip else new_parser("auto")
            with conversation(url, parser) as talk:
                heard = talk.heard
                if is_scip:
                    scip.greet(talk)
                    words = f"laser scanner that {', '.join(scip.told(talk, scip.WHO))}"
                    return Found(host, "scanner", url, words, driver=HOKUYO)
                dialect = scanner.dialect_of(talk)
                told = scanner.told(scanner.Scanner(talk, dialect), scanner.WHO)
                words = f"laser scanner that {', '.join(told)}"
                return Found(host, "scanner", url, words, dialect)
        except NoAnswerError as error:
            protocol = maybe_protocol(bytes(heard))
            says = str(error) + (f"; it seems to be {NAMES[protocol]}" if protocol else "")
    return Found(host, "", "", says)


def find_camera(path: str, kernel: Kernel = KERNEL) -> Found:
    """What a camera of this machine gives; it is not made to stream."""
    try:
        fd = kernel.open(path)
        try:
            why = fault_of_camera(kernel, fd)
            says = why or f"camera {name_of(kernel, fd)!r} with MJPEG"
        finally:
            kernel.close(fd)
    except PermissionError:
        group = group_name(os.stat(path).st_gid)
        return Found(
            path, "", "", f"no permission for it: join its group, {group}, and log in anew"
        )
    except OSError as error:
        return Found(path, "", "", str(error.strerror))
    if why:
        return Found(path, "", "", why)
    return Found(path, "scanner", CAMERA_URL.format(path=path), says, driver=STRIPE)


def toml_lines(found: list[Found]) -> Iterator[str]:
    for one in found:
        if one.section:
            yield f"[{one.section}]"
            if one.driver:
                robot = ROBOTS[one.driver]
                yield f'driver = "{one.driver}"  # its other keys: mapod init --robot {robot}'
            yield f'port = "{one.url}"'
        if one.dialect:
            yield f'dialect = "{one.dialect}"'


def udev_rules(found: list[Found], adapters: Mapping[str, Any]) -> Iterator[str]:
    """A name of its own for each device, by USB serial number, or by its socket without one.

    Args:
        adapters: what the machine knows of its ports, by path (pyserial's ListPortInfo).
    """
    names = {"drive": "ax3500", "ahrs": "mti", "scanner": "urg"}
    for one in found:
        name, adapter = names.get(one.section), adapters.get(one.place)
        if name is None or not one.url.startswith("serial:"):
            continue
        if adapter is not None and adapter.serial_number:
            known_by = (
                f'ATTRS{{idVendor}}=="{adapter.vid or 0:04x}", '
                f'ATTRS{{idProduct}}=="{adapter.pid or 0:04x}", '
                f'ATTRS{{serial}}=="{adapter.serial_number}"'
            )
        elif adapter is not None and adapter.location:
            known_by = f'KERNELS=="{adapter.location}"'
        else:
            yield f"# {one.place}: neither a USB serial number nor a socket to know it by"
            continue
        yield f'SUBSYSTEM=="tty", {known_by}, SYMLINK+="{name}"'


def all_found(paths: list[str], hosts: list[str]) -> list[Found]:
    jobs = [partial(find, path) for path in paths] + [partial(find_scanner, host) for host in hosts]
    with ThreadPoolExecutor(max_workers=max(1, len(jobs))) as together:
        asked = [together.submit(job) for job in jobs]
        with advancing("asking", len(asked)) as advance:
            for count, _ in enumerate(as_completed(asked), 1):
                advance(count, "")
    return [one.result() for one in asked]


def main(arguments: list[str] | None = None) -> int:
    """Exit status: 0 something was found, 1 nothing was, 2 wrong use."""
    parser = parser_of("devices", __doc__, "mapod devices --scanner 192.168.0.1 --udev")
    add = parser.add_argument
    add("paths", nargs="*", help="serial ports and cameras to look at (default: all)")
    add("--scanner", action="append", default=[], metavar="HOST[:PORT]", help="a scanner to ask")
    add("--udev", action="store_true", help="print udev rules as well")
    options = parser.parse_args(arguments)
    adapters = {port.device: port for port in LIST_PORTS()}
    cameras = [path for path in options.paths if fnmatch(path, CAMERAS)]
    lines = [path for path in options.paths if path not in cameras]
    if not options.paths:
        cameras = sorted(glob(CAMERAS))
    paths = paths_of(lines, adapters) if lines or not options.paths else []
    try:
        for path in paths:
            parse_url(LINE_URL.format(path=path, baud=MTI_BAUDS[0]))
        for host in options.scanner:  # its name is looked up, nothing is opened
            open_port(f"tcp://{host}" if ":" in host else f"tcp://{host}:{SCANNER_PORTS[0]}")
        if not paths and not cameras and not options.scanner:
            return fail("devices", NO_PORTS, 1)
        found = [*all_found(paths, options.scanner), *map(find_camera, cameras)]
    except PortUrlError as error:
        return fail("devices", error)
    for one in found:
        about = getattr(adapters.get(one.place), "description", "")
        print(f"# {one.place}: {one.says}{f' ({about})' if about else ''}")
    for text in toml_lines(found):
        print(text)
    if options.udev:
        print("\n# /etc/udev/rules.d/98-my-robot.rules")
        for text in udev_rules(found, adapters):
            print(text)
    if any(one.section for one in found):
        return 0
    return fail("devices", f"none of mapod's devices on {len(found)} ports; see above", 1)
