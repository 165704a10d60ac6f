"""How walls go on: beyond the ends that are known of them, and round their ends.

A map has of a wall what was seen of it. What lies on its line is wall, too: next to what is known,
behind a shelf, or beyond a door. What stands out of the line is none, nor what hangs together with
that: a person in a door. A wall has a thickness, so at its end, behind its line, lies its end face.

Source: docs/objects.md, section 5.
"""

import math

import numpy as np

from core.objects.frame.pixels import GATE, I32, sigma_m
from core.objects.frame.voxels import Voxels
from core.records import F32, F64
from jit import kernel, releasing_kernel

BINS = 256  # along a wall
# bits of a bin: points on the line, out of it, behind it as an end face is, and of a wall
ON, OUT, BEHIND, TAKEN = 1, 2, 4, 8
PIECE_M = 0.2  # shorter pieces farther along a known line are not taken for wall
THICK_M = 0.25  # so deep behind its line the face at a wall's end may be
FACE_BINS = 2  # at each end of a run
Two = tuple[float, float]


@kernel
def _goes_on(walls: F64, k: int, end: Two, u: Two, within_m: float) -> bool:
    """Whether another wall goes on along this line beyond an end: an opening lies between."""
    for j in range(walls.shape[0]):
        ax, ay, bx, by = walls[j, 0], walls[j, 1], walls[j, 2], walls[j, 3]
        ax, ay, bx, by = ax - end[0], ay - end[1], bx - end[0], by - end[1]
        is_aside = abs(u[0] * ay - u[1] * ax) > within_m or abs(u[0] * by - u[1] * bx) > within_m
        if j != k and not is_aside and min(u[0] * ax + u[1] * ay, u[0] * bx + u[1] * by) > 0.0:
            return True
    return False


@kernel
def _reach(
    voxels: Voxels, count: int, end: Two, u: Two, offset: F64, within_m: float,
    noise: tuple[float, float, float], gap_m: float, used: I32, bins: I32,
) -> float:  # fmt: skip
    """How far points go on beyond an end, m: until a gap, or until something stands out."""
    bins[:] = 0
    for v in range(count):
        x, y, z = voxels.x[v], voxels.y[v], voxels.z[v] - noise[2]
        dx = x + offset[0] - offset[2] * y - end[0]
        dy = y + offset[1] + offset[2] * x - end[1]
        along, e = u[0] * dx + u[1] * dy, abs(u[0] * dy - u[1] * dx)
        if along < 0.0:
            continue  # most of them
        gate = within_m + GATE * sigma_m(math.sqrt(x * x + y * y + z * z), noise[0], noise[1])
        at = int(2.0 * along / gap_m)
        if at >= BINS or e > gate + gap_m:
            continue
        if e <= gate:
            bins[at] |= ON
        elif used[v] == 0:
            bins[at] |= OUT
    last = -1
    for at in range(BINS):
        if bins[at] & OUT or at - last > 2:
            break
        if bins[at] & ON:
            last = at
    return 0.5 * gap_m * (last + 1)


@releasing_kernel
def grow(
    voxels: Voxels, count: int, walls: F64, offset: F64, within_m: float,
    noise: tuple[float, float, float], gaps_m: F64, used: I32, bins: I32,
) -> None:  # fmt: skip
    """Lengthen walls (n, 4), in place, as far as points go on: a map has of a wall what was seen.

    What stands out of the line ends it: a person in a door is no wall. But not where `used` has
    another wall's points: a corner. Where the line goes on as another wall, it does not grow.

    Args:
        offset: (3,) dx, dy, dyaw to be added to the points.
        gaps_m: (walls, 2) the widest gap beyond each end.
        used: (count,) not 0: of a wall.
        bins: (BINS,), room.
    """
    for k in range(walls.shape[0]):
        for side in range(2):
            a, b = 2 * side, 2 - 2 * side
            end = (walls[k, a], walls[k, a + 1])
            ux, uy = end[0] - walls[k, b], end[1] - walls[k, b + 1]
            length = math.sqrt(ux * ux + uy * uy)
            u = (ux / length, uy / length)
            if _goes_on(walls, k, end, u, within_m):
                continue
            gap_m = gaps_m[k, side]
            by = _reach(voxels, count, end, u, offset, within_m, noise, gap_m, used, bins)
            walls[k, a], walls[k, a + 1] = end[0] + by * u[0], end[1] + by * u[1]


@kernel
def _take_runs(bins: I32, tall: F32, width_m: float, height_m: float, lens_at: int) -> int:
    """Mark the bins of runs that are pieces of a wall: how many bins.

    A run has gaps of a bin at most, and nothing that stands out of it, also beside its ends, but
    the end face on the lens's side, which is before bin `lens_at`: what shows both its flanks is
    round. Half of its bins are filled over the height.
    """
    taken, first, last, high, is_clear = 0, -1, -3, 0, True
    for at in range(BINS + 3):
        flags = bins[at] if at < BINS else 0
        if first >= 0 and at - last > 2:
            count = last + 1 - first
            begin = first + FACE_BINS if lens_at < first else first
            behind = last + 1 - FACE_BINS if lens_at > last else last + 1
            for k in range(begin, behind):
                is_clear = is_clear and bins[k] & BEHIND == 0
            if is_clear and count * width_m >= PIECE_M and 2 * high >= count:
                for k in range(first, last + 1):
                    bins[k] |= TAKEN
                taken += count
            first = -1
        if flags & ON:
            if first < 0:
                first, high = at, 0
                is_clear = at == 0 or bins[at - 1] & OUT == 0
            last, high = at, high + (tall[at] >= height_m)
        if flags & OUT:
            is_clear = False
    return taken


@releasing_kernel
def take_further(
    voxels: Voxels, count: int, walls: F64, offset: F64, within_m: float, height_m: float,
    noise: tuple[float, float, float], gaps_m: F64, used: I32, bins: I32, low: F32, tall: F32,
) -> None:  # fmt: skip
    """Give known walls what lies farther along their lines: behind a shelf, or beyond a door.

    Args:
        height_m: over which a piece must be filled.
        used: (count,) the number of its wall, from 1; written.
        low, tall: room, (BINS,).
    """
    for k in range(walls.shape[0]):
        ux, uy = walls[k, 2] - walls[k, 0], walls[k, 3] - walls[k, 1]
        length = math.sqrt(ux * ux + uy * uy)
        ux, uy, gap_m = ux / length, uy / length, max(gaps_m[k, 0], gaps_m[k, 1])
        lens_m = uy * (walls[k, 0] - offset[0]) - ux * (walls[k, 1] - offset[1])
        per_bin, middle = 2.0 / gap_m, 0.5 * (BINS - 2.0 * length / gap_m)
        lens_along = ux * (offset[0] - walls[k, 0]) + uy * (offset[1] - walls[k, 1])
        lens_at = math.floor(per_bin * lens_along + middle)
        for turn in range(2):
            if turn == 0:
                bins[:] = 0
                low[:BINS], tall[:BINS] = np.float32(1e9), np.float32(-1e9)
            for v in range(count):
                if used[v] != 0:
                    continue
                x, y, z = voxels.x[v], voxels.y[v], voxels.z[v] - noise[2]
                dx = x + offset[0] - offset[2] * y - walls[k, 0]
                dy = y + offset[1] + offset[2] * x - walls[k, 1]
                at, e = int(per_bin * (ux * dx + uy * dy) + middle), ux * dy - uy * dx
                is_behind, e = e * lens_m < 0.0, abs(e)
                far_m = math.sqrt(x * x + y * y + z * z)
                gate = within_m + GATE * sigma_m(far_m, noise[0], noise[1])
                if at < 0 or at >= BINS or e > gate + gap_m:
                    continue
                if turn == 1:
                    if e <= gate and bins[at] & TAKEN:
                        used[v] = k + 1
                elif e <= gate:
                    bins[at] |= ON
                    low[at], tall[at] = min(low[at], voxels.low[v]), max(tall[at], voxels.high[v])
                else:
                    bins[at] |= BEHIND if is_behind else OUT
            if turn == 0:
                for at in range(BINS):
                    tall[at] -= low[at]
                if _take_runs(bins, tall, 0.5 * gap_m, height_m, lens_at) == 0:
                    break


@releasing_kernel
def take_end_faces(voxels: Voxels, count: int, walls: F64, within_m: float, used: I32) -> None:
    """Mark what is seen behind a wall's line right at an end that turns to the lens: door jambs.

    Args:
        walls: (n, 4) segments as this frame saw them, level frame; the lens is over its origin.
        used: (count,) not 0: of a wall; written.
    """
    for k in range(walls.shape[0]):
        ax, ay = walls[k, 0], walls[k, 1]
        ux, uy = walls[k, 2] - ax, walls[k, 3] - ay
        length = math.sqrt(ux * ux + uy * uy)
        lens_m = (uy * ax - ux * ay) / max(length, within_m)  # to the left of the line
        if abs(lens_m) <= within_m:
            continue  # along its line neither side is before it
        ux, uy, behind = ux / length, uy / length, -1.0 if lens_m > 0.0 else 1.0
        lens_along, near_m = -(ux * ax + uy * ay), 2.0 * within_m
        for v in range(count):
            dx, dy = voxels.x[v] - ax, voxels.y[v] - ay
            along, deep = ux * dx + uy * dy, behind * (ux * dy - uy * dx)
            is_first = abs(along) <= near_m and lens_along < near_m
            is_last = abs(along - length) <= near_m and lens_along > length - near_m
            if used[v] == 0 and 0.0 < deep <= THICK_M and (is_first or is_last):
                used[v] = 1
