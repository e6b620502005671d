"""Two simulated cameras: whole frames, or only the pixels that navigation reads."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import Rect, StereoRig, Strips
from ndtorch.navigation.strips import row_rect
from ndtorch_robot.sim.gl import make_context
from ndtorch_robot.sim.paint import Image
from ndtorch_robot.sim.stress.optics import Motion, axes, moved, shutter_times, slices
from ndtorch_robot.sim.stress.options import Stress

if TYPE_CHECKING:
    import mujoco

Eye = torch.Tensor | Strips

NEAR, FAR = 0.02, 60.0
"""Nearest and farthest that is drawn, m."""


class Cameras:
    """Draws what the cameras of a rig see from a pose of the car.

    A strip is drawn with the part of the whole frame's projection that falls on it, so that its pixels are those
    of the whole frame, except that one in a thousand rounds to the next of 256 levels. Whole frames therefore get
    the strips pasted in: a run does not depend on whether someone looks. All strips of both cameras lie side by
    side in one buffer and are read back at once, so that one more costs little.

    Args:
        model: the world.
        rig: the camera pair; its pitch must be 0.
        fields: the subfields of both images; `rig.subfields()` by default.
        whole: draw whole frames instead of strips.
        more: further pairs of rectangles, for the left and the right image, which become further parts of the
            `Strips` in this order. They should not overlap others: in whole frames the last one shows.
        stress: what is wrong with optics and shutter.

    Raises:
        InputError: no OpenGL, or a rig that looks up or down.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        rig: StereoRig,
        fields: tuple[Rect, Rect] | None = None,
        whole: bool = False,
        more: Sequence[tuple[Rect, Rect]] = (),
        stress: Stress | None = None,
    ) -> None:
        import mujoco

        if rig.pitch != 0:
            raise InputError(f"the simulated cameras look straight ahead, got pitch={rig.pitch}")
        self.rig, self.whole, self.stress = rig, whole, stress or Stress()
        self.fields = fields or rig.subfields()
        self.row = row_rect(rig)
        pairs = [self.fields, (self.row, self.row), *more]
        self.strips: tuple[list[Rect], list[Rect]] = ([p[0] for p in pairs], [p[1] for p in pairs])
        self.places, strip_height = side_by_side([*self.strips[0], *self.strips[1]], rig.width)
        self.pixels: Image = np.empty((strip_height, rig.width, 3), np.uint8)
        size = (rig.width, max(rig.height, strip_height) if whole else strip_height)
        model.vis.global_.offwidth, model.vis.global_.offheight = size
        model.vis.quality.shadowsize = 0  # no shadows are drawn: a buffer for them takes a tenth of a second to make
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

    def look(
        self, data: mujoco.MjData, x: float, y: float, heading: float, motion: Motion | None = None
    ) -> tuple[Eye, Eye]:
        """What the left and the right camera see with the car there.

        Args:
            motion: what the car does meanwhile.

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
        # Where several share a context, another one's buffer may be bound.
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self.gl)
        frames = [self.whole_frame(x, y, heading, side) for side in (0, 1)] if self.whole else []
        exposed = [self.expose((x, y, heading), motion or Motion(), after) for after in shutter_times(self.stress)]
        if len(exposed) > 1:
            self.pixels = np.asarray(np.mean(exposed, 0) + 0.5).astype(np.uint8)
        places = iter(self.places)
        eyes: list[Eye] = []
        for side, rects in enumerate(self.strips):
            pieces = [self.piece(rect, *next(places)) for rect in rects]
            if self.whole:
                for rect, piece in zip(rects, pieces, strict=True):
                    frames[side][rect.top : rect.bottom, rect.left : rect.right] = piece
                eyes.append(tensor(frames[side]))
            else:
                eyes.append(Strips(*map(tensor, pieces)))
        return eyes[0], eyes[1]

    def expose(self, pose: tuple[float, float, float], motion: Motion, after: float) -> Image:
        """All strips, read back so many seconds after the car was at a pose."""
        import mujoco

        places = iter(self.places)
        for side, rects in enumerate(self.strips):
            aimed: float | None = None
            for rect in rects:
                x, y = next(places)
                for part, delay in slices(rect, self.stress, self.rig.height):
                    if delay != aimed:
                        self.aim(*moved(*pose, motion, after + delay), side)
                        aimed = delay
                    self.draw(part, x, y + rect.bottom - part.bottom)
        mujoco.mjr_readPixels(self.pixels, None, mujoco.MjrRect(0, 0, *self.pixels.shape[1::-1]), self.gl)
        return self.pixels.copy() if self.stress.blur else self.pixels

    def whole_frame(self, x: float, y: float, heading: float, side: int) -> Image:
        """One camera's frame `[H, W, 3]` as it is drawn at once."""
        import mujoco

        self.aim(x, y, heading, side)
        self.draw(self.frame, 0, 0)
        frame = np.empty((self.rig.height, self.rig.width, 3), np.uint8)
        mujoco.mjr_readPixels(frame, None, mujoco.MjrRect(0, 0, self.rig.width, self.rig.height), self.gl)
        return frame[::-1].copy()

    def aim(self, x: float, y: float, heading: float, side: int) -> None:
        """Put the camera where one eye of the car is: 0 the left, 1 the right."""
        cos, sin = math.cos(heading), math.sin(heading)
        ahead, rig = self.rig.forward, self.rig
        aside = (0.5 - side) * rig.baseline * (1 + self.stress.baseline)
        forward, up = axes(heading, side, self.stress)
        for camera in self.scene.camera:
            camera.pos = [x + ahead * cos - aside * sin, y + ahead * sin + aside * cos, rig.camera_height]
            camera.forward, camera.up = forward, up
            camera.orthographic = 0
            camera.frustum_near, camera.frustum_far = NEAR, FAR

    def draw(self, rect: Rect, x: int, y: int) -> None:
        """Draw the pixels of a rectangle of the frame, with its lower left corner at `x`, `y` of the buffer."""
        import mujoco

        scale, (cx, cy) = NEAR / (self.rig.focal * (1 + self.stress.focal)), self.rig.center
        for camera in self.scene.camera:
            camera.frustum_center = ((rect.left + rect.right) / 2 - (cx + 0.5)) * scale
            camera.frustum_width = (rect.right - rect.left) / 2 * scale
            camera.frustum_top = (cy + 0.5 - rect.top) * scale
            camera.frustum_bottom = (cy + 0.5 - rect.bottom) * scale
        port = mujoco.MjrRect(x, y, rect.right - rect.left, rect.bottom - rect.top)
        mujoco.mjr_render(port, self.scene, self.gl)

    def piece(self, rect: Rect, x: int, y: int) -> Image:
        """The pixels of a rectangle out of those read back, `[h, w, 3]`, top row first."""
        return self.pixels[y : y + rect.bottom - rect.top, x : x + rect.right - rect.left][::-1]

    def close(self) -> None:
        """Give the buffers back."""
        if self.context is not None:
            self.gl.free()
            self.context.free()
            self.context, self.gl = None, None


def side_by_side(rects: Sequence[Rect], width: int) -> tuple[list[tuple[int, int]], int]:
    """Places in a buffer `width` wide where rectangles of such sizes do not overlap, and the height it takes.

    They are laid on shelves, the low ones first.
    """
    places: dict[int, tuple[int, int]] = {}
    x = y = tall = 0
    for k in sorted(range(len(rects)), key=lambda k: rects[k].bottom - rects[k].top):
        wide, high = rects[k].right - rects[k].left, rects[k].bottom - rects[k].top
        if x + wide > width:
            x, y, tall = 0, y + tall, 0
        places[k] = (x, y)
        x, tall = x + wide, max(tall, high)
    return [places[k] for k in range(len(rects))], y + tall


def tensor(pixels: Image) -> torch.Tensor:
    """`[h, w, 3]` to `[1, 3, h, w]`."""
    return torch.from_numpy(pixels.copy()).permute(2, 0, 1).unsqueeze(0)
