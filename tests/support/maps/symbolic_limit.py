"""Where a beam ends, in symbols: from range, beam angle, and how body and mount lie, to the map.

The one source of the derivatives that `core/mapping/certainty/limit.py` has in closed form.
"""

import math
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

F64 = npt.NDArray[np.float64]
sympy: Any = pytest.importorskip("sympy", reason="the derivatives are checked by symbols")

NAMES = "r phi x y d_z yaw pitch roll"
MOUNT = "mount_x mount_y mount_z mount_roll mount_tilt mount_yaw"


def turn(roll: Any, pitch: Any, yaw: Any) -> Any:
    """Roll about x, then pitch about y, then yaw about z."""
    (sr, cr), (sp, cp), (sy, cy) = (
        (sympy.sin(angle), sympy.cos(angle)) for angle in (roll, pitch, yaw)
    )
    about_x = sympy.Matrix([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = sympy.Matrix([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = sympy.Matrix([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return about_z * about_y * about_x


@cache
def slopes() -> Any:
    """Function of all values, in order, to the derivatives (3, 8) of a reading's x, y, z."""
    r, phi, x, y, d_z, yaw, pitch, roll = variables = sympy.symbols(NAMES)
    m_x, m_y, m_z, m_roll, m_tilt, m_yaw = mounts = sympy.symbols(MOUNT)
    beam = sympy.Matrix([r * sympy.cos(phi), r * sympy.sin(phi), 0])
    in_body = sympy.Matrix([m_x, m_y, m_z]) + turn(m_roll, m_tilt, m_yaw) * beam
    place = sympy.Matrix([x, y, d_z]) + turn(roll, pitch, yaw) * in_body
    return sympy.lambdify([*variables, *mounts], place.jacobian(variables), "numpy")


def slopes_in_a_cell(values: dict[str, float]) -> dict[str, float]:
    """What z changes with each, while x and y of the reading stay; of r and phi, by themselves."""
    names = NAMES.split()
    of = np.asarray(slopes()(*(values[name] for name in [*names, *MOUNT.split()])), float)
    follow = np.linalg.solve(of[:2, :2], of[:2, 2:])  # r and phi go along so much
    held = of[2, 2:] - of[2, :2] @ follow
    found = dict(zip(names, [*of[2, :2], *held], strict=True))
    assert all(map(math.isfinite, found.values()))
    return {name: float(slope) for name, slope in found.items()}
