"""Are the cameras all right? Asked before every step, because the navigator would believe anything."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ndtorch.errors import InputError
from ndtorch.navigation import StereoRig, Strips, cut_strips
from ndtorch_robot.ports import StereoFrames

NAMES = ("left", "right")

PATIENCE = 15
"""Frames in a row that must look wrong: half a second. One lost frame is no reason to stop."""

DARK = 0.012
"""A row of which no pixel is brighter is black: three levels of 256."""

MOVING = 0.1
"""Speed from which the picture must change, m/s."""


class CameraWatch:
    """Raises `InputError` when frames cannot be trusted; the loop then stops the car.

    Noticed at once: a camera without a frame, times that do not increase, cameras that give frames of two
    sizes or kinds. After `PATIENCE` frames: a camera that sees black, and a camera whose picture stays the same
    to the bit while the car drives and the other camera's changes. Black is judged by the horizon row. The same
    is judged by the subfield, because floor that is seen must move; where a blank wall hides it nobody can say.

    Args:
        rig: the camera pair.
        patience: frames in a row that must look wrong.
        together: two pictures that stay the same together are a fault as well. Not in a world that may stop.
    """

    def __init__(self, rig: StereoRig, patience: int = PATIENCE, together: bool = False) -> None:
        self.rig, self.patience, self.fields = rig, patience, rig.subfields()
        self.together = together
        self.time = -math.inf
        self.last: list[Tensor | None] = [None, None]
        self.dark = [0, 0]
        self.frozen = [0, 0]

    def check(self, frames: StereoFrames, speed: float) -> None:
        """Look at new frames.

        Args:
            speed: of the car since the last ones, m/s.
        """
        if not frames.time > self.time:
            raise InputError(f"times of frames must increase, got {frames.time:.3f} s after {self.time:.3f} s")
        self.time = frames.time
        eyes = [self.strips(frames.left, 0), self.strips(frames.right, 1)]
        left, right = (eye.row for eye in eyes)
        if left.shape != right.shape or left.dtype != right.dtype:
            raise InputError(
                f"left and right frames must be alike, got rows of {left.dtype} {tuple(left.shape)} "
                f"and {right.dtype} {tuple(right.shape)}"
            )
        same = [old is not None and torch.equal(old, eye.field) for old, eye in zip(self.last, eyes, strict=True)]
        self.last = [eye.field for eye in eyes]
        for k, name in enumerate(NAMES):
            darkest = DARK * 255 if left.dtype == torch.uint8 else DARK
            floor = eyes[k].field
            alone = self.together or not same[1 - k]
            # Something must be in it: a blank wall that fills the subfield looks the same from everywhere.
            mixed = bool((floor.amax((-2, -1)) > floor.amin((-2, -1))).any())
            stuck = same[k] and alone and abs(speed) > MOVING and mixed
            self.dark[k] = self.dark[k] + 1 if float(eyes[k].row.max()) <= darkest else 0
            self.frozen[k] = self.frozen[k] + 1 if stuck else 0
            if self.dark[k] >= self.patience:
                raise InputError(f"the {name} camera has seen nothing but black for {self.patience} frames")
            if self.frozen[k] >= self.patience:
                raise InputError(f"the {name} camera has given the same picture for {self.patience} frames")

    def strips(self, eye: Tensor | Strips | None, k: int) -> Strips:
        """The subfield and the horizon row of one camera."""
        if eye is None:
            raise InputError(f"the {NAMES[k]} camera gave no frame")
        if isinstance(eye, Strips):
            return eye
        if tuple(eye.shape[-2:]) != (self.rig.height, self.rig.width):
            raise InputError(
                f"the {NAMES[k]} camera gives {eye.shape[-1]}x{eye.shape[-2]} frames, "
                f"{self.rig.width}x{self.rig.height} are wanted"
            )
        return cut_strips(eye, self.fields[k], self.rig)
