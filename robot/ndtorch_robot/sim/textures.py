"""The pictures on the surfaces of a world, with the smaller copies that are drawn of what is far away."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ndtorch.kernels.smaller_copies import smaller_copies

if TYPE_CHECKING:
    import mujoco

COPIES = 16
"""Of a picture and its smaller ones, at most: each is half as large as the one before, down to a single texel."""


class Textures:
    """All pictures of a model, as `ndtorch.kernels.draw_strips` wants them.

    Attributes:
        texels: `[N]` uint32.
        copies: where each copy of each picture begins, its width and its height, `[pictures, COPIES, 3]` int32.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self.copies = np.zeros((max(model.ntex, 1), COPIES, 3), np.int32)
        size = 0
        for n in range(model.ntex):
            wide, high = int(model.tex_width[n]), int(model.tex_height[n])
            for k in range(COPIES):
                self.copies[n, k] = (size, wide, high)
                size += (wide + 2) * (high + 2)
                if wide == high == 1:
                    break
                wide, high = max(wide // 2, 1), max(high // 2, 1)
        self.texels = np.empty(size, np.uint32)
        for n in range(model.ntex):
            start, pixels = int(model.tex_adr[n]), int(model.tex_width[n]) * int(model.tex_height[n])
            image = np.asarray(model.tex_data[start : start + 3 * pixels])
            smaller_copies(image, self.copies[n], self.texels)


def texels_of(model: mujoco.MjModel) -> int:
    """So many texels have all pictures of a model and their smaller copies, about."""
    return int((model.tex_width.astype(np.int64) + 2) @ (model.tex_height.astype(np.int64) + 2) * 4 // 3)
