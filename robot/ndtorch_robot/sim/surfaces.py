"""The triangles of a world that can be seen."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ndtorch_robot.sim.plan import Floats
from ndtorch_robot.sim.textures import texels_of

if TYPE_CHECKING:
    import mujoco

SEEN = 3
"""Geoms of groups below this one are seen."""

MOST = 2**31 - 1
"""Texels that a kernel can count."""


def can_be_drawn(model: mujoco.MjModel) -> bool:
    """Whether all that is seen of a model are meshes and boxes that nothing shines through."""
    import mujoco

    known = (int(mujoco.mjtGeom.mjGEOM_MESH), int(mujoco.mjtGeom.mjGEOM_BOX))
    if texels_of(model) > MOST or (model.ntex and (model.tex_nchannel != 3).any()):
        return False
    return all(int(model.geom_type[g]) in known and look(model, g)[1][3] == 1 for g in seen(model))


def seen(model: mujoco.MjModel) -> list[int]:
    """The geoms that are seen."""
    return [g for g in range(model.ngeom) if model.geom_group[g] < SEEN]


def look(model: mujoco.MjModel, geom: int) -> tuple[int, Any]:
    """A geom's picture, -1 where it has none, and its color, 0..1, `[4]`."""
    import mujoco

    material = int(model.geom_matid[geom])
    if material < 0:
        return -1, model.geom_rgba[geom]
    return int(model.mat_texid[material][int(mujoco.mjtTextureRole.mjTEXROLE_RGB)]), model.mat_rgba[material]


class Surfaces:
    """The triangles that are seen of a model, as `ndtorch.kernels.draw_strips` wants them.

    Attributes:
        corners: in the world, with their places in the picture, `[N, 3, 5]`.
        surface: which picture or color is on them, `[N]` int32.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        import mujoco

        shapes, surfaces, self.parts, count = [], [], [], 0
        for geom in seen(model):
            box = int(model.geom_type[geom]) == int(mujoco.mjtGeom.mjGEOM_BOX)
            shape = box_faces(model.geom_size[geom]) if box else mesh_faces(model, int(model.geom_dataid[geom]))
            picture, rgba = look(model, geom)
            red, green, blue = (int(255 * c + 0.5) for c in rgba[:3])
            shapes.append(shape)
            color = -1 - (red | green << 8 | blue << 16)
            surfaces.append(np.full(len(shape), picture if picture >= 0 else color, np.int32))
            moves = int(model.body_weldid[model.geom_bodyid[geom]]) != 0
            self.parts.append((geom, slice(count, count + len(shape)), moves))
            count += len(shape)
        self.shapes = np.concatenate(shapes) if shapes else np.zeros((0, 3, 5))
        self.surface = np.concatenate(surfaces) if surfaces else np.zeros(0, np.int32)
        self.corners, self.ready = self.shapes.copy(), False

    def take(self, data: mujoco.MjData) -> None:
        """Put everything where it is; what does not move, once."""
        for geom, part, moves in self.parts:
            if moves or not self.ready:
                turn = data.geom_xmat[geom].reshape(3, 3)
                self.corners[part, :, :3] = self.shapes[part, :, :3] @ turn.T + data.geom_xpos[geom]
        self.ready = True


def mesh_faces(model: mujoco.MjModel, mesh: int) -> Floats:
    """The triangles of a mesh, `[N, 3, 5]`."""
    begin, count = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    faces = np.zeros((count, 3, 5))
    points, first = model.mesh_vert[int(model.mesh_vertadr[mesh]) :], int(model.mesh_texcoordadr[mesh])
    faces[..., :3] = points[model.mesh_face[begin : begin + count]]
    if first >= 0:
        faces[..., 3:] = model.mesh_texcoord[first:][model.mesh_facetexcoord[begin : begin + count]]
    return faces


def box_faces(half: Floats) -> Floats:
    """The triangles of a box, by half of its sides."""
    quads = []
    for axis in range(3):
        for sign in (1.0, -1.0):
            one, two, side = np.zeros(3), np.zeros(3), np.zeros(3)
            side[axis], one[(axis + 1) % 3], two[(axis + 2) % 3] = sign, sign, 1.0
            quads.append([side - one - two, side + one - two, side + one + two, side - one + two])
    corners = np.array(quads)[:, [0, 1, 2, 0, 2, 3]].reshape(12, 3, 3) * half
    return np.concatenate((corners, np.zeros((12, 3, 2))), -1)
