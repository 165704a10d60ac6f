"""Walls: those of a map found again and taken away, long upright planes told as new ones.

A known wall's points lie within its gate. All of them together tell how far the pose is off, by
robust least squares with the pose's own sigmas as knowledge:

    e = n . (p - q) + n . (dx, dy) + dyaw n . J (p - o)     J: a quarter turn to the left

A new wall is a line of columns that are filled up to some height, found by MSAC, refined, and as
long as the settings ask without a gap.

Source: docs/objects.md, section 5.
"""

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from core.objects.frame.floor import SEED, SHARED
from core.objects.frame.pixels import GATE, I32, sigma_m
from core.objects.frame.voxels import Voxels
from core.objects.frame.wall_ends import BINS, grow
from core.objects.records import Floats
from core.pose_fix import GATE2
from core.records import F32, F64
from jit import releasing_kernel

TRIES = 200  # lines tried for one wall
MOST_WALLS = 6  # new ones of a frame
GAP_M = 0.3  # longest without points, within a wall
SHORT_M = 0.1  # shorter stretches of a known wall are not told,
STRAIGHT_M = 1.0  # and of shorter ones no slope: noise would turn them
ROUNDS = 4


class Correction(NamedTuple):
    """What the walls say of the pose: to be added to it, in the map frame."""

    x_m: float
    y_m: float
    yaw_rad: float
    covariance: F64  # (3, 3) of these three, with what was known before in it
    points: int  # voxels on known walls


@releasing_kernel
def add_row(row: tuple[float, float, float], off_m: float, w: float, N: F64, g: F64) -> None:
    """One equation of least squares into the upper half of N (3, 3) and into g (3,)."""
    for a in range(3):
        for b in range(a, 3):
            N[a, b] += w * row[a] * row[b]
        g[a] += w * off_m * row[a]


@releasing_kernel
def on_known(
    voxels: Voxels, count: int, lines: F64, sigmas: tuple[float, float], offset: F64,
    is_first: bool, within_m: float, noise: tuple[float, float, float], N: F64, g: F64, used: I32,
) -> int:  # fmt: skip
    """Sums of one round of least squares over the voxels near known walls: how many.

    Args:
        lines: (n, 6) of the walls, by `line_of`, level frame.
        sigmas: of x or y, and of yaw.
        offset: (3,) dx, dy, dyaw so far; at first all 0.
        is_first: the pose is not corrected yet, and the gate wide.
        within_m: how far a wall's points lie off it.
        noise: noise_m, noise_per_m2, the lens's height.
        N, g: (3, 3) and (3,), added to.
        used: (count,) the number of its wall for each of these, from 1; 0: none.
    """
    found = 0
    for v in range(count):
        used[v] = 0
        x, y, z = voxels.x[v], voxels.y[v], voxels.z[v] - noise[2]
        r2 = x * x + y * y
        sigma = sigma_m(math.sqrt(r2 + z * z), noise[0], noise[1])
        gate = within_m + GATE * sigma
        slack = GATE * (sigmas[0] + math.sqrt(r2) * sigmas[1])
        px = x + offset[0] - offset[2] * y
        py = y + offset[1] + offset[2] * x
        best, nx, ny, at = gate + slack if is_first else gate, 0.0, 0.0, 0
        for k in range(lines.shape[0]):
            qx, qy, ux, uy = px - lines[k, 0], py - lines[k, 1], lines[k, 2], lines[k, 3]
            along, e = ux * qx + uy * qy, -uy * qx + ux * qy
            if abs(e) < abs(best) and -slack <= along <= lines[k, 5] + slack:
                best, nx, ny, at = e, -uy, ux, k
        if nx == 0.0 and ny == 0.0:
            continue
        found, used[v] = found + 1, at + 1
        turn = -nx * y + ny * x
        w = 1.0 / (sigma * sigma + (0.5 * within_m) ** 2)
        s = within_m + GATE * sigma
        w *= 1.0 / (1.0 + (best / s) ** 2)  # Cauchy: what is far off says little
        add_row((nx, ny, turn), best, w, N, g)
    return found


def refound(
    voxels: Voxels, count: int, walls: F64, sigmas: tuple[float, float],
    within_m: float, noise: tuple[float, float, float], gaps_m: F64, used: I32, bins: I32,
) -> tuple[F64, F64, int]:  # fmt: skip
    """How far points must be moved to lie on the walls (3,), its covariance, how many do so.

    Not at all where that would be farther than the pose can be off: these are other walls then.

    Args:
        walls: (n, 4) segments, level frame; lengthened by `grow`.
    """
    prior = np.diag([sigmas[0] ** -2.0, sigmas[0] ** -2.0, sigmas[1] ** -2.0])
    offset, found, C = np.zeros(3), 0, np.linalg.inv(prior)
    lines = np.array([line_of(wall) for wall in walls])
    for number in range(ROUNDS + 1):
        N, g = np.zeros((3, 3)), np.zeros(3)
        is_first = number == 0
        if number == ROUNDS and float(offset @ prior @ offset) > GATE2:
            offset, C = np.zeros(3), np.linalg.inv(prior)
        found = on_known(
            voxels, count, lines, sigmas, offset, is_first, within_m, noise, N, g, used
        )
        if number == ROUNDS:
            break
        whole = (N + np.triu(N, 1).T) / (1.0 + SHARED * SHARED * found)
        g /= 1.0 + SHARED * SHARED * found
        C = np.asarray(np.linalg.inv(whole + prior), np.float64)
        offset = offset - C @ (g + prior @ offset)
        if is_first:
            grow(voxels, count, walls, offset, within_m, noise, gaps_m, used, bins)
            lines = np.array([line_of(wall) for wall in walls])
    return offset, C, found


def stretches(voxels: Voxels, count: int, walls: F64, offset: F64, used: I32) -> Floats:
    """Where known walls were met: segments (n, 4) as the frame saw them, level frame.

    Of each stretch without a gap its own distance to the wall, and of a long one its own slope.

    Args:
        offset, used: as `refound` left them.
    """
    on = np.flatnonzero(used[:count])
    x, y = voxels.x[on].astype(np.float64), voxels.y[on].astype(np.float64)
    x, y = x + offset[0] - offset[2] * y, y + offset[1] + offset[2] * x
    found, wall_of = list[Floats](), used[on]
    for k in np.unique(wall_of):
        start, end = walls[k - 1, :2], walls[k - 1, 2:]
        u = (end - start) / math.dist(start, end)
        n = np.array([-u[1], u[0]])
        dx, dy = x[wall_of == k] - start[0], y[wall_of == k] - start[1]
        along, aside = u[0] * dx + u[1] * dy, n[0] * dx + n[1] * dy
        order = np.argsort(along)
        along, aside = along[order], aside[order]
        edges = np.flatnonzero(np.diff(along) > GAP_M) + 1
        for begin, behind in pairwise([0, *edges.tolist(), len(along)]):
            first, last = float(along[begin]), float(along[behind - 1])
            if last - first < SHORT_M:
                continue
            t, e = along[begin:behind], aside[begin:behind]
            middle, slope = t.mean(), 0.0
            if last - first >= STRAIGHT_M:
                slope = ((t - middle) * e).sum() / np.square(t - middle).sum()
            for at in (first, last):
                found.append(start + at * u + (e.mean() + slope * (at - middle)) * n)
    ends = np.array(found).reshape(-1, 2) - offset[:2]
    ends = ends + offset[2] * np.column_stack([ends[:, 1], -ends[:, 0]])
    return np.asarray(ends.reshape(-1, 4))


@releasing_kernel
def best_line(
    x: F32, y: F32, taken: I32, count: int, within_m: float, length_m: float, bins: I32, out: F64
) -> int:
    """The line on which most columns lie, as `out` (6,): point, direction, begin, end along it.

    Args:
        taken: (count,) not 0: not looked at.
    """
    state, most = SEED, 0
    out[4], out[5] = 0.0, 0.0
    for _ in range(TRIES):
        state = (state * 1103515245 + 12345) & 0x7FFFFFFF
        p = (state >> 8) % count
        state = (state * 1103515245 + 12345) & 0x7FFFFFFF
        q = (state >> 8) % count
        ux, uy = x[q] - x[p], y[q] - y[p]
        length = math.sqrt(ux * ux + uy * uy)
        if length < 0.3 * length_m or taken[p] != 0 or taken[q] != 0:
            continue
        ux, uy, near = ux / length, uy / length, 0
        for k in range(count):
            e = uy * (x[k] - x[p]) - ux * (y[k] - y[p])
            near += taken[k] == 0 and abs(e) <= within_m
        if near > most:
            most, out[0], out[1], out[2], out[3] = near, x[p], y[p], ux, uy
    if most >= 3:
        for _ in range(ROUNDS):
            _straighten(x, y, taken, count, within_m, out)
        _longest_run(x, y, taken, count, within_m, bins, out)
    return most


@releasing_kernel
def _straighten(x: F32, y: F32, taken: I32, count: int, within_m: float, line: F64) -> None:
    """Total least squares of the columns near a line."""
    n, sx, sy, sxx, sxy, syy = 0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(count):
        dx, dy = x[k] - line[0], y[k] - line[1]
        if taken[k] == 0 and abs(line[3] * dx - line[2] * dy) <= within_m:
            n, sx, sy = n + 1, sx + dx, sy + dy
            sxx, sxy, syy = sxx + dx * dx, sxy + dx * dy, syy + dy * dy
    if n < 2:
        return
    mx, my = sx / n, sy / n
    sxx, sxy, syy = sxx / n - mx * mx, sxy / n - mx * my, syy / n - my * my
    angle = 0.5 * math.atan2(2.0 * sxy, sxx - syy)
    line[0], line[1] = line[0] + mx, line[1] + my
    line[2], line[3] = math.cos(angle), math.sin(angle)


@releasing_kernel
def _longest_run(
    x: F32, y: F32, taken: I32, count: int, within_m: float, bins: I32, line: F64
) -> None:
    """Begin and end of the longest stretch of a line without a gap."""
    bins[:] = 0
    width = GAP_M / 3.0
    for k in range(count):
        dx, dy = x[k] - line[0], y[k] - line[1]
        if taken[k] == 0 and abs(line[3] * dx - line[2] * dy) <= within_m:
            at = int((line[2] * dx + line[3] * dy) / width + 0.5 * BINS)
            if 0 <= at < BINS:
                bins[at] += 1
    best, begin, last, first = 0, 0, -100, 0
    for at in range(BINS):
        if bins[at] == 0:
            continue
        if at - last > 3:
            begin = at
        last = at
        if at + 1 - begin > best:
            best, first = at + 1 - begin, begin
    low, high = math.inf, -math.inf
    for k in range(count):
        dx, dy = x[k] - line[0], y[k] - line[1]
        if taken[k] == 0 and abs(line[3] * dx - line[2] * dy) <= within_m:
            along = line[2] * dx + line[3] * dy
            if first <= int(along / width + 0.5 * BINS) < first + best:
                low, high = min(low, along), max(high, along)
    line[4], line[5] = (low, high) if low < high else (0.0, 0.0)


@releasing_kernel
def upright(
    voxels: Voxels, count: int, column_of: I32, columns: int, height_m: float,
    low: F32, high: F32, mean: F32, x: F32, y: F32,
) -> int:  # fmt: skip
    """Middles of the columns that are filled over a height: how many, in `x` and `y`.

    Args:
        column_of: (count,) of each voxel, negative: none.
        low, high, mean: room, (columns,), (columns,) and (columns, 3).
    """
    for c in range(columns):
        low[c], high[c] = 1e9, -1e9
        mean[c, 0], mean[c, 1], mean[c, 2] = 0.0, 0.0, 0.0
    for v in range(count):
        c = column_of[v]
        if c >= 0:
            low[c], high[c] = min(low[c], voxels.low[v]), max(high[c], voxels.high[v])
            mean[c, 0] += voxels.x[v]
            mean[c, 1] += voxels.y[v]
            mean[c, 2] += 1.0
    n = 0
    for c in range(columns):
        if high[c] - low[c] >= height_m:
            x[n], y[n] = mean[c, 0] / mean[c, 2], mean[c, 1] / mean[c, 2]
            n += 1
    return n


@releasing_kernel
def take(x: F32, y: F32, count: int, line: F64, within_m: float, used: I32, number: int) -> int:
    """Mark the points on a stretch of a line, or a little beyond, by its number: how many anew."""
    n, beyond = 0, 2.0 * within_m
    for v in range(count):
        dx, dy = x[v] - line[0], y[v] - line[1]
        along = line[2] * dx + line[3] * dy
        is_near = abs(line[3] * dx - line[2] * dy) <= within_m
        if is_near and line[4] - beyond <= along <= line[5] + beyond:
            n += used[v] == 0
            used[v] = number
    return n


@releasing_kernel
def release_fronts(
    voxels: Voxels, count: int, walls: F64, first: int, offset: F64, flat_m: float,
    noise: tuple[float, float, float], used: I32,
) -> None:  # fmt: skip
    """Give back what stands out of walls towards the lens: posts, pipes, the edges of things.

    A wall's own points lie before its line no farther than the wall is uneven, and their noise.

    Args:
        walls: (n, 4) segments, level frame; the lens is over its origin.
        first: the number of the first of them.
        offset: (3,) dx, dy, dyaw to be added to the points.
        flat_m: how far a wall's points lie before its line, without noise.
        used: (count,) the number of its wall for each of these; 0 where it is given back.
    """
    for v in range(count):
        k = used[v] - first
        if k < 0 or k >= walls.shape[0]:
            continue
        x, y, z = voxels.x[v], voxels.y[v], voxels.z[v] - noise[2]
        ux, uy = walls[k, 2] - walls[k, 0], walls[k, 3] - walls[k, 1]
        length = max(math.sqrt(ux * ux + uy * uy), 1e-9)
        ux, uy = ux / length, uy / length
        px = x + offset[0] - offset[2] * y - walls[k, 0]
        py = y + offset[1] + offset[2] * x - walls[k, 1]
        lens_m = uy * (walls[k, 0] - offset[0]) - ux * (walls[k, 1] - offset[1])
        if abs(lens_m) <= flat_m:
            continue  # along its line neither side is before it
        before_m = math.copysign(1.0, lens_m) * (ux * py - uy * px)
        if before_m > flat_m + GATE * sigma_m(math.sqrt(x * x + y * y + z * z), noise[0], noise[1]):
            used[v] = 0


def segment(line: F64) -> Floats:
    """x1, y1, x2, y2 of a stretch of a line."""
    begin, end = line[:2] + line[4] * line[2:4], line[:2] + line[5] * line[2:4]
    return np.concatenate([begin, end])


def line_of(wall: Floats) -> F64:
    """A segment (4,) as `take` wants a line: (6,) point, direction, begin and end along it."""
    length = math.dist(wall[:2], wall[2:])
    return np.array([*wall[:2], *(wall[2:] - wall[:2]) / length, 0.0, length])
