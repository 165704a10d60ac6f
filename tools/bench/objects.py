"""What a depth frame costs step by step, beside Open3D: `python -m tools.bench.objects`.

The real frames of tests/vectors/kinect, 640 x 480, and one of them cut to 512 x 424. Open3D does
the same steps on the same frame in the same run, as far as it has them, on one thread. Times are of
the CPU, medians; the ratio of both compares between machines, and busy hours of one.
"""

import sys
import time
from collections.abc import Callable, Sequence
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from core.objects.frame import hulls, outlines, summits, view, voxels
from core.objects.frame.room import Room
from core.objects.frame.steps import CameraPose, FrameSteps, level_of
from core.records import F64, DepthCamera, DepthImage
from tools.bench.libraries import maybe_open3d
from tools.objects.frames import FRAMES, KINECT, Frame, image_of, pose_of

ROUNDS, PEER_ROUNDS = 40, 8
NO_WALLS = np.zeros((0, 4))
SMALL = 424, 512


class Step(NamedTuple):
    """One step of ours, and what Open3D calls it."""

    name: str
    run: Callable[[], Any]
    peer: str


def median_ms(run: Callable[[], Any], rounds: int = ROUNDS) -> float:
    run()
    spent = []
    for _ in range(rounds):
        begun_s = time.process_time()
        run()
        spent.append(time.process_time() - begun_s)
    return 1000.0 * float(np.median(spent))


def cut(image: DepthImage) -> DepthImage:
    """The middle of a frame, as large as that of a time-of-flight camera."""
    rows, columns = (
        (have - want) // 2 for have, want in zip(image.numbers.shape, SMALL, strict=True)
    )
    here = slice(rows, rows + SMALL[0]), slice(columns, columns + SMALL[1])
    camera = DepthCamera(np.ascontiguousarray(image.camera.rays[here]), image.camera.offset_m)
    return DepthImage(0.0, np.ascontiguousarray(image.numbers[here]), camera, 0, 0.0)


def hulls_of(room: Room, lens_m: float, count: int, found: int) -> list[F64]:
    """Around what `count` voxels in `found` clusters are of, m on the floor."""
    edge_m, things = KINECT.voxel_m, int(room.points.found[0])
    outlines.measure(
        room.voxels, count, room.labels, lens_m, room.fan, room.rim, room.down_rad,
        room.measures, found,
    )  # fmt: skip
    outlines.outline(
        room.points, 0, 1, things, edge_m, room.voxels, count, room.labels, room.columns,
        room.measures, found,
    )  # fmt: skip
    gap_m = np.full(found, KINECT.cluster_m)
    hulls.rings(
        room.columns.x, room.columns.y, room.measures.begin, edge_m, room.measures.columns,
        gap_m, found, room.rings,
    )  # fmt: skip
    return hulls.polygons_of(room.rings, found, edge_m, KINECT.hull_m)


def our_steps(steps: FrameSteps, image: DepthImage, pose: CameraPose) -> list[Step]:
    """The costly ones, each on what the whole frame leaves in its arrays."""
    steps.find(image, pose, NO_WALLS)
    room = steps.room
    level = level_of(pose, image.camera)
    assert level is not None
    seen_floor = steps.floor_of(image, level, pose)
    assert seen_floor is not None
    _, plane, C = seen_floor
    lens_m, things = steps.classify(level, plane, C), int(room.points.found[0])
    edge_m, cluster_m = KINECT.voxel_m, KINECT.cluster_m
    none = np.zeros_like(room.used)

    def thin() -> int:
        return voxels.thin(room.points, 0, 1, things, edge_m, room.voxels)

    count = thin()

    def cluster() -> int:
        voxels.cluster(
            room.voxels, count, none, cluster_m, lens_m, room.warp, room.labels, room.clusters
        )
        valley_m = KINECT.summit_m
        return summits.part(
            room.voxels, count, room.labels, valley_m, room.clusters, room.columns, room.bins
        )

    found = cluster()

    def seen() -> F64:
        view.reaches(
            room.fan, (room.across_rad, room.down_rad), lens_m, KINECT.low_m, room.near, room.far
        )
        return view.view_of(room.near, room.far, room.fan)

    return [
        Step("ranges and floor", lambda: steps.floor_of(image, level, pose), "segment_plane"),
        Step("points and kinds", lambda: steps.classify(level, plane, C), "points"),
        Step("voxels", thin, "voxel_down_sample"),
        Step("clusters", cluster, "cluster_dbscan"),
        Step("outlines and hulls", lambda: hulls_of(room, lens_m, count, found), "convex hulls"),
        Step("seen space", seen, ""),
    ]


def peer_steps(o3d: ModuleType, image: DepthImage, room: Room) -> dict[str, Callable[[], Any]]:
    """Open3D's, each on what the one before it gives."""
    rays = image.camera.rays
    focal = 1.0 / abs(float(rays[0, 1, 1] - rays[0, 0, 1]) / float(rays[0, 0, 0]))
    cx, cy = (float(rays[0, 0, k] / rays[0, 0, 0]) * focal for k in (1, 2))
    rows, columns = image.numbers.shape
    pinhole = o3d.camera.PinholeCameraIntrinsic(columns, rows, focal, focal, cx, cy)
    depth = o3d.geometry.Image(image.numbers)

    def points() -> Any:
        return o3d.geometry.PointCloud.create_from_depth_image(
            depth, pinhole, depth_scale=1000.0, depth_trunc=KINECT.max_range_m
        )

    cloud = points().uniform_down_sample(room.stride**2)
    n = int(room.points.found[0])
    things = np.column_stack([room.points.x[:n], room.points.y[:n], room.points.z[:n]])
    some = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(things.astype(np.float64)))
    thinned = some.voxel_down_sample(KINECT.voxel_m)
    labels = np.asarray(thinned.cluster_dbscan(KINECT.cluster_m, 1))
    parts = [thinned.select_by_index(np.flatnonzero(labels == k)) for k in range(labels.max() + 1)]
    parts = [part for part in parts if len(part.points) > 20]
    return {
        "points": points,
        "segment_plane": lambda: cloud.segment_plane(0.02, 3, 150),
        "voxel_down_sample": lambda: some.voxel_down_sample(KINECT.voxel_m),
        "cluster_dbscan": lambda: thinned.cluster_dbscan(KINECT.cluster_m, 1),
        "convex hulls": lambda: [part.compute_convex_hull(joggle_inputs=True) for part in parts],
    }


def report(name: str, frame: Frame, image: DepthImage, o3d: ModuleType | None) -> None:
    steps, pose = FrameSteps(KINECT), pose_of(frame)
    whole_ms = median_ms(lambda: steps.find(image, pose, NO_WALLS))
    told = steps.find(image, pose, NO_WALLS).objects
    rows, columns = image.numbers.shape
    print(f"{name}, {columns} x {rows}: {whole_ms:.1f} ms, {len(told.detections)} objects")
    ours = our_steps(steps, image, pose)
    peers = peer_steps(o3d, image, steps.room) if o3d else {}
    total_ms, peer_total_ms = 0.0, 0.0
    for step in ours:
        ms = median_ms(step.run)
        line = f"  {step.name:20} {ms:6.2f} ms"
        if step.peer in peers:
            peer_ms = median_ms(peers[step.peer], PEER_ROUNDS)
            line += f"; Open3D {step.peer} {peer_ms:.2f}; {ms / peer_ms:.2f} times"
            total_ms, peer_total_ms = total_ms + ms, peer_total_ms + peer_ms
        print(line)
    if peers:
        ratio = total_ms / peer_total_ms
        print(
            f"  {'both have':20} {total_ms:6.2f} ms; Open3D {peer_total_ms:.2f}; {ratio:.2f} times"
        )


def main(arguments: Sequence[str]) -> int:
    o3d = maybe_open3d()
    if o3d is None:
        print("mapod: without Open3D beside it: make bench puts it into build/open3d")
    for frame in FRAMES:
        if not arguments or frame.file in arguments:
            report(frame.file, frame, image_of(frame), o3d)
    report(f"{FRAMES[-1].file}, its middle", FRAMES[-1], cut(image_of(FRAMES[-1])), o3d)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
