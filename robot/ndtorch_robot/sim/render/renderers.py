"""Frames and strips of a simulated world: by the rasteriser, or through OpenGL for shapes that it does not know."""

from __future__ import annotations

import contextlib
import importlib
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ndtorch.errors import InputError
from ndtorch.navigation import Rect
from ndtorch_robot.sim.procedural_textures import Image
from ndtorch_robot.sim.render._kernels import rasterise
from ndtorch_robot.sim.render.scene import Textures, Triangles, is_supported

if TYPE_CHECKING:
    import mujoco

Vector = tuple[float, float, float]

NEAR, FAR = 0.02, 60.0
"""Nearest and farthest distance that is rendered, m."""

UNUSED = ("SHADOW", "REFLECTION", "SKYBOX", "FOG", "HAZE")


class View(NamedTuple):
    """Pose of a camera: its position, m, its optical axis and its upward axis, two unit vectors at a right angle."""

    position: Vector
    forward: Vector
    up: Vector


class Lens(NamedTuple):
    """Focal length and center of a camera in pixels, and the size of its frames."""

    focal: float
    center: tuple[float, float]
    width: int
    height: int


Shot = Sequence[tuple[View, Rect]]
"""A strip: its parts from the top down, each with the view from which it is rendered."""


class SoftwareRenderer:
    """Renders on the processor: a strip of a few rows takes less time than a call of an OpenGL driver.

    The pixels of a strip equal those of the whole frame to the bit. OpenGL as Mesa draws it gives the same pixels or
    the next of 256 levels, except at some edges of objects.
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
            top, wide = shot[0][1].top, shot[0][1].right - shot[0][1].left
            for view, part in shot:
                if view is not aimed:
                    cameras.append(projection(view, self.lens))
                    aimed = view
                parts.append([len(cameras) - 1, *part, size + (part.top - top) * wide])
            shapes.append((size, shot[-1][1].bottom - top, wide))
            size += shapes[-1][1] * wide
        out = np.empty((size, 3), np.uint8)
        s, t = self.triangles, self.textures
        views = np.array(cameras)
        rasterise(s.corners, s.surface, t.texels, t.mipmaps, views, np.array(parts), (NEAR, FAR), out)
        return [out[n : n + high * wide].reshape(high, wide, 3).transpose(2, 0, 1) for n, high, wide in shapes]

    def frame(self, view: View) -> Image:
        """A whole frame `[3, H, W]`."""
        return self.strips([[(view, Rect(0, self.lens.height, 0, self.lens.width))]])[0]

    def close(self) -> None:
        """Nothing to free."""


def projection(view: View, lens: Lens) -> list[list[float]]:
    """A camera as the kernel `visible_triangles` takes it, `[4, 3]`."""
    right = np.cross(view.forward, view.up)
    column = lens.focal * right + lens.center[0] * np.array(view.forward)
    row = lens.center[1] * np.array(view.forward) - lens.focal * np.array(view.up)
    return [[*view.position], column.tolist(), row.tolist(), [*view.forward]]


class OpenGLRenderer:
    """Renders whole frames by MuJoCo's own renderer and cuts the strips out of them.

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
        import mujoco

        self.renderer.update_scene(data, mujoco.MjvCamera(), self.option)

    def strips(self, shots: Sequence[Shot]) -> list[Image]:
        frames = {view: self.frame(view) for view in dict.fromkeys(view for shot in shots for view, _ in shot)}
        return [
            np.concatenate([frames[view][:, r.top : r.bottom, r.left : r.right] for view, r in shot], 1)
            for shot in shots
        ]

    def frame(self, view: View) -> Image:
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
        self.renderer.close()


def make_renderer(model: mujoco.MjModel, lens: Lens) -> SoftwareRenderer | OpenGLRenderer:
    """The rasteriser where it knows all that is visible of a model; raises `InputError` where OpenGL does not work."""
    return SoftwareRenderer(model, lens) if is_supported(model) else OpenGLRenderer(model, lens)
