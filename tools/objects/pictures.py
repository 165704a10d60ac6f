"""Pictures of each step of the real frames: `python -m tools.objects.pictures [FRAME ...]`.

Left the image: by range, by what each pixel is, and by object. Right the floor from above: what was
seen through, walls, and the objects' polygons.
"""

import sys
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import shapely
from PIL import Image, ImageDraw

from core.objects.frame import pixels
from core.objects.frame.steps import FrameResult, FrameSteps
from core.objects.records import Floats
from core.records import DepthImage
from tools.docs.pictures import PICTURES, record, with_neighbours
from tools.objects.frames import FRAMES, Frame, image_of, pose_of

Pixels = npt.NDArray[np.uint8]
KINDS = {
    pixels.NOTHING: (25, 25, 25),
    pixels.FLOOR: (90, 150, 90),
    pixels.THING: (215, 130, 40),
    pixels.PIT: (200, 40, 200),
    pixels.FLYING: (255, 0, 0),
    pixels.HIGH: (90, 120, 200),
}
COLOURS = (
    (230, 80, 60), (70, 130, 230), (240, 190, 40), (80, 180, 90), (170, 90, 200), (60, 190, 190),
    (240, 130, 180), (150, 110, 60), (140, 190, 60), (110, 110, 240),
)  # fmt: skip
GREY, SEEN, INK = (70, 70, 70), (214, 236, 214), (20, 20, 20)
SMALL, PLAN = (320, 240), 480  # px
MADE_OF = [*with_neighbours("core/objects/frame/steps.py"), "tools/objects/*.py"]


def by_range(image: DepthImage, longest_m: float) -> Pixels:
    """Near bright, far dark, nothing black."""
    ranges = image.numbers * np.linalg.norm(image.camera.rays, axis=2)
    grey = np.where(ranges > 0.0, 255.0 - 215.0 * np.clip(ranges / longest_m, 0.0, 1.0), 0.0)
    return np.repeat(grey[:, :, None], 3, axis=2).astype(np.uint8)


def by_kind(kinds: npt.NDArray[np.uint8]) -> Pixels:
    out = np.zeros((*kinds.shape, 3), np.uint8)
    for kind, colour in KINDS.items():
        out[kinds == kind] = colour
    return out


def by_object(frame: Frame, image: DepthImage, found: FrameResult, kinds: Pixels) -> Pixels:
    """Pixels of things in the colour of the polygon over which they lie."""
    T = pose_of(frame).T_map_sensor
    points = (image.numbers[:, :, None] * image.camera.rays) @ T[:3, :3].T + T[:3, 3]
    out = np.where((kinds == pixels.FLOOR)[:, :, None], np.uint8(55), np.uint8(20))
    out = np.repeat(out, 3, axis=2)
    is_thing = kinds == pixels.THING
    x, y, z = (points[:, :, k][is_thing] for k in range(3))
    colours = np.full((len(x), 3), 110, np.uint8)
    for k, one in enumerate(found.objects.detections):
        near = shapely.buffer(shapely.Polygon(one.polygon), 0.03)
        inside = (
            shapely.contains_xy(near, x, y) & (z < one.top_m + 0.05) & (z > one.bottom_m - 0.05)
        )
        colours[inside] = COLOURS[k % len(COLOURS)]
    out[is_thing] = colours
    return np.asarray(out)


def plan(found: FrameResult, longest_m: float) -> Image.Image:
    """From above, the camera at the bottom, looking up."""
    picture = Image.new("RGB", (PLAN, PLAN), "white")
    draw = ImageDraw.Draw(picture)
    scale = (PLAN - 20) / longest_m

    def at(points: Floats) -> list[tuple[float, float]]:
        return [(PLAN / 2 - scale * y, PLAN - 10 - scale * x) for x, y in points]

    for metre in range(1, int(longest_m) + 1):
        level = PLAN - 10 - scale * metre
        draw.line([(0, level), (PLAN, level)], (225, 225, 225))
        draw.text((3, level - 12), f"{metre} m", GREY)
    if len(found.objects.view) > 2:
        draw.polygon(at(found.objects.view), SEEN)
    for k, one in enumerate(found.objects.detections):
        draw.polygon(at(one.polygon), COLOURS[k % len(COLOURS)], INK)
    for wall in found.objects.walls:
        draw.line(at(wall.reshape(2, 2)), INK, 3)
    return picture


def picture_of(frame: Frame) -> Image.Image:
    image, steps = image_of(frame), FrameSteps(frame.settings)
    found = steps.find(image, pose_of(frame), np.zeros((0, 4)))
    kinds = steps.room.kinds
    longest_m = min(frame.settings.max_range_m, 1.1 * float(image.numbers.max()) / 1000.0)
    parts = by_range(image, longest_m), by_kind(kinds), by_object(frame, image, found, kinds)
    whole = Image.new("RGB", (SMALL[0] * 2 + PLAN + 20, PLAN), "white")
    for k, part in enumerate(parts):
        place = (SMALL[0] + 5) * (k % 2), (SMALL[1] + 5) * (k // 2)
        whole.paste(Image.fromarray(part).resize(SMALL, Image.Resampling.NEAREST), place)
    whole.paste(plan(found, longest_m), (2 * SMALL[0] + 20, 0))
    return whole


def main(arguments: Sequence[str]) -> int:
    names = []
    for frame in FRAMES:
        if not arguments or frame.file in arguments:
            names.append(f"objects-{frame.file.replace('_', '-')}.png")
            picture_of(frame).save(PICTURES / names[-1], optimize=True)
    record(names, "make objects", MADE_OF)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
