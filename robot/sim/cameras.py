"""Two simulated cameras: whole frames, or only the pixels that navigation reads."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import Rect, StereoRig, Strips
from robot.sim.gl import make_context
from robot.sim.paint import Image

if TYPE_CHECKING:
    import mujoco

Eye = torch.Tensor | Strips

NEAR, FAR = 0.02, 60.0
"""Nearest and farthest that is drawn, m."""


class Cameras:
    """Draws what the cameras of a rig see from a pose of the car.

    A strip is drawn with the projection of the whole frame, shifted so that only its pixels fall into a small
    buffer. They are the pixels of the whole frame, except that one in a thousand rounds to the next of 256
    levels. Whole frames therefore get the strips pasted in: a run does not depend on whether someone looks.

    Args:
        model: the world.
        rig: the camera pair; its pitch must be 0.
        fields: the subfields of both images; `rig.subfields()` by default.
        whole: draw whole frames instead of strips.

    Raises:
        InputError: no OpenGL, or a rig that looks up or down.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        rig: StereoRig,
        fields: tuple[Rect, Rect] | None = None,
        whole: bool = False,
    ) -> None:
        import mujoco

        if rig.pitch != 0:
            raise InputError(f"the simulated cameras look straight ahead, got pitch={rig.pitch}")
        self.rig, self.whole = rig, whole
        self.fields = fields or rig.subfields()
        self.row = Rect(rig.row, rig.row + 1, 0, rig.width)
        tallest = max(r.bottom - r.top for r in (*self.fields, self.row))
        size = (rig.width, rig.height if whole else tallest)
        model.vis.global_.offwidth, model.vis.global_.offheight = size
        self.context = make_context(*size)
        self.frame = Rect(0, rig.height, 0, rig.width)
        self.gl: Any = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self.gl)
        self.scene = mujoco.MjvScene(model, 200)
        for flag in ("SHADOW", "REFLECTION", "SKYBOX", "FOG", "HAZE"):
            self.scene.flags[getattr(mujoco.mjtRndFlag, f"mjRND_{flag}")] = 0
        self.option = mujoco.MjvOption()
        self.option.geomgroup[3] = 0  # what is only there to bump into
        self.model, self.moves = model, model.nmocap > 0
        self.ready = False

    def look(self, data: mujoco.MjData, x: float, y: float, heading: float) -> tuple[Eye, Eye]:
        """What the left and the right camera see with the car there.

        Returns:
            Two frames `[1, 3, H, W]` uint8, or two `Strips`.
        """
        import mujoco

        if self.moves or not self.ready:
            camera = mujoco.MjvCamera()
            category = mujoco.mjtCatBit.mjCAT_ALL
            mujoco.mjv_updateScene(self.model, data, self.option, None, camera, category, self.scene)
            self.ready = True
        self.context.make_current()
        eyes: list[Eye] = []
        for side, field in zip((1, -1), self.fields, strict=True):
            self.aim(x, y, heading, side * self.rig.baseline / 2)
            strips = [(rect, self.draw(rect)) for rect in (field, self.row)]
            if self.whole:
                pixels = self.draw(self.frame).copy()
                for rect, strip in strips:
                    pixels[rect.top : rect.bottom, rect.left : rect.right] = strip
                eyes.append(tensor(pixels))
            else:
                eyes.append(Strips(*(tensor(strip) for _, strip in strips)))
        return eyes[0], eyes[1]

    def aim(self, x: float, y: float, heading: float, aside: float) -> None:
        """Put the camera where one eye of the car is."""
        cos, sin = math.cos(heading), math.sin(heading)
        ahead, rig = self.rig.forward, self.rig
        for camera in self.scene.camera:
            camera.pos = [x + ahead * cos - aside * sin, y + ahead * sin + aside * cos, rig.camera_height]
            camera.forward = [cos, sin, 0.0]
            camera.up = [0.0, 0.0, 1.0]
            camera.orthographic = 0
            camera.frustum_near, camera.frustum_far = NEAR, FAR
            camera.frustum_center = 0.0
            camera.frustum_width = rig.width / 2 / rig.focal * NEAR
            camera.frustum_top = rig.height / 2 / rig.focal * NEAR
            camera.frustum_bottom = -camera.frustum_top

    def draw(self, rect: Rect) -> Image:
        """The pixels of a rectangle of the frame, `[h, w, 3]`, top row first."""
        import mujoco

        # The whole frame is projected; what lies outside the small buffer is not drawn.
        shifted = mujoco.MjrRect(-rect.left, rect.bottom - self.rig.height, self.rig.width, self.rig.height)
        mujoco.mjr_render(shifted, self.scene, self.gl)
        pixels = np.empty((rect.bottom - rect.top, rect.right - rect.left, 3), np.uint8)
        mujoco.mjr_readPixels(pixels, None, mujoco.MjrRect(0, 0, pixels.shape[1], pixels.shape[0]), self.gl)
        return pixels[::-1]

    def close(self) -> None:
        """Give the buffers back."""
        if self.context is not None:
            self.gl.free()
            self.context.free()
            self.context, self.gl = None, None


def tensor(pixels: Image) -> torch.Tensor:
    """`[h, w, 3]` to `[1, 3, h, w]`."""
    return torch.from_numpy(pixels.copy()).permute(2, 0, 1).unsqueeze(0)
