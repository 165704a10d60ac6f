"""What a frame costs the map of objects, in maps of any size: `python -m tools.bench.object_map`.

The same frames of the same ten boxes go into maps that hold up to 10^5 other objects. Then the
quick look stands beside the whole frame, on a drive in which nothing changes and one in which
something does. Times are of the CPU, medians.
"""

import math
import time
import tracemalloc

import numpy as np

from core.objects.vector_map.mapped import MapObject
from core.objects.vector_map.object_map import ObjectMap
from core.objects.vector_map.quick_check import quick_check
from core.objects.vector_map.settings import QuickCheckSettings
from tools.experiments.object_world import (
    SETTINGS,
    Noise,
    World,
    box,
    furnished_room,
    way_around,
)

COUNTS = (0, 1_000, 10_000, 100_000)
LOOK = QuickCheckSettings(
    rays=100, max_range_m=4.5, tolerance_m=0.1, most_unknown=0.5, every_frames=10
)
NOISE = Noise(pose_m=0.005, pose_rad=0.002, hull_m=0.003, missing=0.0)


def others(count: int) -> list[MapObject]:
    """Boxes on a grid of 1 m, none within 10 m of the middle."""
    side = math.ceil(math.sqrt(count)) + 20
    cells = [(i, j) for i in range(side) for j in range(side) if max(i, j) >= 20]
    corners = np.array([[0.0, 0.0], [0.4, 0.0], [0.4, 0.3], [0.0, 0.3]])
    seen = 0.0, 0.0, 255, np.ones(4, dtype=bool), 1.0
    return [
        MapObject(n + 1, corners + np.array([i - 10.0, j - 10.0]), 0.0, 0.5, *seen, "static")
        for n, (i, j) in enumerate(cells[:count])
    ]


def frame_ms(count: int, frames: int = 150) -> tuple[float, float]:
    """Milliseconds of a frame, median, and bytes of an object, in a map that holds so many more."""
    tracemalloc.start()
    objects = ObjectMap(SETTINGS)
    objects.start_from(others(count), [], 0.0)
    used = tracemalloc.get_traced_memory()[0] / max(1, count)
    tracemalloc.stop()
    things = [box(1.5 + 0.4 * (k % 5), -1.0 + 0.5 * k / 2, 0.3, 0.2, 0.2 * k) for k in range(10)]
    world, times = World(things, noise=NOISE), []
    for k in range(frames):
        frame = world.frame(0.0, 0.0, 0.3 * math.sin(0.1 * k))
        before_s = time.process_time()
        objects.update(frame)
        times.append(time.process_time() - before_s)
        world.walk()
    return 1000.0 * float(np.median(times[frames // 3 :])), used


def with_looks(is_quick: bool, is_changed: bool) -> tuple[float, float, int]:
    """Milliseconds of a frame, share of frames taken whole, and objects at the end."""
    world, objects = furnished_room(5, NOISE), ObjectMap(SETTINGS)
    spent_s, whole, ways = 0.0, 0, way_around(600, 7.3)
    for n, (x, y, yaw) in enumerate(ways * 2):
        frame = world.frame(x, y, yaw)
        bearings = yaw + world.fov_rad * (np.arange(LOOK.rays) / (LOOK.rays - 1) - 0.5)
        ranges = world.cast(np.array([x, y]), bearings)[0]
        before_s = time.process_time()
        is_whole = n < len(ways) or not is_quick or n % LOOK.every_frames == 0
        if not is_whole:
            is_whole = not quick_check(objects, frame.origin, bearings, ranges, LOOK).agrees
        if is_whole:
            objects.update(frame)
        if n >= len(ways):
            spent_s += time.process_time() - before_s
            whole += is_whole
        if is_changed and n == len(ways):
            world.things = world.things[2:]
        world.walk()
    return 1000.0 * spent_s / len(ways), whole / len(ways), len(objects.objects())


def main() -> None:
    frame_ms(0, 10)  # compiles
    print("objects  ms/frame  bytes/object")
    for count in COUNTS:
        cost_ms, used = frame_ms(count)
        print(f"{count:7d}  {cost_ms:8.2f}  {used if count else math.nan:12.0f}")
    print("\nroom       ms/frame  whole frames  objects   (second way round)")
    for is_changed in (False, True):
        for is_quick in (False, True):
            cost_ms, whole, count = with_looks(is_quick, is_changed)
            name = f"{'changed' if is_changed else 'same'}, {'quick' if is_quick else 'always'}"
            print(f"{name:15s} {cost_ms:5.2f}  {whole:12.1%}  {count:7d}")


if __name__ == "__main__":
    main()
