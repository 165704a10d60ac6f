"""Floors by chance: rooms with furniture, ragged shapes, cells of a robot's map. Metres."""

import math

import numpy as np
import shapely
from shapely import affinity
from shapely.geometry.base import BaseGeometry

from core.paths.records import Machine

VACUUM = Machine(radius_m=0.15, clearance_m=0.0, width_m=0.3, overlap_m=0.0)


def rooms(seed: int) -> BaseGeometry:
    """Two rooms, a doorway, and boxes that may touch walls and each other."""
    chance = np.random.default_rng(seed)
    long, wide = chance.uniform(2.5, 5.0), chance.uniform(1.5, 3.0)
    wall, door = chance.uniform(1.0, long - 1.0), chance.uniform(0.1, wide - 0.9)
    floor = shapely.box(0, 0, long, wide).difference(shapely.box(wall, -1, wall + 0.1, wide + 1))
    floor = floor.union(shapely.box(wall - 0.01, door, wall + 0.11, door + 0.7))
    for _ in range(chance.integers(1, 7)):
        a, b = chance.uniform(0.03, 0.6, 2)
        x, y = chance.uniform(0, long), chance.uniform(0, wide)
        box = affinity.rotate(shapely.box(x, y, x + a, y + b), float(chance.choice([0, 0, 45])))
        floor = floor.difference(box)
    return affinity.rotate(floor, float(chance.choice([0, 12, 33])))


def ragged(seed: int) -> BaseGeometry:
    """A star that may have spikes, with round holes that may overlap it and each other."""
    chance = np.random.default_rng(seed)
    corners = int(chance.integers(3, 16))
    angles = np.sort(chance.uniform(0, 2 * math.pi, corners))
    radii = chance.uniform(0.4, 2.2, corners)
    star = shapely.Polygon(np.column_stack([radii * np.cos(angles), radii * np.sin(angles)]))
    floor = shapely.make_valid(star)
    for _ in range(chance.integers(0, 5)):
        hole = shapely.Point(chance.uniform(-1.5, 1.5, 2)).buffer(chance.uniform(0.005, 0.4))
        floor = floor.difference(hole)
    return floor


def cells(seed: int) -> BaseGeometry:
    """A ragged floor as a robot's map has it: cells of 5 cm, specks with them."""
    chance = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(-50, 50), np.arange(-50, 50))
    free = shapely.contains_xy(ragged(seed), 0.05 * x + 0.025, 0.05 * y + 0.025)
    free ^= chance.random(free.shape) < 0.003
    i, j = x[free], y[free]
    whole = shapely.union_all(shapely.box(5 * i, 5 * j, 5 * i + 5, 5 * j + 5))  # cm: exact
    return affinity.scale(whole, 0.01, 0.01, origin=(0, 0))


KINDS = {"rooms": rooms, "ragged": ragged, "cells": cells}
