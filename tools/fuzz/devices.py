"""Devices as targets of the fuzzer: the codec of each with its session.

An input is a little program of what a device does: bytes as they are, payloads that get a right
frame around them (so that no checksum keeps the fuzzer out), and time that passes. No input may
raise, hang, or make the device hold more than MOST_HELD. The camera's images need OpenCV.
"""

import dataclasses
import math
import pickle
import struct
import zlib
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from tools.fuzz.program import instruction

ROOT = Path(__file__).resolve().parents[2]
CODECS = ("lms111", "mti", "ax3500", "urg04lx", "stripe", "visionary", "kinect", "folder")
NEEDS = {"stripe": "cv2"}  # a module that mapod itself does without
RAW, FRAMED, TIME, CUT = range(4)  # what an instruction does, by the low 2 bits of its first byte
SECOND = 4  # this bit beside RAW or FRAMED: on the device's second port, where it has one
STEP_S = 0.005
MOST_STEPS = 400  # of one input
MOST_HELD = 200_000  # bytes of a parser and its session's stream, pickled
KINECT_BYTES = 2 * 640 * 480  # of its frames: two of them may wait beside that
SEED_S = 2.0  # of a healthy conversation, as a seed of the corpus
MOST_INPUT = 8192
LENS_PX = ("focal_px", "centre_px")
IMAGE_PX, QUALITY = (64, 48), 60  # of the camera: some images fit into an input
LINE_PX, LASER = 33.0, 10.0  # on its sensor of 640 x 480 px: seen in the small image, too
HALVINGS, LENS = b"\x05", ((16, 12), (14.5, 14.5), (7.5, 5.5))  # of depth cameras: few pixels


def frame_of(codec: str, payload: bytes, now_s: float) -> bytes:
    """A right frame around a payload: CoLa by its first bit, MT with its id in front, a line.

    Of SCIP, its lines with their sums: an echo, which has none, a status and data. Of the camera,
    the head of its answer, or a part that is as long as it says. Of depth cameras, a command, or a
    part: of a folder an image, a Kinect's as long as its frames are.
    """
    from fakes.kinect import device as kinect
    from fakes.lms1xx import cola
    from fakes.mti import frames as mt
    from fakes.stripe import http
    from fakes.urg04lx import scip

    match codec:
        case "lms111" if payload[:1] >= b"\x80":
            return b"\x02" + payload[1:] + b"\x03"
        case "lms111":
            return cola.frame(payload)
        case "mti":
            return mt.frame(payload[0] if payload else 0x32, payload[1:2049])
        case "urg04lx":
            echo, *lines = payload.split(b"\n")
            return b"\n".join([echo, *(line + scip.check_sum(line) for line in lines)]) + b"\n\n"
        case "stripe" if not payload:
            return http.head()
        case "stripe":
            return http.part(payload, None, True)
        case "kinect":
            data = (payload * (KINECT_BYTES // max(1, len(payload)) + 1))[:KINECT_BYTES]
            kind = "depth/mm" if payload[:1] >= b"\x80" else "depth/raw-11"
            return kinect.part(data, kind, now_s, None)
        case "folder" if payload[:1] == b"s":
            return kinect.part(payload, "application/toml", None, None)
        case "folder":
            return kinect.part(
                payload if payload[:1] == b"\x89" else png_of(payload), "", now_s, None
            )
        case "visionary":
            return b"\x02" * 4 + (8 + len(payload)).to_bytes(4, "big") + bytes(8) + payload
        case _:
            return payload.translate(None, b"\r") + b"\r"


def png_of(payload: bytes) -> bytes:
    """A PNG whose image data and head are right around a payload, as the seed's lens wants it."""
    from fakes.kinect.device import chunk

    width, height = LENS[0]
    head = struct.pack(">IIBBBBB", width, height, 16, 0, 0, 0, 0)
    whole = height * (1 + 2 * width)
    rows = zlib.compress((payload + bytes(whole))[:whole], 1)
    chunks = chunk(b"IHDR", head) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + chunks


def blob_of(payload: bytes, now_s: float) -> bytes:
    """A BLOB with a right description and frame around a payload, of the seed's camera."""
    from fakes.visionary import frames, models
    from fakes.visionary.faults import Faults
    from fakes.visionary.lens import lens_of
    from fakes.visionary.picture import Maps

    kind, faults = models.KINDS["t_mini"], Faults("t_mini")
    lens = lens_of(kind, HALVINGS[0])
    size = lens.size_px[0] * lens.size_px[1]
    given = np.frombuffer((payload + bytes(6 * size))[: 6 * size], "<u2").reshape(3, *lens.size_px)
    maps = Maps(given[0], given[1], given[2], np.zeros(0))
    number = round(1000.0 * now_s)
    binary = frames.binary(maps, kind, faults, 1.7e9 + now_s, number)
    return frames.message(frames.description(kind, lens, faults), 1, binary, 3)


@cache
def sections() -> dict[str, Any]:
    """Each device's own settings, by its driver."""
    from msgspec.structs import replace

    from config_file import load_config
    from hw.depth_images.options import FolderOptions, KinectOptions
    from hw.visionary.options import VisionaryOptions

    config, hokuyo, ragno = (
        load_config((ROOT / name).read_text(encoding="utf-8"))
        for name in ("mapod.toml", "robots/urg04lx.toml", "robots/ragno.toml")
    )
    scanner: Any = config.scanner.options
    camera: Any = ragno.scanner.options
    smaller = IMAGE_PX[0] / camera.image_px[0]
    lens = {name: [smaller * px for px in getattr(camera, name)] for name in LENS_PX}
    (fx, fy), (cx, cy) = (580.0, 580.0), (319.5, 239.5)
    depth = VisionaryOptions("cola_2", 0.05, "authorized_client", "CLIENT", 6554, 0.03)
    return {
        "visionary": depth,
        "kinect": KinectOptions([fx, fy], [cx, cy], False, 0.04, 0.075, 1.2, 0.001042, 200),
        "folder": FolderOptions(1 / 30),
        "lms111": replace(scanner, echo="both"),
        "urg04lx": hokuyo.scanner.options,
        "stripe": replace(camera, image_px=list(IMAGE_PX), **lens),
        "mti": config.ahrs.options,
        "ax3500": config.drive.options,
    }


def new_device(codec: str, port: Any, second: Any) -> Any:
    from hw.registry import ATTITUDE_SENSORS, DEPTH_CAMERAS, DRIVES, SCANNERS, Surroundings

    around = Surroundings("tcp://fuzzer:1", 3000.0, True, open_at=lambda number: second)
    makers: Any = SCANNERS | ATTITUDE_SENSORS | DRIVES | DEPTH_CAMERAS
    return makers[codec].make(port, sections()[codec], around)


def new_fake(codec: str) -> Any:
    from fakes.ax3500.device import FakeAx3500
    from fakes.kinect.device import FakeKinect
    from fakes.kinect.sensing import Lens
    from fakes.lms1xx.device import FakeLms111
    from fakes.mti.device import FakeMti
    from fakes.stripe.device import FakeStripe
    from fakes.urg04lx.device import FakeUrg04lx
    from fakes.visionary.device import FakeVisionary
    from fakes.world.simple import Ground, Motion, Room, TwoWheels

    match codec:
        case "lms111":
            return FakeLms111(Room("room").ranges_m_at, 1)
        case "urg04lx":
            return FakeUrg04lx(Room("room").ranges_m_at, 1)
        case "mti":
            return FakeMti(Motion("still").motion_at, 1)
        case "stripe":
            camera = FakeStripe(Ground("wall:1.2").met, 1)
            camera.image_px, camera.quality = IMAGE_PX, QUALITY
            camera.line_px, camera.laser = LINE_PX, LASER
            return camera
        case "visionary":
            depth = FakeVisionary("t_mini", Ground("wall:1.2").met, 1)
            depth.memory.written["binningOption"] = HALVINGS
            return depth
        case "kinect":
            return FakeKinect(Ground("wall:1.2").met, 1, "raw", Lens(*LENS))
        case "folder":
            return FakeKinect(Ground("wall:1.2").met, 1, "png", Lens(*LENS))
        case _:
            return FakeAx3500(TwoWheels(), 1)


def run_program(codec: str, program: bytes) -> int:
    """One input on a fresh device; how much it measured.

    Raises:
        AssertionError: it holds too much, or measures what can't be.
    """
    from fakes.wires.wire import MemoryPort
    from hw.mti.stream import MtStream

    port, second = MemoryPort(), MemoryPort()
    device = new_device(codec, port, second)
    now_s, at, steps, count = 100.0, 0, 0, 0
    while at + 3 <= len(program) and steps < MOST_STEPS:
        kind, size = program[at], int.from_bytes(program[at + 1 : at + 3], "big")
        data = program[at + 3 : at + 3 + size]
        at += 3 + size
        what = kind & 3
        if what == TIME:
            now_s += size / 1000.0
            at -= size  # the length is all there is
        elif what == CUT:
            width = max(1, kind >> 2)
            for start in range(0, len(data), width):
                port.give(data[start : start + width])
        elif codec == "visionary" and kind & SECOND:
            second.give(data if what == RAW else blob_of(data, now_s))
        else:
            port.give(data if what == RAW else frame_of(codec, data, now_s))
        now_s += STEP_S
        steps += 1
        measured = device.step(now_s)
        check_measured(measured)
        count += len(measured)
        port.take()
    stream = getattr(device, "stream", None)
    if isinstance(stream, MtStream):
        stream = dataclasses.replace(stream, legacy=None)  # a decoder keeps nothing
    known = stream, getattr(device, "_memory", None)
    held = len(pickle.dumps([device._intake._parser, known]))
    most = MOST_HELD + (2 * KINECT_BYTES if codec == "kinect" else 0)
    assert held <= most, f"holds {held} bytes"
    return count


def check_measured(measured: list[Any]) -> None:
    """Whatever the bytes were, a measurement has a time and no infinite range."""
    for record in measured:
        assert math.isfinite(record.times_s[0] if hasattr(record, "times_s") else record.t_s)
        if hasattr(record, "camera"):
            assert record.camera.rays.shape == (*record.numbers.shape, 3)
            assert np.isfinite(record.camera.rays).all()
            assert record.numbers.any()
        ranges_m = getattr(record, "ranges_m", None)
        assert ranges_m is None or not (abs(ranges_m) > 1e6).any()


def conversation_of(codec: str) -> tuple[list[bytes], int]:
    """Instructions of a healthy one; how many there are before the second port speaks."""
    from fakes.wires.wire import MemoryPort, Wire

    port, second = MemoryPort(), MemoryPort()
    fake = new_fake(codec)
    device = new_device(codec, port, second)
    wires = [Wire(getattr(fake, "control", fake), port, 1)]
    wires += [Wire(fake.stream, second, 2)] if codec == "visionary" else []
    said, before, now_s = list[bytes](), 0, 100.0
    for _ in range(round(SEED_S / STEP_S)):
        now_s += STEP_S  # as `run_program` does: to the bit, for pauses end by it
        for wire in wires:
            wire.step(now_s)
        for to, kind in ((port, RAW), (second, RAW | SECOND)):
            pieces = to.read()
            for piece in pieces:
                to.give(piece)
            if to is second and pieces:
                before = before or len(said)
            if to is port or pieces:
                said.append(instruction(kind, b"".join(pieces)[:MOST_INPUT]))
        device.step(now_s)
    return said, before


def write_seeds(codec: str, folder: Path) -> None:
    """A healthy conversation as programs, whole and from its middle, and the frames of vectors."""
    said, before = conversation_of(codec)
    whole = b"".join(said)
    (folder / "conversation").write_bytes(whole[:MOST_INPUT])
    (folder / "middle").write_bytes(b"".join(said[len(said) // 2 :])[:MOST_INPUT])
    if codec == "stripe":
        begin = whole.index(b"\xff\xd8")
        image = whole[begin : whole.index(b"\xff\xd9", begin) + 2]
        (folder / "image").write_bytes(instruction(FRAMED, b"") + instruction(FRAMED, image))
    if codec in ("kinect", "visionary"):
        kind = FRAMED | SECOND if codec == "visionary" else FRAMED
        shown = [instruction(kind, bytes([7 * k + 9, 3]) * 8) for k in range(8)]
        (folder / "frames").write_bytes(b"".join([*said[:before], *shown]))
    write_vectors(codec, folder)


def write_vectors(codec: str, folder: Path) -> None:
    vectors = ROOT / "tests" / "vectors"
    for path in vectors.glob(f"{codec}*.tsv"):
        for number, row in enumerate(path.read_text(encoding="utf-8").splitlines()):
            if row.startswith("#") or "\t" not in row:
                continue
            try:
                if codec == "urg04lx":  # as Python writes bytes
                    frame = row.split("\t")[1].encode().decode("unicode_escape").encode("latin-1")
                else:
                    frame = bytes.fromhex(row.split("\t")[2 if codec != "ax3500" else 1])
            except (ValueError, IndexError):
                frame = row.split("\t")[-1].encode() + b"\r"
            name = f"{path.stem}_{number}"
            (folder / name).write_bytes(instruction(CUT, frame, 7))
