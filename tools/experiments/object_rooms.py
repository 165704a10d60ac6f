"""Furnished rooms, mapped and compared with the truth: `python -m tools.experiments.object_rooms`.

A camera drives around a room of 12 boxes and turns as it goes. It prints the table of
docs/object-map.md, over seeds that nothing was tuned on, and draws its picture.
"""

import argparse
import math
import time
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import shapely
from msgspec import Struct
from PIL import Image, ImageDraw

from core.objects.records import Floats
from core.objects.vector_map.object_map import ObjectMap
from tools.docs.pictures import PICTURES, record
from tools.experiments.object_world import (
    ROOM_M,
    SETTINGS,
    Noise,
    World,
    corner_errors,
    furnished_room,
    overlap,
    way_around,
)

TUNED_ON, JUDGED_ON = range(1, 4), range(11, 21)  # seeds of rooms
NOISES = {
    "none": Noise(),
    "usual": Noise(pose_m=0.01, pose_rad=0.005, hull_m=0.005, missing=0.02),
    "rough": Noise(pose_m=0.03, pose_rad=0.01, hull_m=0.01, missing=0.02),
}
FRAMES, TURNS = 1200, 14.3  # two minutes of a way round; not a whole number of turns
SAME = 0.5  # an object is that of the truth from this overlap on
SEEN = 2 * SETTINGS.confirm_frames  # frames in which a corner was seen: it counts as seen
SCALE, EDGE = 90, 20  # pixels of the picture: a metre, and around the room


class Judged(Struct, frozen=True):
    """One room against its truth."""

    things: int  # of which enough was seen
    missed: int
    false: int
    corners_m: list[float]  # errors, of things of which every corner was seen
    areas: list[float]  # and of their areas, as shares
    frame_ms: float


def drive(world: World, frames: int) -> tuple[ObjectMap, float]:
    """A map made on the way round, and the milliseconds of a frame."""
    objects, spent_s = ObjectMap(SETTINGS), 0.0
    for pose in way_around(frames, TURNS * frames / FRAMES):
        frame = world.frame(*pose)
        before_s = time.process_time()
        objects.update(frame)
        spent_s += time.process_time() - before_s
        world.walk()
    return objects, 1000.0 * spent_s / frames


def judge(world: World, objects: ObjectMap, frame_ms: float = 0.0) -> Judged:
    """Compare a map with the world; things of which two corners were seen have to be in it."""
    found = [one.polygon for one in objects.objects()]
    seen = [k for k, counts in enumerate(world.corner_frames) if (counts >= SEEN).sum() >= 2]
    matched, corners, areas = set[int](), list[float](), list[float]()
    for k in seen:
        truth = world.things[k].outline
        overlaps = [overlap(truth, one) for one in found]
        best = int(np.argmax(overlaps)) if overlaps else -1
        if best < 0 or (overlaps[best] < SAME and not is_part(truth, found[best])):
            continue
        matched.add(best)
        if (world.corner_frames[k] >= SEEN).all():
            corners += corner_errors(truth, found[best]).tolist()
            areas.append(shapely.Polygon(found[best]).area / shapely.Polygon(truth).area - 1.0)
    real = [one for one in found if any(is_part(t.outline, one) for t in world.things)]
    return Judged(
        len(seen), len(seen) - len(matched), len(found) - len(real), corners, areas, frame_ms
    )


def is_part(truth: Floats, found: Floats) -> bool:
    """Whether most of what was found lies within a thing: the rest of it was not seen."""
    one = shapely.Polygon(found)
    return bool(one.intersection(shapely.Polygon(truth)).area > 0.8 * one.area)


def row(name: str, rooms: Iterable[Judged]) -> str:
    """A row of the table."""
    judged = list(rooms)
    things, missed = sum(one.things for one in judged), sum(one.missed for one in judged)
    false = sum(one.false for one in judged)
    corners = 1000.0 * np.array([error for one in judged for error in one.corners_m])
    areas = 100.0 * np.abs([error for one in judged for error in one.areas])
    recall = (things - missed) / things
    precision = (things - missed) / max(1, things - missed + false)
    c50, c95 = np.percentile(corners, [50, 95])
    a50, a95 = np.percentile(areas, [50, 95])
    return (
        f"| {name} | {things} | {recall:.3f} | {precision:.3f} | {c50:.0f} | {c95:.0f} |"
        f" {np.mean(corners <= 30):.3f} | {a50:.1f} | {a95:.1f} |"
    )


def picture(world: World, objects: ObjectMap) -> Image.Image:
    """The truth in grey, the map over it: finished sides green, others red, walls blue."""
    (w, h), line = ROOM_M, 3
    image = Image.new("RGB", (round(w * SCALE) + 2 * EDGE, round(h * SCALE) + 2 * EDGE), "white")
    draw = ImageDraw.Draw(image)

    def at(points: Floats) -> list[tuple[float, float]]:
        return [(EDGE + SCALE * (x + w / 2), EDGE + SCALE * (h / 2 - y)) for x, y in points]

    draw.line([point for x, y, _ in way_around(200, 1) for point in at(np.array([[x, y]]))], "#ddd")
    for thing in world.things:
        draw.polygon(at(thing.outline), fill="#c8c8c8")
    for wall in objects.walls.records():
        for segment in wall.segments:
            draw.line(at(segment.reshape(2, 2)), "#2850dc", line)
    for one in objects.objects():
        ends = np.roll(one.polygon, -1, axis=0)
        for a, b, is_finished in zip(one.polygon, ends, one.finished, strict=True):
            draw.line(at(np.array([a, b])), "#1e8c3c" if is_finished else "#d72828", line)
    return image


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rooms", type=int, default=len(JUDGED_ON), help="of those judged on")
    parser.add_argument("--frames", type=int, default=FRAMES, help="of each drive")
    parser.add_argument("--picture", type=Path, help="PNG of the first room, usual noise")
    given = parser.parse_args()
    print("| noise | things | recall | precision | corner mm | 95 % | <= 30 mm | area % | 95 % |")
    print("|---|---|---|---|---|---|---|---|---|")
    for name, noise in NOISES.items():
        rooms = []
        for seed in JUDGED_ON[: given.rooms]:
            world = furnished_room(seed, noise)
            objects, frame_ms = drive(world, given.frames)
            rooms.append(judge(world, objects, frame_ms))
            if given.picture and (name, seed) == ("usual", JUDGED_ON[0]):
                picture(world, objects).save(given.picture, optimize=True)
                if given.picture.resolve().parent == PICTURES:
                    made_of = ["tools/experiments/object_rooms.py"]
                    record([given.picture.name], "make object-map", made_of)
        print(row(name, rooms), flush=True)
        times_ms = [one.frame_ms for one in rooms]
        print(f"    {name}: {math.fsum(times_ms) / len(times_ms):.1f} ms of CPU a frame")


if __name__ == "__main__":
    main()
