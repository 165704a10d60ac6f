"""How bright things are to the fake camera: ambient light, and what surfaces return of any light.

Grey levels are those of an exposure of 1: a grey floor (0.5) under a lamp has GREY. All numbers are
ours: about 300 lux of a lamp, 900 by a window with pools of 7000, 60 000 in the sun.
"""

import math

import numpy as np

from fakes.rays.kernels import BLACK
from fakes.rays.sight import Met
from fakes.stripe.faults import Ambient
from fakes.wires.timing import F64

GREY, LAMP_LUX = 25.0, 300.0
WINDOW_LUX, POOL_LUX, SKY_LUX, SUN_LUX = 900.0, 7000.0, 8000.0, 60_000.0
POOL_EVERY_M, POOL_M, POOL_SLANT = 1.1, 0.35, 0.36
SUN_WAY = np.array([0.42, 0.35, 0.84])  # to the sun, map frame
BLACK_SHARE = 0.08  # of what others return
NOTHING = 0.1  # returned by what is too far to be met
TINT = 0.1  # by which the colours of things differ
WAVES = ((1.9, 0.7, 0.9), (-7.0, 11.0, 9.0), (31.0, 23.0, -37.0))  # of the texture, rad/m


def returned(met: Met, reflectivity: float, texture: float) -> F64:
    """Shares (n, 3) of blue, green and red light that places return."""
    phases = met.solids[:, None] * np.array([1.7, 2.9, 0.6])
    waves = np.sin(met.points @ np.array(WAVES).T + phases).mean(axis=1)
    shares = reflectivity * np.where(met.materials == BLACK, BLACK_SHARE, 1.0)
    shares = np.where(np.isfinite(met.ranges_m), shares * (1.0 + texture * waves), NOTHING)
    tints = 1.0 + TINT * np.sin(met.solids[:, None] * 2.3 + np.array([0.0, 2.1, 4.2]))
    return np.asarray(np.clip(shares[:, None] * tints, 0.0, 1.0))


def lux_at(met: Met, ambient: Ambient) -> F64:
    """Ambient light (n,) on places."""
    x, y, z = met.points.T
    upward = np.clip(met.normals[:, 2], 0.0, 1.0)
    if ambient == "dark":
        return np.zeros(len(x))
    if ambient == "lamp":
        return np.asarray(LAMP_LUX * (0.6 + 0.4 * upward) * (1.0 + 0.2 * np.sin(0.8 * x + 1.1 * y)))
    if ambient == "window":
        in_pool = np.mod(x + POOL_SLANT * y + 0.5 * z, POOL_EVERY_M) < POOL_M
        return np.where(in_pool & (upward > 0.5), POOL_LUX, WINDOW_LUX * (0.6 + 0.4 * upward))
    lit = np.clip(met.normals @ SUN_WAY, 0.0, 1.0) / math.sqrt(SUN_WAY @ SUN_WAY)
    return np.asarray(SKY_LUX + SUN_LUX * lit)


def levels_from(met: Met, ambient: Ambient, reflectivity: float, texture: float) -> F64:
    """Grey levels (n, 3) of blue, green, red, without an end."""
    lux = lux_at(met, ambient)[:, None]
    return np.asarray(GREY / (LAMP_LUX * 0.5) * lux * returned(met, reflectivity, texture))
