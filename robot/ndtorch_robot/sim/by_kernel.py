"""Pictures by a kernel on the processor, which draws the few pixels of the strips sooner than a driver of OpenGL."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ndtorch.kernels.draw_strips import draw_strips
from ndtorch.kernels.switch import switched_on
from ndtorch.navigation import Rect
from ndtorch_robot.sim.paint import Image
from ndtorch_robot.sim.painter import FAR, NEAR, Lens, Shot, View
from ndtorch_robot.sim.surfaces import Surfaces, can_be_drawn
from ndtorch_robot.sim.textures import Textures

if TYPE_CHECKING:
    import mujoco


def kernel_draws(model: mujoco.MjModel) -> bool:
    """Whether the kernel can draw a world: not without Numba, nor what MuJoCo alone knows to draw."""
    return switched_on() and can_be_drawn(model)


class KernelPainter:
    """Draws strips and whole frames, a pixel of a strip to the bit as in the whole frame.

    OpenGL as Mesa draws it gives the same pixels or the next of 256 levels, but for some at the edges of things, where
    a pixel lies on the one side or the other.

    Args:
        model: the world.
        lens: of both cameras.
    """

    def __init__(self, model: mujoco.MjModel, lens: Lens) -> None:
        self.lens, self.surfaces, self.textures = lens, Surfaces(model), Textures(model)

    def take(self, data: mujoco.MjData) -> None:
        """Things stand as they do here from now on."""
        self.surfaces.take(data)

    def strips(self, shots: Sequence[Shot]) -> list[Image]:
        """The pixels of strips, each `[3, h, w]`, colors beside each other as a camera gives them."""
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
        s, t = self.surfaces, self.textures
        views = np.array(cameras)
        draw_strips(s.corners, s.surface, t.texels, t.copies, views, np.array(parts), (NEAR, FAR), out)
        return [out[n : n + high * wide].reshape(high, wide, 3).transpose(2, 0, 1) for n, high, wide in shapes]

    def frame(self, view: View) -> Image:
        """A whole picture `[3, H, W]`."""
        return self.strips([[(view, self.lens.frame)]])[0]

    def close(self) -> None:
        """Nothing is held."""


def projection(view: View, lens: Lens) -> list[list[float]]:
    """A camera as `ndtorch.kernels.facets` wants it."""
    (fx, fy, fz), (ux, uy, uz), (cx, cy) = view.forward, view.up, lens.center
    right = (fy * uz - fz * uy, fz * ux - fx * uz, fx * uy - fy * ux)
    column = [lens.focal * r + cx * f for r, f in zip(right, view.forward, strict=True)]
    row = [cy * f - lens.focal * u for u, f in zip(view.up, view.forward, strict=True)]
    return [[*view.place], column, row, [*view.forward]]
