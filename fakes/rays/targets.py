"""A scene's solids as the rays' kernels want them: upright boxes and cylinders, convex bodies.

They are taken from what MuJoCo makes of them, so that beams meet what wheels roll on.
"""

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from fakes.rays.kernels import BLACK, BOX, CYLINDER, F64, GLASS, HULL, PLAIN, Targets
from fakes.scenes.solids import Shape, mjcf_from_solids

mj: Any = mujoco  # compiled: it comes without types
MATERIALS = {"plain": PLAIN, "black": BLACK, "glass": GLASS}
SAME = 1e-5  # planes that differ by less are one: MuJoCo keeps corners as single floats
UPRIGHT = 1e-9  # of how far an upright body's axis may lean, cosines

MODEL = """
<mujoco>
  <default><default class="scene"><geom group="0"/></default></default>
  <asset>{assets}</asset>
  <worldbody>{geoms}</worldbody>
</mujoco>
"""


def targets_from(solids: Sequence[Shape]) -> Targets:
    """What the kernels need of solids that return beams, in their order."""
    assets, geoms = mjcf_from_solids(solids)
    model = mj.MjModel.from_xml_string(MODEL.format(assets=assets, geoms=geoms))
    data = mj.MjData(model)
    mj.mj_forward(model, data)
    rows = [_row(model, data, geom) for geom in range(model.ngeom)]
    planes = [planes for *_, planes in rows]
    return Targets(
        kinds=np.array([kind for kind, *_ in rows], dtype=np.int64),
        lows=np.array([low for _, low, *_ in rows]).reshape(-1, 3),
        highs=np.array([high for _, _, high, _ in rows]).reshape(-1, 3),
        first_planes=np.cumsum([0, *map(len, planes)], dtype=np.int64),
        planes=np.concatenate([np.zeros((0, 4)), *planes]),
        materials=np.array([MATERIALS[s.material.kind] for s in solids], dtype=np.int64),
    )


def _row(model: Any, data: Any, geom: int) -> tuple[int, F64, F64, F64]:
    """Kind, lowest and highest corner (3,), planes (p, 4) of a geom of the model."""
    R, middle = data.geom_xmat[geom].reshape(3, 3), data.geom_xpos[geom].copy()
    size, none = model.geom_size[geom].copy(), np.zeros((0, 4))
    kind, is_level = model.geom_type[geom], np.abs(R - np.eye(3)).max() < UPRIGHT
    if kind == mj.mjtGeom.mjGEOM_BOX and is_level:
        return BOX, middle - size, middle + size, none
    if kind == mj.mjtGeom.mjGEOM_CYLINDER and abs(R[2, 2]) > 1 - UPRIGHT:
        reach = np.array([size[0], size[0], size[1]])
        return CYLINDER, middle - reach, middle + reach, none
    assert kind == mj.mjtGeom.mjGEOM_MESH, "rays know upright boxes and cylinders, and meshes"
    mesh = model.geom_dataid[geom]
    begin, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    corners = middle + model.mesh_vert[begin : begin + count].astype(float) @ R.T
    begin, count = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    faces = corners[model.mesh_face[begin : begin + count]]
    return HULL, corners.min(axis=0), corners.max(axis=0), _planes(faces, corners)


def _planes(faces: F64, corners: F64) -> F64:
    """Planes (p, 4), outward, of triangles (n, 3, 3) around convex corners; each plane once."""
    normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    faces, normals = faces[areas > 0], normals[areas > 0] / areas[areas > 0, None]
    far = np.einsum("ni,ni->n", normals, faces.mean(axis=1))
    inward = normals @ corners.mean(axis=0) > far
    normals[inward], far[inward] = -normals[inward], -far[inward]
    far = (normals @ corners.T).max(axis=1)  # so that no corner is cut off by rounding
    kept: list[F64] = []
    for plane in np.column_stack([normals, far]):
        if all(np.abs(plane - other).max() > SAME for other in kept):
            kept.append(plane)
    return np.array(kept)
