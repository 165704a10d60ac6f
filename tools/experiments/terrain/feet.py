"""What a planner gets of a map: heights filled in, the best footholds, free cells; and the truth.

A foot stands safely where nothing under it lies higher or lower than its middle by more than a step
of the foot that the layers of the map mean, whatever the map says of it.
"""

import math
from typing import NamedTuple

import numpy as np

from core.mapping.footing import USUAL, Ground, footing_of
from core.mapping.layers import flat_of, maybe_values
from core.mapping.method import Maps
from core.records import F64, FREE
from fakes.scenes.scene import Scene
from tools.experiments.terrain.measure import ARTEFACT_M, Truth, off_m, truth_of
from tools.experiments.terrain.methods import Region, bounds_m, heights_m

FEET = 10  # chosen on each map, apart from each other by two radii
SAMPLE_M = 0.005  # of the truth under a foot
SURE = 0.9  # quantile of errors by their sigmas; 1.64 of a normal distribution


class Filled(NamedTuple):
    """Of the cells of one map that were not measured."""

    unknown: float  # share of all cells
    filled: float  # share of those, for which a height is told all the same
    rms_m: float  # NaN in all of these where none is told
    too_high: float  # share of those, as artefacts are
    too_low: float
    off_sigmas: float  # the SURE quantile of errors by their sigmas; NaN: no sigma is told


class Feet(NamedTuple):
    """The best footholds of one map."""

    found: int  # of FEET
    safe: int
    worst_m: float  # largest true step under any of them; 0 where there is none


class Freed(NamedTuple):
    """Of the cells of one map that are told as free."""

    cells: int
    wrong: int  # of these: something in them lies at or beyond the bounds of floor


def values_m(maps: Maps, name: str, region: Region) -> F64:
    """A layer [j, i] of a region's cells; NaN: not known; a layer that it has not is NaN."""
    columns, rows = region.cells()
    i, j = (part.ravel() for part in np.meshgrid(columns, rows))
    told = maybe_values(maps, name, i, j)
    shape = len(rows), len(columns)
    return np.full(shape, np.nan) if told is None else told.reshape(shape)


def filled_figures(measured_m: F64, told_m: F64, sigma_m: F64, truth: Truth) -> Filled:
    """All [j, i]; sigma_m: NaN where none is told."""
    unknown = np.isnan(measured_m)
    new = unknown & np.isfinite(told_m)
    if not new.any():
        return Filled(float(unknown.mean()), 0.0, *(4 * [math.nan]))
    off = off_m(told_m, truth)[new]
    off_sigmas = np.abs(off) / sigma_m[new]
    return Filled(
        float(unknown.mean()),
        float(new.sum() / unknown.sum()),
        math.sqrt(float(np.mean(off**2))),
        float((off > ARTEFACT_M).mean()),
        float((off < -ARTEFACT_M).mean()),
        float(np.quantile(off_sigmas, SURE)),
    )


def freed(states: F64, truth: Truth) -> Freed:
    """Both [j, i]."""
    low_m, high_m = bounds_m()
    free = states == FREE
    wrong = free & ((truth.low_m <= low_m) | (truth.high_m >= high_m))
    return Freed(int(free.sum()), int(wrong.sum()))


def true_step_m(scene: Scene, x_m: float, y_m: float) -> float:
    """How far the ground under a foot about a place lies higher or lower than in its middle."""
    off_m = np.arange(-USUAL.radius_m, USUAL.radius_m + SAMPLE_M / 2, SAMPLE_M)
    dx_m, dy_m = (part.ravel() for part in np.meshgrid(off_m, off_m))
    under = np.hypot(dx_m, dy_m) <= USUAL.radius_m
    z_m = scene.height_at(x_m + dx_m[under], y_m + dy_m[under])
    [middle_m] = scene.height_at([x_m], [y_m])
    return float(np.abs(z_m - middle_m).max())


def feet_on(footholds: F64, sigmas_m: F64, scene: Scene, region: Region, seed: int) -> Feet:
    """The best footholds [j, i] are chosen, the surest first; no foot reaches over the region."""
    cell_m, (columns, rows) = region.cell_m, region.cells()
    x_m, y_m = ((cells + 0.5) * cell_m for cells in (columns, rows))
    inside_x, inside_y = (
        (part - low >= USUAL.radius_m) & (high - part >= USUAL.radius_m)
        for part, (low, high) in ((x_m, region.x_m), (y_m, region.y_m))
    )
    may = inside_y[:, None] & inside_x[None, :] & (np.nan_to_num(footholds) > 0.0)
    j, i = np.nonzero(may)
    chance = np.random.default_rng([seed, 13]).random(j.size)
    order = np.lexsort((chance, sigmas_m[may], -footholds[may]))
    chosen: list[tuple[float, float]] = []
    for x, y in zip(x_m[i[order]].tolist(), y_m[j[order]].tolist(), strict=True):
        is_apart = all(math.hypot(x - u, y - v) >= 2.0 * USUAL.radius_m for u, v in chosen)
        if len(chosen) < FEET and is_apart:
            chosen.append((x, y))
    steps_m = [true_step_m(scene, x, y) for x, y in chosen]
    safe = sum(step_m <= USUAL.step_m for step_m in steps_m)
    return Feet(len(chosen), safe, max(steps_m, default=0.0))


def footholds_of(z_m: F64, maps: Maps, region: Region) -> F64:
    """Footholds [j, i] on heights [j, i] that are taken as they are, whatever tells them."""
    source = maps.maybe_ground()
    assert source is not None
    grid = source.grid
    columns, rows = region.cells()
    i, j = (part.ravel() for part in np.meshgrid(columns, rows))
    at = flat_of(grid, i, j)
    all_m = np.full(grid.size**2, np.nan)
    all_m[at] = z_m.ravel()
    square_m = all_m.reshape(grid.size, grid.size)
    ground = Ground(grid, square_m, square_m, np.zeros(square_m.shape))
    return footing_of("foothold", ground, at, USUAL).reshape(z_m.shape)


class Walked(NamedTuple):
    """Of one map: what it fills in, by itself, and frees; its feet, by what they are chosen."""

    filled: Filled
    freed: Freed
    feet: dict[str, Feet]


MEASURED, ALL_HEIGHTS, TRUE = "measured", "with what is filled in", "the true heights"


def walked(maps: Maps, measured_m: F64, scene: Scene, region: Region, seed: int) -> Walked:
    """measured_m [j, i]: the heights of its cells that beams met."""
    truth = truth_of(scene, region)
    told_m, sigma_m = (values_m(maps, name, region) for name in ("filled", "filled_sigma"))
    footholds, sigmas_m = (values_m(maps, name, region) for name in ("foothold", "foothold_sigma"))
    if np.isnan(told_m).all():  # its fill tells no sigma: it is taken as it is
        told_m = heights_m(maps, region)
        footholds, sigmas_m = footholds_of(told_m, maps, region), np.zeros(told_m.shape)
    nothing = np.zeros(told_m.shape)
    by = {
        MEASURED: (footholds_of(measured_m, maps, region), nothing),
        ALL_HEIGHTS: (footholds, sigmas_m),
        TRUE: (footholds_of(truth.high_m, maps, region), nothing),
    }
    feet = {name: feet_on(*given, scene, region, seed) for name, given in by.items()}
    filled = filled_figures(measured_m, told_m, sigma_m, truth)
    return Walked(filled, freed(values_m(maps, "state", region), truth), feet)
