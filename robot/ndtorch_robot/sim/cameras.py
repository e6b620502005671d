"""Two simulated cameras: whole frames, or only the pixels that navigation reads."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import torch

from ndtorch.navigation import Rect, StereoRig, Strips
from ndtorch.navigation.stereo.strips import row_rect
from ndtorch_robot.sim._kernels import rasterise
from ndtorch_robot.sim.disturbances import Disturbances
from ndtorch_robot.sim.plan import Floats
from ndtorch_robot.sim.textures import Image
from ndtorch_robot.sim.world import World

Frame = torch.Tensor | Strips

REACH = (0.02, 60.0)
"""Nearest and farthest distance that is rendered, m."""


class Cameras:
    """Renders what the cameras of a rig see from a pose of the car.

    The pixels of a strip equal those of the whole frame to the bit. Strips are pasted into whole frames, so that a
    drive does not depend on which of the two is rendered.

    Args:
        world: of `build`.
        rig: the camera pair.
        fields: the subfields of both images; `rig.subfields()` by default.
        full_frames: render whole frames instead of strips.
        disturbances: how the real cameras differ from `rig`.
    """

    def __init__(
        self,
        world: World,
        rig: StereoRig,
        fields: tuple[Rect, Rect] | None = None,
        full_frames: bool = False,
        disturbances: Disturbances | None = None,
    ) -> None:
        self.world, self.rig, self.full_frames = world, rig, full_frames
        self.errors = disturbances or Disturbances()
        self.fields = fields or rig.subfields()
        self.row = row_rect(rig)
        self.strips = tuple((field, self.row) for field in self.fields)

    def look(self, x: float, y: float, heading: float) -> list[Frame]:
        """What the left and the right camera see with the car there: frames `[1, 3, H, W]` uint8, or `Strips`."""
        frames, views = list[Frame](), [self.view(x, y, heading, side) for side in (0, 1)]
        pieces = iter(self.render(views, self.strips))
        for view, rects in zip(views, self.strips, strict=True):
            parts = [next(pieces) for _ in rects]
            if self.full_frames:
                frame = self.frame(view)
                for rect, part in zip(rects, parts, strict=True):
                    frame[:, rect.top : rect.bottom, rect.left : rect.right] = part
                frames.append(torch.from_numpy(frame)[None])
            else:
                frames.append(Strips(*(torch.from_numpy(part)[None] for part in parts)))
        return frames

    def render(self, views: Sequence[Floats], rects: Sequence[Sequence[Rect]]) -> list[Image]:
        """The pixels of rectangles of each view, `[3, h, w]`, the colors of a pixel next to each other in memory."""
        parts, begins, size, w = [], [], 0, self.world
        for number, some in enumerate(rects):
            for rect in some:
                high, wide = rect.bottom - rect.top, rect.right - rect.left
                parts.append([number, *rect, size])
                begins.append((size, high, wide))
                size += high * wide
        cameras, out = np.array(views), np.empty((size, 3), np.uint8)
        rasterise(w.corners, w.surface, w.texels, w.mipmaps, cameras, np.array(parts), REACH, out)
        return [out[n : n + high * wide].reshape(high, wide, 3).transpose(2, 0, 1) for n, high, wide in begins]

    def frame(self, view: Floats) -> Image:
        return self.render([view], [[Rect(0, self.rig.height, 0, self.rig.width)]])[0]

    def view(self, x: float, y: float, heading: float, side: int) -> Floats:
        """A camera, 0 the left one, 1 the right one, as the kernel `visible_triangles` takes it, `[4, 3]`."""
        e, rig = self.errors, self.rig
        ahead, left = direction(heading), direction(heading + math.pi / 2)
        aside = (0.5 - side) * rig.baseline * (1 + e.baseline_error_ratio)
        position = np.array([x, y, rig.camera_height]) + rig.forward * ahead + aside * left
        yaw, roll = heading + math.radians(e.yaw_deg + side * e.right_yaw_deg), math.radians(e.roll_deg)
        pitch, vertical = rig.pitch + math.radians(e.pitch_deg), np.array([0.0, 0.0, 1.0])
        ahead, left = direction(yaw), direction(yaw + math.pi / 2)
        upward = math.sin(pitch) * ahead + math.cos(pitch) * vertical
        forward = math.cos(pitch) * ahead - math.sin(pitch) * vertical
        upward = math.cos(roll) * upward - math.sin(roll) * left
        focal, (column, row) = rig.focal * (1 + e.focal_error_ratio), rig.center
        across = focal * np.cross(forward, upward) + column * forward
        return np.stack((position, across, row * forward - focal * upward, forward))


def direction(angle: float) -> Floats:
    return np.array([math.cos(angle), math.sin(angle), 0.0])
