"""Pictures by MuJoCo's renderer, through OpenGL."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ndtorch.navigation import Rect
from ndtorch_robot.sim.gl import make_context
from ndtorch_robot.sim.paint import Image
from ndtorch_robot.sim.painter import FAR, NEAR, Lens, Shot, View

if TYPE_CHECKING:
    import mujoco


class OpenGLPainter:
    """Draws all strips side by side in one buffer and reads them back at once, so that one more costs little.

    A strip is drawn with the part of the whole frame's projection that falls on it, so that its pixels are those
    of the whole frame, except that one in a thousand rounds to the next of 256 levels.

    Args:
        model: the world.
        lens: of both cameras.
        rects: the strips.
        whole: room for whole frames as well.

    Raises:
        InputError: no OpenGL.
    """

    def __init__(self, model: mujoco.MjModel, lens: Lens, rects: Sequence[Rect], whole: bool) -> None:
        import mujoco

        self.model, self.lens = model, lens
        self.places, strip_height = side_by_side(rects, lens.width)
        self.pixels: Image = np.empty((strip_height, lens.width, 3), np.uint8)
        size = (lens.width, max(lens.height, strip_height) if whole else strip_height)
        model.vis.global_.offwidth, model.vis.global_.offheight = size
        model.vis.quality.shadowsize = 0  # no shadows are drawn: a buffer for them takes a tenth of a second to make
        self.context = make_context(*size)
        self.gl: Any = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self.gl)
        self.scene = mujoco.MjvScene(model, 200)
        for flag in ("SHADOW", "REFLECTION", "SKYBOX", "FOG", "HAZE"):
            self.scene.flags[getattr(mujoco.mjtRndFlag, f"mjRND_{flag}")] = 0
        self.option = mujoco.MjvOption()
        self.option.geomgroup[3] = 0  # what is only there to bump into
        self.moves, self.ready = model.nmocap > 0, False

    def take(self, data: mujoco.MjData) -> None:
        """Things stand as they do here from now on."""
        import mujoco

        if self.moves or not self.ready:
            camera, category = mujoco.MjvCamera(), mujoco.mjtCatBit.mjCAT_ALL
            mujoco.mjv_updateScene(self.model, data, self.option, None, camera, category, self.scene)
            self.ready = True

    def strips(self, shots: Sequence[Shot]) -> list[Image]:
        """The pixels of strips, each `[3, h, w]`."""
        import mujoco

        self.make_current()
        aimed, heights = None, []
        for parts, (x, y) in zip(shots, self.places, strict=True):
            bottom = parts[-1][1].bottom
            for view, part in parts:
                if view is not aimed:
                    self.aim(view)
                    aimed = view
                self.draw(part, x, y + bottom - part.bottom)
            heights.append(bottom - parts[0][1].top)
        mujoco.mjr_readPixels(self.pixels, None, mujoco.MjrRect(0, 0, *self.pixels.shape[1::-1]), self.gl)
        pieces = []
        for parts, (x, y), high in zip(shots, self.places, heights, strict=True):
            rect = parts[0][1]
            piece = self.pixels[y : y + high, x : x + rect.right - rect.left][::-1]
            pieces.append(piece.copy().transpose(2, 0, 1))
        return pieces

    def frame(self, view: View) -> Image:
        """A whole picture `[3, H, W]`, drawn at once."""
        import mujoco

        self.make_current()
        self.aim(view)
        self.draw(self.lens.frame, 0, 0)
        frame = np.empty((self.lens.height, self.lens.width, 3), np.uint8)
        mujoco.mjr_readPixels(frame, None, mujoco.MjrRect(0, 0, self.lens.width, self.lens.height), self.gl)
        return frame[::-1].copy().transpose(2, 0, 1)

    def make_current(self) -> None:
        """Where several share a context, another one's buffer may be bound."""
        import mujoco

        self.context.make_current()
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self.gl)

    def aim(self, view: View) -> None:
        """Look from there from now on."""
        for camera in self.scene.camera:
            camera.pos, camera.forward, camera.up = view
            camera.orthographic = 0
            camera.frustum_near, camera.frustum_far = NEAR, FAR

    def draw(self, rect: Rect, x: int, y: int) -> None:
        """Draw the pixels of a rectangle of the frame, with its lower left corner at `x`, `y` of the buffer."""
        import mujoco

        scale, (cx, cy) = NEAR / self.lens.focal, self.lens.center
        for camera in self.scene.camera:
            camera.frustum_center = ((rect.left + rect.right) / 2 - (cx + 0.5)) * scale
            camera.frustum_width = (rect.right - rect.left) / 2 * scale
            camera.frustum_top = (cy + 0.5 - rect.top) * scale
            camera.frustum_bottom = (cy + 0.5 - rect.bottom) * scale
        port = mujoco.MjrRect(x, y, rect.right - rect.left, rect.bottom - rect.top)
        mujoco.mjr_render(port, self.scene, self.gl)

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
