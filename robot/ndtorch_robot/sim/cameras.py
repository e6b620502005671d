"""Two simulated cameras: whole frames, or only the pixels that navigation reads."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import Rect, StereoRig, Strips
from ndtorch.navigation.strips import row_rect
from ndtorch_robot.sim.by_kernel import KernelPainter, kernel_draws
from ndtorch_robot.sim.by_opengl import OpenGLPainter
from ndtorch_robot.sim.paint import Image
from ndtorch_robot.sim.painter import Lens, Painter, Shot, View
from ndtorch_robot.sim.stress.optics import Motion, axes, moved, shutter_times, slices
from ndtorch_robot.sim.stress.options import Stress

if TYPE_CHECKING:
    import mujoco

Eye = torch.Tensor | Strips


class Cameras:
    """Draws what the cameras of a rig see from a pose of the car.

    Whole frames get the strips pasted in: a run does not depend on whether someone looks.

    Args:
        model: the world.
        rig: the camera pair; its pitch must be 0.
        fields: the subfields of both images; `rig.subfields()` by default.
        whole: draw whole frames instead of strips.
        more: further pairs of rectangles, for the left and the right image, which become further parts of the
            `Strips` in this order. They should not overlap others: in whole frames the last one shows.
        stress: what is wrong with optics and shutter.

    Raises:
        InputError: no OpenGL where that is needed, or a rig that looks up or down.
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
        if rig.pitch != 0:
            raise InputError(f"the simulated cameras look straight ahead, got pitch={rig.pitch}")
        self.rig, self.whole, self.stress = rig, whole, stress or Stress()
        self.fields = fields or rig.subfields()
        self.row = row_rect(rig)
        pairs = [self.fields, (self.row, self.row), *more]
        self.strips: tuple[list[Rect], list[Rect]] = ([p[0] for p in pairs], [p[1] for p in pairs])
        lens = Lens(rig.focal * (1 + self.stress.focal), rig.center, rig.width, rig.height)
        self.painter: Painter
        if kernel_draws(model):
            self.painter = KernelPainter(model, lens)
        else:
            self.painter = OpenGLPainter(model, lens, [*self.strips[0], *self.strips[1]], whole)

    def look(
        self, data: mujoco.MjData, x: float, y: float, heading: float, motion: Motion | None = None
    ) -> tuple[Eye, Eye]:
        """What the left and the right camera see with the car there.

        Args:
            motion: what the car does meanwhile.

        Returns:
            Two frames `[1, 3, H, W]` uint8, or two `Strips`.
        """
        self.painter.take(data)
        frames = [self.whole_frame(x, y, heading, side) for side in (0, 1)] if self.whole else []
        exposed = [self.expose((x, y, heading), motion or Motion(), after) for after in shutter_times(self.stress)]
        drawn = exposed[0]
        if len(exposed) > 1:
            drawn = [np.asarray(np.mean(same, 0) + 0.5).astype(np.uint8) for same in zip(*exposed, strict=True)]
        pieces, eyes = iter(drawn), list[Eye]()
        for side, rects in enumerate(self.strips):
            parts = [next(pieces) for _ in rects]
            if self.whole:
                for rect, part in zip(rects, parts, strict=True):
                    frames[side][:, rect.top : rect.bottom, rect.left : rect.right] = part
                eyes.append(tensor(frames[side]))
            else:
                eyes.append(Strips(*map(tensor, parts)))
        return eyes[0], eyes[1]

    def expose(self, pose: tuple[float, float, float], motion: Motion, after: float) -> list[Image]:
        """All strips so many seconds after the car was at a pose, of the left camera and then of the right one."""
        shots: list[Shot] = []
        for side, rects in enumerate(self.strips):
            views: dict[float, View] = {}
            for rect in rects:
                shot = []
                for part, delay in slices(rect, self.stress, self.rig.height):
                    if delay not in views:
                        views[delay] = self.view(*moved(*pose, motion, after + delay), side)
                    shot.append((views[delay], part))
                shots.append(shot)
        return self.painter.strips(shots)

    def whole_frame(self, x: float, y: float, heading: float, side: int) -> Image:
        """One camera's frame `[3, H, W]` as it is drawn at once."""
        return self.painter.frame(self.view(x, y, heading, side))

    def view(self, x: float, y: float, heading: float, side: int) -> View:
        """Where one eye of the car is and looks: 0 the left, 1 the right."""
        cos, sin = math.cos(heading), math.sin(heading)
        ahead, rig = self.rig.forward, self.rig
        aside = (0.5 - side) * rig.baseline * (1 + self.stress.baseline)
        place = (x + ahead * cos - aside * sin, y + ahead * sin + aside * cos, rig.camera_height)
        return View(place, *axes(heading, side, self.stress))

    def close(self) -> None:
        """Give the buffers back."""
        self.painter.close()


def tensor(pixels: Image) -> torch.Tensor:
    """`[3, h, w]` to `[1, 3, h, w]`."""
    return torch.from_numpy(pixels).unsqueeze(0)
