"""Pairs of works whose costs are compared in one run: ours, and another that does as much.

Either takes the number of its round. What grows (cells, beams, receivers, objects) is compared with
itself, smaller.
"""

import functools
import pickle
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from msgspec.structs import replace as changed

from config_file import load_config, with_changes
from core.config import Config
from core.mapping.mapper import Mapper
from core.objects.frame.steps import FrameSteps
from core.objects.vector_map.object_map import ObjectMap
from core.records import DepthImage, Scan, StopZoneReport
from fakes.wires.wire import MemoryPort
from hw.planner_link.receivers import Planners
from hw.planner_link.sender import LinkSettings, Wire
from tools.bench import bench, mapping, object_map, stripe
from tools.bench.drive import FAST, SHIPPED, RandomMap
from tools.bench.libraries import maybe_octomap, maybe_open3d
from tools.bench.objects import our_steps, peer_steps
from tools.experiments.object_world import SETTINGS, World, box
from tools.objects.frames import FRAMES, KINECT, image_of, pose_of

Work = Callable[[int], Any]
DRIVE_S = 6.0  # of the recorded drive, of which the first seconds have no scans in the map
DECODED_BYTES = 40_000
SIZE, CELL_M = 101, 0.2
ZONE = StopZoneReport(1.2, 1.5, 0.0, np.inf, 1.9, 0.6, 0.0, 0.4, -0.8, (np.inf,) * 8, 2, 0b11)
MORE_RECEIVERS, MORE_OBJECTS = 8, 10_000
NO_WALLS = np.zeros((0, 4))


@dataclass(frozen=True, slots=True)
class Pair:
    """One row: what of ours, against what."""

    name: str
    against: str
    ours: Work
    peer: Work
    rounds: int  # at least; more where there is time


# Decoding


def numpy_telegrams(stream: bytes) -> int:
    """CoLa-B scans by NumPy, as far as it does without a parser: frame, checksum, ranges."""
    at, count = 0, 0
    while at + 8 <= len(stream):
        size = int.from_bytes(stream[at + 4 : at + 8], "big")
        body = np.frombuffer(stream, np.uint8, size, at + 8)
        assert np.bitwise_xor.reduce(body) == stream[at + 8 + size]
        begin = stream.index(b"DIST1", at) + 21
        points = int.from_bytes(stream[begin - 2 : begin], "big")
        raw = np.frombuffer(stream, ">u2", points, begin)
        ranges_m = np.where(raw == 0, np.nan, raw / 1000.0)
        count += bool(np.isfinite(ranges_m).any())
        at += 9 + size
    return count


def plain_lines(stream: bytes) -> int:
    """Echoes and counters by Python's own functions."""
    return sum(int(line, 16) for line in stream.split(b"\r") if line and line[:1] != b"?")


def decoding() -> Iterator[Pair]:
    session = (bench.VECTORS / "lms111_session_d2h.bin").read_bytes()
    telegrams = session[session.index(b"sSN LMDscandata") - 8 :]
    size = 9 + int.from_bytes(telegrams[4:8], "big")
    telegrams = telegrams[:size] * (DECODED_BYTES // size)
    lines = bench.counter_stream()

    def fed(make: Callable[[], bench.Feed], stream: bytes, piece: int) -> Work:
        return lambda k: bench.decoded(make, stream, piece)

    yield Pair(
        "scan telegrams decoded",
        "NumPy",
        fed(bench.scans, telegrams, bench.PIECE),
        lambda k: numpy_telegrams(telegrams),
        20,
    )
    yield Pair(
        "counter lines decoded",
        "plain Python",
        fed(bench.counters, lines, bench.LINE_PIECE),
        lambda k: plain_lines(lines),
        20,
    )


# Maps


class Inserted:
    """Scans of one drive into the maps, one after the other."""

    def __init__(self, config: Config, taken: Sequence[Any], every: int = 1) -> None:
        self._maps, self._left = Mapper(config).maps, iter(taken)
        self._every = every
        self._maps.warm()

    def __call__(self, k: int) -> None:
        scan, attitudes, odometry = next(self._left)
        self._maps.add(thinned(scan, self._every), attitudes, odometry)
        self._maps.window.take_changed()


def thinned(scan: Scan, every: int) -> Scan:
    """Every so many beams of it."""
    ranges_m = np.ascontiguousarray(scan.ranges_m[:, ::every])
    steps = {"step_rad": scan.step_rad * every, "beam_dt_s": scan.beam_dt_s * every}
    return changed(scan, ranges_m=ranges_m, **steps)


def points_of(scan: Scan) -> np.ndarray:
    """(n, 3) metres of its returns, in the frame of a sensor that looks down a little."""
    ranges_m = scan.ranges_m[0]
    bearings = scan.first_rad + scan.step_rad * np.arange(ranges_m.size)
    rays = np.column_stack([np.cos(bearings), np.sin(bearings), -0.13 * np.cos(bearings)])
    met = np.isfinite(ranges_m) & (ranges_m > 0.15)
    return np.ascontiguousarray(ranges_m[met, None] * rays[met])


@functools.cache
def drive_taken() -> tuple[Config, list[Any]]:
    """Settings and what the maps were given of a drive, once they have begun."""
    shipped = with_changes(load_config(SHIPPED.read_text(encoding="utf-8")), scanner=FAST)
    raw = mapping.recorded("corridor", shipped, DRIVE_S)
    return shipped, [pickle.loads(one) for one in raw]


def maps(most: int) -> Iterator[Pair]:
    shipped, taken = drive_taken()
    taken = taken[-most:]
    rounds = len(taken) - 1  # the first warms

    def sized(cells: int, every: int = 1) -> Inserted:
        sizes = {"cells": cells, "cell_m": CELL_M}
        window = {"window_cells": cells}
        return Inserted(with_changes(shipped, map=sizes, obstacle=window), taken, every)

    scans = [given[0] for given in taken]
    peer = mapping.NumpyPeer(SIZE, CELL_M)
    yield Pair("scan into the map", "NumPy", sized(SIZE), lambda k: peer.add(scans[k]), rounds)
    octomap = maybe_octomap()
    if octomap is not None:
        tree, points = octomap.OcTree(CELL_M), [points_of(scan) for scan in scans]
        lens = np.zeros(3)
        yield Pair(
            "scan into the map",
            "OctoMap",
            sized(SIZE),
            lambda k: tree.insertPointCloud(points[k], lens),
            rounds,
        )
    yield Pair("scan, 16 times the cells", "the same, 101 x 101", sized(401), sized(101), rounds)
    yield Pair(
        "scan, 4 times the beams", "the same, a quarter", sized(SIZE), sized(SIZE, 4), rounds
    )


# Cameras


def numpy_points(image: DepthImage, edge_m: float) -> int:
    """A depth frame to points and voxels, by NumPy."""
    depth_m = image.numbers.astype(np.float64) / 1000.0
    points = (image.camera.rays * depth_m[..., None])[depth_m > 0]
    x, y, z = (np.floor(points / edge_m).astype(np.int64) + 2**19).T
    return len(np.unique(x << 40 | y << 20 | z))


def cameras() -> Iterator[Pair]:
    frame = FRAMES[-1]
    image, pose, steps = image_of(frame), pose_of(frame), FrameSteps(KINECT)
    yield Pair(
        "depth frame to objects",
        "NumPy: points and voxels",
        lambda k: steps.find(image, pose, NO_WALLS),
        lambda k: numpy_points(image, KINECT.voxel_m),
        5,
    )
    open3d = maybe_open3d()
    if open3d is not None:
        ours = our_steps(steps, image, pose)
        theirs = peer_steps(open3d, image, steps.room)
        shared = [step for step in ours if step.peer in theirs]
        yield Pair(
            "depth frame to objects",
            "Open3D: the steps that both have",
            lambda k: [step.run() for step in shared],
            lambda k: [theirs[step.peer]() for step in shared],
            5,
        )
    line = stripe.Line()
    if not line.decoder.is_missing:
        line.begin()
        yield Pair("stripe image to ranges", "OpenCV and NumPy", line.whole, line.plain, 15)


# Receivers and objects


def told_to(count: int) -> Work:
    """One tick of the link to so many receivers, of a map that changes."""
    ports = [MemoryPort(datagrams=True) for _ in range(count)]
    wires = [Wire(port, None, "", "") for port in ports]
    settings = LinkSettings(size=SIZE, cell_mm=50, tick_s=0.02, stale_ms=150)
    planners, world = Planners(wires, settings, 7), RandomMap(SIZE, 1)

    def tick(k: int) -> None:
        now_s = 100.0 + k / 50
        window = world.until(k / 50)
        planners.poll(now_s)
        planners.step(now_s, world.pose, window, ZONE, None)
        for port in ports:
            port.take_datagrams()

    return tick


def kept_among(count: int) -> Work:
    """One frame of ten boxes into a map of objects that holds so many others."""
    objects = ObjectMap(SETTINGS)
    objects.start_from(object_map.others(count), [], 0.0)
    things = [box(1.5 + 0.4 * (k % 5), -1.0 + 0.5 * k / 2, 0.3, 0.2, 0.2 * k) for k in range(10)]
    world = World(things, noise=object_map.NOISE)
    frames = []
    for k in range(40):
        frames.append(world.frame(0.0, 0.0, 0.3 * np.sin(0.1 * k)))
        world.walk()
    return lambda k: objects.update(frames[k % len(frames)])


def growth() -> Iterator[Pair]:
    many = f"tick of the link, {MORE_RECEIVERS} receivers"
    yield Pair(many, "the same, one", told_to(MORE_RECEIVERS), told_to(1), 100)
    much = f"objects, {MORE_OBJECTS} others"
    yield Pair(much, "the same, none", kept_among(MORE_OBJECTS), kept_among(0), 40)


def pairs(scans: int) -> Iterator[Pair]:
    """All of them; `scans` of the drive are inserted."""
    yield from decoding()
    yield from maps(scans)
    yield from cameras()
    yield from growth()
