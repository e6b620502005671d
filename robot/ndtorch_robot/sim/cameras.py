"""Two simulated cameras: whole frames, or only the pixels that navigation reads."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

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
Pose = tuple[float, float, float]

BLUR_SAMPLES = 4
"""Frames whose mean is a frame with motion blur."""

ROLLING_ROWS = 12
"""Rows that a rolling shutter reads at one time."""

REACH = (0.02, 60.0)
"""Nearest and farthest distance that is rendered, m."""


class CarMotion(NamedTuple):
    """Speed, m/s, and curvature, 1/m, of the car while the shutter is open."""

    speed: float = 0.0
    curvature: float = 0.0


class CameraView(NamedTuple):
    """Pose of a camera: its position, m, its optical axis and its upward axis, two unit vectors at a right angle."""

    position: Floats
    forward: Floats
    up: Floats


Shot = Sequence[tuple[CameraView, Rect]]
"""A strip: its parts from the top down, each with the view from which it is rendered."""


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

    def look(self, x: float, y: float, heading: float, motion: CarMotion | None = None) -> list[Frame]:
        """What the left and the right camera see with the car there: frames `[1, 3, H, W]` uint8, or `Strips`."""
        pose, frames = (x, y, heading), list[Frame]()
        pieces = iter(self.expose(pose, motion or CarMotion()))
        for side, rects in enumerate(self.strips):
            parts = [next(pieces) for _ in rects]
            if self.full_frames:
                frame = self.frame(self.view(*pose, side))
                for rect, part in zip(rects, parts, strict=True):
                    frame[:, rect.top : rect.bottom, rect.left : rect.right] = part
                frames.append(torch.from_numpy(frame)[None])
            else:
                frames.append(Strips(*(torch.from_numpy(part)[None] for part in parts)))
        return frames

    def expose(self, pose: Pose, motion: CarMotion) -> list[Image]:
        """All strips of the left camera and then of the right one, with motion blur where the shutter is slow."""
        shutter = self.errors.shutter_s
        times = [-shutter * (k + 0.5) / BLUR_SAMPLES for k in range(BLUR_SAMPLES)] if shutter else [0.0]
        exposed = []
        for time in times:
            shots: list[Shot] = []
            for side, rects in enumerate(self.strips):
                views: dict[float, CameraView] = {}
                for rect in rects:
                    shot = []
                    for part, delay in readout(rect, self.errors.readout_s, self.rig.height):
                        if delay not in views:
                            views[delay] = self.view(*moved(pose, motion, time + delay), side)
                        shot.append((views[delay], part))
                    shots.append(shot)
            exposed.append(self.render(shots))
        if len(exposed) == 1:
            return exposed[0]
        return [np.asarray(np.mean(same, 0) + 0.5).astype(np.uint8) for same in zip(*exposed, strict=True)]

    def render(self, shots: Sequence[Shot]) -> list[Image]:
        """The pixels of strips, each `[3, h, w]`, the colors of a pixel next to each other in memory."""
        cameras: list[Floats] = []
        parts, shapes, size = [], [], 0
        aimed: CameraView | None = None
        for shot in shots:  # the kernel takes the parts of one camera together
            top, wide = shot[0][1].top, shot[0][1].right - shot[0][1].left
            for view, part in shot:
                if view is not aimed:
                    cameras.append(self.projection(view))
                    aimed = view
                parts.append([len(cameras) - 1, *part, size + (part.top - top) * wide])
            shapes.append((size, shot[-1][1].bottom - top, wide))
            size += shapes[-1][1] * wide
        out, w = np.empty((size, 3), np.uint8), self.world
        rasterise(w.corners, w.surface, w.texels, w.mipmaps, np.array(cameras), np.array(parts), REACH, out)
        return [out[n : n + high * wide].reshape(high, wide, 3).transpose(2, 0, 1) for n, high, wide in shapes]

    def frame(self, view: CameraView) -> Image:
        """A whole frame `[3, H, W]`."""
        return self.render([[(view, Rect(0, self.rig.height, 0, self.rig.width))]])[0]

    def projection(self, view: CameraView) -> Floats:
        """A camera as the kernel `visible_triangles` takes it, `[4, 3]`."""
        focal, (column, row) = self.rig.focal * (1 + self.errors.focal_error_ratio), self.rig.center
        across = focal * np.cross(view.forward, view.up) + column * view.forward
        return np.stack((view.position, across, row * view.forward - focal * view.up, view.forward))

    def view(self, x: float, y: float, heading: float, side: int) -> CameraView:
        """The pose of a camera: 0 the left one, 1 the right one."""
        e, rig = self.errors, self.rig
        ahead, left = direction(heading), direction(heading + math.pi / 2)
        aside = (0.5 - side) * rig.baseline * (1 + e.baseline_error_ratio)
        position = np.array([x, y, rig.camera_height]) + rig.forward * ahead + aside * left
        yaw, roll = heading + math.radians(e.yaw_deg + side * e.right_yaw_deg), math.radians(e.roll_deg)
        pitch, vertical = rig.pitch + math.radians(e.pitch_deg), np.array([0.0, 0.0, 1.0])
        ahead, left = direction(yaw), direction(yaw + math.pi / 2)
        upward = math.sin(pitch) * ahead + math.cos(pitch) * vertical
        forward = math.cos(pitch) * ahead - math.sin(pitch) * vertical
        return CameraView(position, forward, math.cos(roll) * upward - math.sin(roll) * left)


def direction(angle: float) -> Floats:
    return np.array([math.cos(angle), math.sin(angle), 0.0])


def moved(pose: Pose, motion: CarMotion, seconds: float) -> Pose:
    """Where the car is after a time on its arc."""
    x, y, heading = pose
    length = motion.speed * seconds
    half = motion.curvature * length / 2
    return x + length * math.cos(heading + half), y + length * math.sin(heading + half), heading + 2 * half


def readout(rect: Rect, seconds: float, height: int) -> Iterator[tuple[Rect, float]]:
    """Parts of a rectangle, and when a rolling shutter reads each, s from the middle of the frame."""
    step = ROLLING_ROWS if seconds else rect.bottom - rect.top
    for top in range(rect.top, rect.bottom, step):
        part = rect._replace(top=top, bottom=min(top + step, rect.bottom))
        yield part, seconds * ((part.top + part.bottom) / 2 / height - 0.5)
