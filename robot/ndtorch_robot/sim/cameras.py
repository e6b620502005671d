"""Two simulated cameras: whole frames, or only the pixels that navigation reads."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import torch

from ndtorch.navigation import Rect, StereoRig, Strips
from ndtorch.navigation.stereo.strips import row_rect
from ndtorch_robot.sim.disturbances.registry import CameraErrors
from ndtorch_robot.sim.procedural_textures import Image
from ndtorch_robot.sim.render.renderers import Lens, Shot, Vector, View, make_renderer

if TYPE_CHECKING:
    import mujoco

Frame = torch.Tensor | Strips
Pose = tuple[float, float, float]

BLUR_SAMPLES = 4
"""Frames whose mean is a frame with motion blur."""

ROLLING_ROWS = 12
"""Rows that a rolling shutter reads at one time."""


class Motion(NamedTuple):
    """Speed, m/s, and curvature, 1/m, of the car while the shutter is open."""

    speed: float = 0.0
    curvature: float = 0.0


STOPPED = Motion()


class Cameras:
    """Renders what the cameras of a rig see from a pose of the car.

    Strips are pasted into whole frames, so that a drive does not depend on which of the two is rendered.

    Args:
        model: the world.
        rig: the camera pair.
        fields: the subfields of both images; `rig.subfields()` by default.
        full_frames: render whole frames instead of strips.
        errors: how the real cameras differ from `rig`.

    Raises:
        InputError: a world that needs OpenGL where that does not work.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        rig: StereoRig,
        fields: tuple[Rect, Rect] | None = None,
        full_frames: bool = False,
        errors: CameraErrors | None = None,
    ) -> None:
        self.rig, self.full_frames, self.errors = rig, full_frames, errors or CameraErrors()
        self.fields = fields or rig.subfields()
        self.row = row_rect(rig)
        self.strips = tuple((field, self.row) for field in self.fields)
        focal = rig.focal * (1 + self.errors.focal)
        self.renderer = make_renderer(model, Lens(focal, rig.center, rig.width, rig.height))

    def look(self, data: mujoco.MjData, x: float, y: float, heading: float, motion: Motion = STOPPED) -> list[Frame]:
        """What the left and the right camera see with the car there: frames `[1, 3, H, W]` uint8, or `Strips`."""
        self.renderer.update(data)
        pose, frames = (x, y, heading), list[Frame]()
        pieces = iter(self.expose(pose, motion))
        for side, rects in enumerate(self.strips):
            parts = [next(pieces) for _ in rects]
            if self.full_frames:
                frame = self.renderer.frame(self.view(*pose, side))
                for rect, part in zip(rects, parts, strict=True):
                    frame[:, rect.top : rect.bottom, rect.left : rect.right] = part
                frames.append(torch.from_numpy(frame)[None])
            else:
                frames.append(Strips(*(torch.from_numpy(part)[None] for part in parts)))
        return frames

    def expose(self, pose: Pose, motion: Motion) -> list[Image]:
        """All strips of the left camera and then of the right one, with motion blur where the shutter is slow."""
        shutter = self.errors.shutter
        times = [-shutter * (k + 0.5) / BLUR_SAMPLES for k in range(BLUR_SAMPLES)] if shutter else [0.0]
        exposed = [self.render(pose, motion, time) for time in times]
        if len(exposed) == 1:
            return exposed[0]
        return [np.asarray(np.mean(same, 0) + 0.5).astype(np.uint8) for same in zip(*exposed, strict=True)]

    def render(self, pose: Pose, motion: Motion, time: float) -> list[Image]:
        """All strips, `time` seconds after the car was at a pose."""
        shots: list[Shot] = []
        for side, rects in enumerate(self.strips):
            views: dict[float, View] = {}
            for rect in rects:
                shot = []
                for part, delay in readout(rect, self.errors.readout, self.rig.height):
                    if delay not in views:
                        views[delay] = self.view(*moved(pose, motion, time + delay), side)
                    shot.append((views[delay], part))
                shots.append(shot)
        return self.renderer.strips(shots)

    def view(self, x: float, y: float, heading: float, side: int) -> View:
        """The pose of a camera: 0 the left one, 1 the right one."""
        cos, sin = math.cos(heading), math.sin(heading)
        ahead, rig = self.rig.forward, self.rig
        aside = (0.5 - side) * rig.baseline * (1 + self.errors.baseline)
        position = (x + ahead * cos - aside * sin, y + ahead * sin + aside * cos, rig.camera_height)
        return View(position, *axes(heading, side, self.errors, rig.pitch))

    def close(self) -> None:
        self.renderer.close()


def axes(heading: float, side: int, errors: CameraErrors, pitch: float = 0.0) -> tuple[Vector, Vector]:
    """The optical and the upward axis of a camera: 0 the left one, 1 the right one."""
    yaw = heading + (errors.yaw + side * errors.right_yaw)
    pitch, roll = pitch + errors.pitch, errors.roll
    ahead, left = (math.cos(yaw), math.sin(yaw), 0.0), (-math.sin(yaw), math.cos(yaw), 0.0)
    forward = (math.cos(pitch) * ahead[0], math.cos(pitch) * ahead[1], -math.sin(pitch))
    upward = (math.sin(pitch) * ahead[0], math.sin(pitch) * ahead[1], math.cos(pitch))
    x, y, z = (math.cos(roll) * u - math.sin(roll) * w for u, w in zip(upward, left, strict=True))
    return forward, (x, y, z)


def moved(pose: Pose, motion: Motion, seconds: float) -> Pose:
    x, y, heading = pose
    length = motion.speed * seconds
    turned = motion.curvature * length
    half = turned / 2
    return x + length * math.cos(heading + half), y + length * math.sin(heading + half), heading + turned


def readout(rect: Rect, seconds: float, height: int) -> Iterator[tuple[Rect, float]]:
    """Parts of a rectangle, and when a rolling shutter reads each, s from the middle of the frame."""
    step = ROLLING_ROWS if seconds else rect.bottom - rect.top
    for top in range(rect.top, rect.bottom, step):
        part = rect._replace(top=top, bottom=min(top + step, rect.bottom))
        yield part, seconds * ((part.top + part.bottom) / 2 / height - 0.5)
