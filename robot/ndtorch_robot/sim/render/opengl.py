"""Frames by MuJoCo's own renderer, for worlds with shapes that the rasteriser does not know."""

from __future__ import annotations

import contextlib
import importlib
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ndtorch.errors import InputError
from ndtorch_robot.sim.procedural_textures import Image
from ndtorch_robot.sim.render.renderer import FAR, NEAR, Lens, Shot, View

if TYPE_CHECKING:
    import mujoco

UNUSED = ("SHADOW", "REFLECTION", "SKYBOX", "FOG", "HAZE")


class OpenGLRenderer:
    """Renders whole frames through OpenGL and cuts the strips out of them.

    Args:
        model: the world.
        lens: of both cameras.

    Raises:
        InputError: OpenGL does not work here.
    """

    def __init__(self, model: mujoco.MjModel, lens: Lens) -> None:
        import mujoco

        with contextlib.suppress(Exception):
            # Triton and Mesa's software driver each bring an LLVM: loaded in the other order, the process crashes.
            importlib.import_module("triton._C.libtriton")
        self.lens = lens
        model.vis.global_.offwidth, model.vis.global_.offheight = lens.width, lens.height
        try:
            self.renderer = mujoco.Renderer(model, lens.height, lens.width)
        except Exception as error:  # every OpenGL platform fails with an exception of its own
            raise InputError(
                f"this world needs OpenGL ({type(error).__name__} {error}): set MUJOCO_GL=egl or MUJOCO_GL=osmesa "
                "(Debian: libegl1 libgl1-mesa-dri, or libosmesa6)"
            ) from None
        for flag in UNUSED:
            self.renderer.scene.flags[getattr(mujoco.mjtRndFlag, f"mjRND_{flag}")] = 0
        self.option = mujoco.MjvOption()
        self.option.geomgroup[3] = 0  # collision shapes

    def update(self, data: mujoco.MjData) -> None:
        """Take the poses of all bodies from here on."""
        import mujoco

        self.renderer.update_scene(data, mujoco.MjvCamera(), self.option)

    def strips(self, shots: Sequence[Shot]) -> list[Image]:
        """The pixels of strips, each `[3, h, w]`."""
        frames: dict[View, Image] = {}
        strips = []
        for parts in shots:
            pieces = []
            for view, rect in parts:
                if view not in frames:
                    frames[view] = self.frame(view)
                pieces.append(frames[view][:, rect.top : rect.bottom, rect.left : rect.right])
            strips.append(np.concatenate(pieces, 1))
        return strips

    def frame(self, view: View) -> Image:
        """A whole frame `[3, H, W]`."""
        lens, scale = self.lens, NEAR / self.lens.focal
        for camera in self.renderer.scene.camera:
            camera.pos, camera.forward, camera.up = view
            camera.orthographic = 0
            camera.frustum_near, camera.frustum_far = NEAR, FAR
            camera.frustum_center = (lens.width / 2 - (lens.center[0] + 0.5)) * scale
            camera.frustum_width = lens.width / 2 * scale
            camera.frustum_top = (lens.center[1] + 0.5) * scale
            camera.frustum_bottom = (lens.center[1] + 0.5 - lens.height) * scale
        frame: Image = self.renderer.render()
        return frame.transpose(2, 0, 1)

    def close(self) -> None:
        """Free the buffers."""
        self.renderer.close()
