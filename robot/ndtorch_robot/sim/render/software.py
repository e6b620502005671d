"""Frames by a rasteriser on the processor: a strip of a few rows takes less time than a call of an OpenGL driver."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ndtorch.navigation import Rect
from ndtorch_robot.sim.procedural_textures import Image
from ndtorch_robot.sim.render._kernels import rasterise
from ndtorch_robot.sim.render.renderer import FAR, NEAR, Lens, Shot, View
from ndtorch_robot.sim.render.scene import Textures, Triangles

if TYPE_CHECKING:
    import mujoco


class SoftwareRenderer:
    """Renders strips and whole frames; the pixels of a strip equal those of the whole frame to the bit.

    OpenGL as Mesa draws it gives the same pixels or the next of 256 levels, except at some edges of objects.

    Args:
        model: a world for which `scene.is_supported` is true.
        lens: of both cameras.
    """

    def __init__(self, model: mujoco.MjModel, lens: Lens) -> None:
        self.lens, self.triangles, self.textures = lens, Triangles(model), Textures(model)

    def update(self, data: mujoco.MjData) -> None:
        """Take the poses of all bodies from here on."""
        self.triangles.update(data)

    def strips(self, shots: Sequence[Shot]) -> list[Image]:
        """The pixels of strips, each `[3, h, w]`, the colors of a pixel next to each other in memory."""
        cameras: list[list[list[float]]] = []
        parts, shapes, size = [], [], 0
        aimed: View | None = None
        # The kernel takes the parts of one camera together.
        for shot in shots:
            rect = Rect(shot[0][1].top, shot[-1][1].bottom, shot[0][1].left, shot[0][1].right)
            high, wide = rect.bottom - rect.top, rect.right - rect.left
            for view, part in shot:
                if view is not aimed:
                    cameras.append(projection(view, self.lens))
                    aimed = view
                parts.append([len(cameras) - 1, *part, size + (part.top - rect.top) * wide])
            shapes.append((size, high, wide))
            size += high * wide
        out = np.empty((size, 3), np.uint8)
        s, t = self.triangles, self.textures
        views = np.array(cameras)
        rasterise(s.corners, s.surface, t.texels, t.mipmaps, views, np.array(parts), (NEAR, FAR), out)
        return [out[n : n + high * wide].reshape(high, wide, 3).transpose(2, 0, 1) for n, high, wide in shapes]

    def frame(self, view: View) -> Image:
        """A whole frame `[3, H, W]`."""
        return self.strips([[(view, self.lens.frame)]])[0]

    def close(self) -> None:
        """Nothing to free."""


def projection(view: View, lens: Lens) -> list[list[float]]:
    """A camera as the kernel `visible_triangles` takes it, `[4, 3]`."""
    (fx, fy, fz), (ux, uy, uz), (cx, cy) = view.forward, view.up, lens.center
    right = (fy * uz - fz * uy, fz * ux - fx * uz, fx * uy - fy * ux)
    column = [lens.focal * r + cx * f for r, f in zip(right, view.forward, strict=True)]
    row = [cy * f - lens.focal * u for u, f in zip(view.up, view.forward, strict=True)]
    return [[*view.position], column, row, [*view.forward]]
