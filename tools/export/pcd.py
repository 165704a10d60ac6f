"""Point clouds as PCD 0.7 files, which the Point Cloud Library, CloudCompare and Open3D read.

Source: pointclouds.org, documentation, The PCD file format.
"""

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("t", "<f8")])
KINDS = {"f": "F", "i": "I", "u": "U"}


def header(count: int, data: str) -> str:
    """Of so many points; `data` is "ascii" or "binary"."""
    kinds = [POINT[name] for name in POINT.names or ()]
    lines = [
        "# .PCD v0.7 - Point Cloud Data file format",
        "VERSION 0.7",
        f"FIELDS {' '.join(POINT.names or ())}",
        f"SIZE {' '.join(str(kind.itemsize) for kind in kinds)}",
        f"TYPE {' '.join(KINDS[kind.kind] for kind in kinds)}",
        f"COUNT {' '.join('1' for _ in kinds)}",
        f"WIDTH {count}",
        "HEIGHT 1",
        "VIEWPOINT 0 0 0 1 0 0 0",
        f"POINTS {count}",
        f"DATA {data}",
    ]
    return "\n".join(lines) + "\n"


def points_from(xyz: npt.NDArray[Any], t_s: float) -> npt.NDArray[Any]:
    """(n, 3) places of one instant as records."""
    points = np.zeros(len(xyz), POINT)
    points["x"], points["y"], points["z"] = xyz.T
    points["t"] = t_s
    return points


def write_pcd(path: Path, points: npt.NDArray[Any], is_ascii: bool) -> None:
    with path.open("wb") as file:
        file.write(header(len(points), "ascii" if is_ascii else "binary").encode("ascii"))
        if is_ascii:
            np.savetxt(file, points, fmt="%.6g %.6g %.6g %.6f")
        else:
            file.write(points.tobytes())
