"""What the rasteriser draws of a MuJoCo model: textured triangles, and textures with their mipmaps."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ndtorch_robot.sim.plan import Floats
from ndtorch_robot.sim.render._kernels_textures import build_mipmaps

if TYPE_CHECKING:
    import mujoco

VISIBLE = 3
"""Geoms of groups below this one are visible."""

MAX_TEXELS = 2**31 - 1
"""Texels that 32 bits count."""

LEVELS = 16
"""Mipmaps of a texture at most, itself included: each is half as large as the one before, down to a single texel."""


def is_supported(model: mujoco.MjModel) -> bool:
    """Whether all that is visible of a model are opaque meshes and boxes."""
    import mujoco

    known = (int(mujoco.mjtGeom.mjGEOM_MESH), int(mujoco.mjtGeom.mjGEOM_BOX))
    if texel_count(model) > MAX_TEXELS or (model.ntex and (model.tex_nchannel != 3).any()):
        return False
    return all(int(model.geom_type[g]) in known and appearance(model, g)[1][3] == 1 for g in visible_geoms(model))


def visible_geoms(model: mujoco.MjModel) -> list[int]:
    return [g for g in range(model.ngeom) if model.geom_group[g] < VISIBLE]


def appearance(model: mujoco.MjModel, geom: int) -> tuple[int, Any]:
    """A geom's texture, -1 for none, and its color, 0..1, `[4]`."""
    import mujoco

    material = int(model.geom_matid[geom])
    if material < 0:
        return -1, model.geom_rgba[geom]
    return int(model.mat_texid[material][int(mujoco.mjtTextureRole.mjTEXROLE_RGB)]), model.mat_rgba[material]


class Triangles:
    """The visible triangles of a model.

    Attributes:
        corners: world coordinates and texture coordinates, `[N, 3, 5]`.
        surface: number of the texture, or -1 less a color of 24 bits, `[N]` int32.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        import mujoco

        shapes, surfaces, self.parts, count = [], [], [], 0
        for geom in visible_geoms(model):
            box = int(model.geom_type[geom]) == int(mujoco.mjtGeom.mjGEOM_BOX)
            shape = box_faces(model.geom_size[geom]) if box else mesh_faces(model, int(model.geom_dataid[geom]))
            texture, rgba = appearance(model, geom)
            red, green, blue = (int(255 * c + 0.5) for c in rgba[:3])
            shapes.append(shape)
            color = -1 - (red | green << 8 | blue << 16)
            surfaces.append(np.full(len(shape), texture if texture >= 0 else color, np.int32))
            moves = int(model.body_weldid[model.geom_bodyid[geom]]) != 0
            self.parts.append((geom, slice(count, count + len(shape)), moves))
            count += len(shape)
        self.shapes = np.concatenate(shapes) if shapes else np.zeros((0, 3, 5))
        self.surface = np.concatenate(surfaces) if surfaces else np.zeros(0, np.int32)
        self.corners, self.ready = self.shapes.copy(), False

    def update(self, data: mujoco.MjData) -> None:
        """Move every geom to its pose; fixed ones once."""
        for geom, part, moves in self.parts:
            if moves or not self.ready:
                turn = data.geom_xmat[geom].reshape(3, 3)
                self.corners[part, :, :3] = self.shapes[part, :, :3] @ turn.T + data.geom_xpos[geom]
        self.ready = True


def mesh_faces(model: mujoco.MjModel, mesh: int) -> Floats:
    begin, count = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    faces = np.zeros((count, 3, 5))
    points, first = model.mesh_vert[int(model.mesh_vertadr[mesh]) :], int(model.mesh_texcoordadr[mesh])
    faces[..., :3] = points[model.mesh_face[begin : begin + count]]
    if first >= 0:
        faces[..., 3:] = model.mesh_texcoord[first:][model.mesh_facetexcoord[begin : begin + count]]
    return faces


def box_faces(half: Floats) -> Floats:
    quads = []
    for axis in range(3):
        for sign in (1.0, -1.0):
            one, two, side = np.zeros(3), np.zeros(3), np.zeros(3)
            side[axis], one[(axis + 1) % 3], two[(axis + 2) % 3] = sign, sign, 1.0
            quads.append([side - one - two, side + one - two, side + one + two, side - one + two])
    corners = np.array(quads)[:, [0, 1, 2, 0, 2, 3]].reshape(12, 3, 3) * half
    return np.concatenate((corners, np.zeros((12, 3, 2))), -1)


class Textures:
    """All textures of a model.

    Attributes:
        texels: of all mipmaps, each with a border of one texel, `[N]` uint32.
        mipmaps: where each mipmap of each texture begins, its width and its height, `[textures, LEVELS, 3]` int32.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self.mipmaps = np.zeros((max(model.ntex, 1), LEVELS, 3), np.int32)
        size = 0
        for n in range(model.ntex):
            wide, high = int(model.tex_width[n]), int(model.tex_height[n])
            for k in range(LEVELS):
                self.mipmaps[n, k] = (size, wide, high)
                size += (wide + 2) * (high + 2)
                if wide == high == 1:
                    break
                wide, high = max(wide // 2, 1), max(high // 2, 1)
        self.texels = np.empty(size, np.uint32)
        for n in range(model.ntex):
            start, pixels = int(model.tex_adr[n]), int(model.tex_width[n]) * int(model.tex_height[n])
            image = np.asarray(model.tex_data[start : start + 3 * pixels])
            build_mipmaps(image, self.mipmaps[n], self.texels)


def texel_count(model: mujoco.MjModel) -> int:
    """About the number of texels of all textures of a model and their mipmaps."""
    return int((model.tex_width.astype(np.int64) + 2) @ (model.tex_height.astype(np.int64) + 2) * 4 // 3)
