"""Kernels of the fake camera: planes between rays, and what a sensor of time of flight errs.

An error is a share of the light: what returns from near walls over a second way makes ranges longer
in corners; a pixel that sees an edge gets a range between; noise grows as the light gets less.
"""

import math

import numpy as np
import numpy.typing as npt

from fakes.rays.kernels import BLACK, F64, I64
from jit import kernel

F32 = npt.NDArray[np.float32]
U16 = npt.NDArray[np.uint16]
SAME = 1e-9  # by which normals of one plane may differ
EDGE_M = 0.05  # between neighbours, from which on there is an edge
BLACK_SHARE = 0.08  # of what others return
MIRROR_COS = 0.97  # shiny things return light to where it came from if it falls as steeply
MIRROR_REST = 0.01  # of their light that is dull
BASE_SIGMA_M, LIGHT_SIGMA_M = 0.0012, 0.0005  # noise: always; times 1 / amplitude ** 0.5
PROBES, PROBE_SHARE = 4, 0.055  # places around a pixel that shine on it; away, of a row's pixels
BLOCK_PX = 4  # of pixels that share what they shine
PROBE_M2 = 0.3  # of surface that each of them stands for
LEAST_GAP_M2 = 0.01
HASH = 2654435761


@kernel
def fill_planes(
    near: F64, normals: F64, solids: I64, materials: I64, every: int, width: int, height: int,
    ways: F64, far: F64, out_normals: F64, out_solids: I64, out_materials: I64, todo: I64,
) -> int:  # fmt: skip
    """Fill what lies between rays that met one plane; list the other pixels in `todo`.

    Args:
        near, normals, solids, materials: of a grid of rays, (m, k) of every so many pixels, and the
            last row and column.
        ways: (n, 3) of all pixels.
        far, out_normals, out_solids, out_materials: (n,) of all pixels; normals (n, 3).
        todo: (n,) takes their indices; returns how many they are.
    """
    count = 0
    rows, columns = near.shape
    for i in range(rows - 1):
        for j in range(columns - 1):
            is_one = solids[i, j] >= 0
            nothing = True
            for a in range(2):
                for b in range(2):
                    nothing = nothing and math.isinf(near[i + a, j + b])
                    is_one = is_one and solids[i + a, j + b] == solids[i, j]
                    for axis in range(3):
                        off = abs(normals[i + a, j + b, axis] - normals[i, j, axis])
                        is_one = is_one and off < SAME
            top, left = min(i * every, height - 1), min(j * every, width - 1)
            low = min(top + every, height) if i < rows - 2 else height
            right = min(left + every, width) if j < columns - 2 else width
            n0, n1, n2 = normals[i, j, 0], normals[i, j, 1], normals[i, j, 2]
            corner = ways[top * width + left]
            gap = near[i, j] * (n0 * corner[0] + n1 * corner[1] + n2 * corner[2])
            for v in range(top, low):
                for u in range(left, right):
                    p = v * width + u
                    if is_one:
                        far[p] = gap / (n0 * ways[p, 0] + n1 * ways[p, 1] + n2 * ways[p, 2])
                        out_normals[p, 0], out_normals[p, 1], out_normals[p, 2] = n0, n1, n2
                        out_solids[p], out_materials[p] = solids[i, j], materials[i, j]
                    elif nothing:
                        far[p], out_solids[p] = math.inf, -1
                    else:
                        todo[count] = p
                        count += 1
    return count


@kernel
def light_of(
    far: F64, normals: F64, solids: I64, materials: I64, ways: F64, reflectivity: float,
    shiny_share: float, seed: int, light: F64,
) -> None:  # fmt: skip
    """Fill light (n,): what returns of the camera's own, 1 from all of it 1 m away."""
    for p in range(len(far)):
        light[p] = 0.0
        if math.isinf(far[p]):
            continue
        cosine = abs(
            normals[p, 0] * ways[p, 0] + normals[p, 1] * ways[p, 1] + normals[p, 2] * ways[p, 2]
        )
        share = reflectivity * (BLACK_SHARE if materials[p] == BLACK else 1.0)
        if solids[p] >= 0 and shiny_share > 0.0:
            mixed = ((solids[p] + 1 + 977 * seed) * HASH) % 4294967296
            if mixed < shiny_share * 4294967296.0 and cosine < MIRROR_COS:
                share *= MIRROR_REST
        light[p] = share * cosine / max(1e-4, far[p] * far[p])


@kernel
def second_way_m(p: int, width: int, height: int, far: F64, normals: F64, ways: F64) -> float:
    """By how much light from places around makes a pixel's range longer."""
    v, u, away = p // width, p % width, 1 + int(PROBE_SHARE * width)
    x, y, z = far[p] * ways[p, 0], far[p] * ways[p, 1], far[p] * ways[p, 2]
    nx, ny, nz = normals[p, 0], normals[p, 1], normals[p, 2]
    share, extra = 0.0, 0.0
    for k in range(PROBES):
        row = v + away * ((k == 0) - (k == 1))
        column = u + away * ((k == 2) - (k == 3))
        if row < 0 or row >= height or column < 0 or column >= width:
            continue
        q = row * width + column
        if math.isinf(far[q]):
            continue
        dx, dy, dz = far[q] * ways[q, 0] - x, far[q] * ways[q, 1] - y, far[q] * ways[q, 2] - z
        gap2 = max(LEAST_GAP_M2, dx * dx + dy * dy + dz * dz)
        gap = math.sqrt(gap2)
        here = (nx * dx + ny * dy + nz * dz) / gap
        there = -(normals[q, 0] * dx + normals[q, 1] * dy + normals[q, 2] * dz) / gap
        if here > 0.02 and there > 0.02:  # they see each other
            part = here * there * PROBE_M2 / (math.pi * gap2)
            share += part
            extra += part * max(0.0, far[q] + gap - far[p]) / 2.0
    return extra / (1.0 + share)


@kernel
def second_ways(width: int, height: int, far: F64, normals: F64, ways: F64, longer: F64) -> None:
    """Fill `longer` (height / BLOCK_PX, width / BLOCK_PX) with that, of a pixel of each block."""
    for i in range(longer.shape[0]):
        for j in range(longer.shape[1]):
            row = min(height - 1, BLOCK_PX * i + BLOCK_PX // 2)
            p = row * width + min(width - 1, BLOCK_PX * j + BLOCK_PX // 2)
            is_met = not math.isinf(far[p])
            longer[i, j] = second_way_m(p, width, height, far, normals, ways) if is_met else 0.0


@kernel
def sense(
    far: F64, after: F64, solids: I64, longer: F64, light: F64, ways: F64, axis: F64, width: int,
    is_planar: bool, unit_m: float, noise: float, flying: float, multipath: float,
    ambiguity_m: float, least: float, has_states: bool, chance: F32, first: int,
    raw: U16, colour: U16, third: U16,
) -> None:  # fmt: skip
    """Fill the maps (n,) with what the sensor makes of ranges and light.

    Args:
        far, after: (n,) when the exposure begins and when it ends.
        longer: of `second_ways`.
        axis: (3,) the way of the camera's own.
        chance: (a power of two,) of unit variance, from `first` on.
    """
    mask = len(chance) - 1
    for p in range(len(far)):
        at = first + 3 * p
        draw = abs(chance[(at + 1) & mask])
        share = draw - math.floor(draw)
        range_m, seen = far[p], light[p]
        other = after[p]
        if abs(other - range_m) <= EDGE_M and p % width + 1 < width and p + width < len(far):
            q = p + 1 if abs(far[p + 1] - range_m) > EDGE_M else p + width
            is_one = solids[q] == solids[p] >= 0  # a floor that is seen flat has no edge
            other = range_m if is_one else far[q]
            draw = abs(chance[(at + 2) & mask])
            if draw - math.floor(draw) >= flying:
                other = range_m
        if abs(other - range_m) > EDGE_M and not math.isinf(other) and not math.isinf(range_m):
            range_m += share * (other - range_m)
        raw[p], colour[p], third[p] = 0, 0, 1 if has_states else 0
        if math.isinf(range_m) or seen <= 0.0:
            continue
        range_m += multipath * longer[p // width // BLOCK_PX, p % width // BLOCK_PX]
        sigma = BASE_SIGMA_M + LIGHT_SIGMA_M / math.sqrt(seen)
        range_m += noise * sigma * chance[at & mask]
        range_m = range_m % ambiguity_m if range_m > ambiguity_m else range_m
        depth = range_m
        if is_planar:
            depth *= ways[p, 0] * axis[0] + ways[p, 1] * axis[1] + ways[p, 2] * axis[2]
        number = math.floor(depth / unit_m + 0.5)
        colour[p] = np.uint16(min(20000.0, 40000.0 * seen))
        if 0 < number < 65535 and seen >= least / 4.0:
            raw[p] = np.uint16(number)
            if has_states:
                third[p] = 0 if seen >= least else 1
            else:
                third[p] = np.uint16(min(65535.0, 6553.6 * seen / least))
