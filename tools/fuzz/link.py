"""The planner link as a target: all that can arrive at the sender, with a key and without.

An input says what comes over a datagram port and over a serial line, frame by frame. Whatever it
is, the sender goes on, what it sends are frames, and no request is obeyed that is out of range.
With a key, nothing is obeyed while no frame of the input had a right tag.
"""

import math
from pathlib import Path

import numpy as np

from core.records import ObstacleMap, PoseReport, StopZoneReport, SweepPoints
from fakes.wires.wire import MemoryPort
from hw.planner_link.receivers import Planners
from hw.planner_link.requests import MOST_COMMANDERS
from hw.planner_link.sender import LinkSettings, Wire
from mapod_link.asking import (
    ACK_BODY,
    ASK_BODY,
    DRIVE_BODY,
    EXTERNAL_BODY,
    UPRIGHT_BODY,
    ack_body,
    hello_body,
)
from mapod_link.frames import (
    ACK,
    ASK,
    DRIVE,
    EXTERNAL_POSE,
    HELLO,
    bytes_from_frame,
    frame_from_bytes,
    signed_bytes_from_frame,
)
from mapod_link.serial_line import serial_from_frame
from tools.fuzz.program import instruction, instructions_of

RAW, FRAMED, SIGNED, TIME = range(4)  # by the low 2 bits of an instruction's first byte
LINE = 4  # this bit beside them: over the serial line
WRONG = 8  # this bit beside FRAMED: with a flag that says it has a tag, which is the body's end
TYPE_SHIFT, TYPES = 4, range(16)  # the high 4 bits: the frame's type
KEY, SESSION, NONCE = bytes(range(32)), 0x5A17C0DE, 0x11223344
SIZE, TICK_S, MOST_STEPS = 15, 0.02, 200
CELLS = np.random.default_rng(1).integers(-1, 2, (SIZE, SIZE)).astype(np.int8)
POSE = PoseReport(1.0, 2.0, 0.3, 0.0, 0.0, 0.5, 0.1, 0x7F, 0.02, 0.01, 0.05, 1)
ZONE = StopZoneReport(1.2, 1.5, 0.0, np.inf, 1.9, 0.6, 0.0, 0.4, -0.8, (np.inf,) * 8, 2, 0b11)
FASTEST = 32.768  # m/s and rad/s that a frame can tell


class Source:
    """Values for whatever tile is asked for, and a sweep."""

    def values(
        self, layer: str, i: int, j: int, width: int, first: int, count: int
    ) -> np.ndarray | None:
        del layer, i, j, width
        return np.linspace(first, first + 1.0, count, dtype=np.float32)

    def maybe_scan(self) -> SweepPoints | None:
        return SweepPoints(100.0, (0.0, 0.0, 1.0), np.ones((7, 3)), 541)


def run(program: bytes, *, has_key: bool) -> int:
    """How many requests to drive were obeyed. Raises AssertionError."""
    ports = MemoryPort(datagrams=True), MemoryPort()
    wires = [Wire(ports[0], None, "", ""), Wire(ports[1], 115_200, "", "")]
    settings = LinkSettings(
        size=SIZE, cell_mm=200, tick_s=TICK_S, stale_ms=150, key=KEY if has_key else None
    )
    planners, now_s, source, knows_key = Planners(wires, settings, SESSION), 100.0, Source(), False
    for number, (kind, data) in enumerate(instructions_of(program, MOST_STEPS)):
        if kind & 3 == TIME:
            now_s += len(data) / 100
        else:
            knows_key |= kind & 3 == SIGNED
            frame = frame_of(kind, data, number, now_s)
            on_line = bool(kind & LINE)
            is_raw = kind & 3 == RAW
            ports[on_line].give(serial_from_frame(frame) if on_line and not is_raw else frame)
        now_s += TICK_S
        changed = np.arange(number % 3, dtype=np.int32)
        window = ObstacleMap(CELLS, number // 7, 3, changed, number // 100, number % 11 != 0)
        planners.poll(now_s)
        planners.step(now_s, POSE, window, ZONE, source)
        for sent in ports[0].take_datagrams():
            assert not isinstance(frame_from_bytes(sent), str)
        ports[1].take()
        check(planners, knows_key or not has_key)
    return planners.requests.accepted


def frame_of(kind: int, data: bytes, number: int, now_s: float) -> bytes:
    """A frame with its head and sum around a body, or the bytes as they are."""
    frame_type, t_ms = kind >> TYPE_SHIFT, round(now_s * 1000)
    if kind & 3 == SIGNED:
        return signed_bytes_from_frame(frame_type, number, t_ms, data, KEY, SESSION, NONCE)
    if kind & 3 == FRAMED:
        return bytes_from_frame(frame_type, number, t_ms, data, 0x10 if kind & WRONG else 0)
    return data


def check(planners: Planners, may_ask: bool) -> None:
    requests, poses = planners.requests, planners.external_poses.take_all()
    newest = requests.newest
    assert may_ask or not (requests.accepted or poses), "obeyed without a key"
    if newest is not None and newest.valid_until_s > -math.inf:
        assert abs(newest.v_mps) <= FASTEST
        assert abs(newest.w_radps) <= FASTEST
    for pose in poses:
        assert math.isfinite(pose.t_s + pose.x_m + pose.y_m)
    known = planners._guard._known
    assert len(known) <= MOST_COMMANDERS


def write_seeds(folder: Path) -> None:
    """A planner that greets, asks, acknowledges and drives, signed and not, over both ports."""
    drive = DRIVE_BODY.pack(SESSION, NONCE, 300, -200, 400, 0)
    place = EXTERNAL_BODY.pack(SESSION, NONCE, 1000, -2000, 500, 20, 20, 0, 30, 10)
    upright = UPRIGHT_BODY.pack(10, 5, 3, -3, 9)
    said = [
        (HELLO, hello_body(NONCE, 1000)),
        (ACK, ack_body(1, 0, 100_040, 0.0, 0, 0, 0xDE)),
        (ASK, ASK_BODY.pack(1, 0x7F, 1, 0, 0, 0, 0)),
        (ASK, ASK_BODY.pack(2, 0x88, 3, 0, 0, 5, 5)),
        (DRIVE, drive),
        (EXTERNAL_POSE, place),
        (EXTERNAL_POSE, place + upright),
        (HELLO, hello_body(NONCE + 1, 1000, poll=True)),
        (ASK, ASK_BODY.pack(3, 0x1F, 1, -3, 2, 4, 4)),
        (ACK, ACK_BODY.pack(40, 0xFFFFFFFF, 100_100, 5, 1, 0x13, 0xDE)),
    ]
    for way in (FRAMED, SIGNED, FRAMED | LINE, SIGNED | LINE):
        pieces = [instruction(way, body)[1:] for _, body in said]
        heads = [bytes([way | frame_type << TYPE_SHIFT]) for frame_type, _ in said]
        whole = b"".join(head + piece for head, piece in zip(heads, pieces, strict=True))
        (folder / f"planner-{way}").write_bytes(whole + instruction(TIME, bytes(40)) + whole)
        for (frame_type, _), head, piece in zip(said, heads, pieces, strict=True):
            (folder / f"frame-{frame_type}-{way}-{len(piece)}").write_bytes(head + piece)
