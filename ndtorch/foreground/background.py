"""Background model: mean and deviation of every pixel of a static camera, and where they are known."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from ndtorch.config import Constants, constant
from ndtorch.foreground._kernels import SWINGS, LearningRates, learn
from ndtorch.foreground.arrays import Bools, Bytes, Floats, aligned, aligned_copy
from ndtorch.foreground.swinging import STRIDE, SWINGING
from ndtorch.foreground.swinging import start as start_swinging
from ndtorch.vision.temporal import smoothing_factor as checked_smoothing_factor

smoothing_factor = cache(checked_smoothing_factor)
"""It checks its arguments, which are always the same here."""

LEARNING_S = 2.0
"""In the first seconds of a scene a pixel is known sooner: the time without motion that it needs grows until then."""
MIN_MOVING_SIDE_RATIO = 0.06
"""Where the background is not known, what moves is foreground if it is this broad (fraction of the height)."""
MOTION_TRAIL_S = 0.1
"""Where the background is not known, what moved within this time is foreground."""
BLUR_PX = 3
"""Frames are blurred by a square of this side before motion is measured."""
SHADOW_CLOSING_RATIO = 0.04
"""Shadow within this distance between foreground parts is foreground (fraction of the height): a dark coat."""

OUTLIER_LIMIT = 3.0
"""One step teaches the noise at most this many times its present value."""


class BackgroundParams(Constants):
    """Constants of the background model; brightness is a fraction of full scale."""

    max_height_px: int = constant(
        224, "Frames are shrunk by a whole number to at most this many rows.", ge=16, le=32_768
    )
    tau_background: float = constant(10.0, "The background follows with this time constant in seconds.", gt=0)
    tau_noise: float = constant(4.0, "The noise of a pixel follows with this time constant in seconds.", gt=0)
    threshold_sigma: float = constant(
        3.0, "A pixel is foreground if it differs by more than this many standard deviations.", gt=0
    )
    min_noise_ratio: float = constant(
        0.006, "The noise is at least this standard deviation (fraction of full scale).", gt=0
    )
    min_motion_ratio: float = constant(
        0.012, "A pixel moves if it changes by at least this from frame to frame (of full scale).", gt=0
    )
    static_after_s: float = constant(
        0.5, "A pixel without motion for this many seconds is background, or a ghost in it.", ge=0
    )
    object_learning_ratio: float = constant(
        0.05, "The background under an object follows at this fraction of its pace.", ge=0
    )
    shadow_min_ratio: float = constant(
        0.4, "A shadow leaves at least this fraction of the background's light.", ge=0, le=1
    )
    shadow_max_tint_ratio: float = constant(0.12, "A shadow changes the colors' shares by at most this fraction.", ge=0)
    shadow_max_variation_ratio: float = constant(
        0.06, "The remaining light of a shadow varies by at most this among neighbours.", ge=0
    )


class BackgroundState(NamedTuple):
    """State of the background model; its parts are arrays, or tensors in the state of a model.

    Attributes:
        mean, deviation: background and mean deviation from it, `[3, h, w]`.
        previous: the blurred frame before, `[3, h, w]`.
        flicker: mean change from frame to frame, `[h, w]`.
        static_time: seconds without motion, `[h, w]`.
        initialised: 1 where the background is known, 0 elsewhere, `[h, w]`.
        frames: frames seen since the scene began, int64 scalar.
        swinging: see `ndtorch.foreground.swinging`, `[5, h / 2, w / 2]` uint8.
    """

    mean: Any
    deviation: Any
    previous: Any
    flicker: Any
    static_time: Any
    initialised: Any
    frames: Any
    swinging: Any


@dataclass
class BackgroundModel:
    """A `BackgroundState` in arrays of its own, which each step changes in place, with buffers for the images of a
    step, and the number of pixels where the background is `unknown`."""

    mean: Floats
    deviation: Floats
    previous: Floats
    flicker: Floats
    static_time: Floats
    initialised: Floats
    frames: int
    swinging: Bytes

    def __post_init__(self) -> None:
        shape = self.mean.shape
        self.image, self.blurred, (self.grey, self.light) = aligned(*shape), aligned(*shape), aligned(2, *shape[1:])
        self.marks = np.empty((5, *shape[1:]), np.uint8)
        self.unknown = int((self.initialised == 0).sum())

    @classmethod
    def start(cls, image: Floats, p: BackgroundParams) -> BackgroundModel:
        """Settled on one image `[3, h, w]`: no background is known."""
        # Nothing has moved yet.
        planes = aligned(3, *image.shape[1:])
        planes[0], planes[1], planes[2] = p.min_noise_ratio, MOTION_TRAIL_S, 0
        deviation, previous = aligned(*image.shape), aligned(*image.shape)
        deviation[...] = p.min_noise_ratio
        blur(image, previous)
        swinging = start_swinging(*image.shape[1:])
        return cls(aligned_copy(image), deviation, previous, planes[0], planes[1], planes[2], 0, swinging)

    @classmethod
    def of(cls, state: BackgroundState) -> BackgroundModel:
        """A copy of a state."""
        mean, deviation, previous, flicker, static_time, initialised = map(aligned_copy, state[:6])
        swinging = np.asarray(state.swinging).copy()
        return cls(mean, deviation, previous, flicker, static_time, initialised, int(state.frames), swinging)

    def state(self) -> BackgroundState:
        """The present state, which shares the memory."""
        planes = (self.mean, self.deviation, self.previous, self.flicker, self.static_time, self.initialised)
        return BackgroundState(*planes, np.array(self.frames, np.int64), self.swinging)


def blur(image: Floats, blurred: Floats) -> None:
    """Every color `[3, h, w]` blurred by a square, into such an array."""
    import cv2

    for plane, to in zip(image, blurred, strict=True):
        cv2.blur(plane, (BLUR_PX, BLUR_PX), dst=to)


def update_background(
    model: BackgroundModel, image: Floats, noise: Floats, kept: Floats, dt: float, p: BackgroundParams
) -> None:
    """Let the background, its deviation and where it is known follow an image.

    The background follows at its pace, and under an object at `object_learning_ratio` of it. Before it is known, it is
    the mean of what was seen since something moved.

    Args:
        model: updated.
        image: without its gain, `[3, h, w]`.
        noise: of each color, `[3]`.
        kept: 1 where tracked objects are, 3 where long stationary ones are, `[h, w]`; becomes 2 where they swing.
        dt: seconds of a step.
    """
    model.frames = seen = model.frames + 1
    if model.swinging[SWINGING].any():
        height, width = kept.shape
        swinging = model.swinging[SWINGING].repeat(STRIDE, 0)[:height].repeat(STRIDE, 1)[:, :width]
        kept[(swinging > 0) & (kept > 0)] = SWINGS
    rates = LearningRates(
        needed=p.static_after_s * LEARNING_S / max(LEARNING_S, seen * dt),
        dt=dt,
        background=smoothing_factor(p.tau_background, dt),
        noise=noise_share(seen, dt, p),
        object_ratio=p.object_learning_ratio,
        outlier_limit=OUTLIER_LIMIT,
    )
    known = (model.static_time, model.initialised, model.unknown)
    model.unknown = learn(image, noise, kept, model.mean, model.deviation, *known, rates)


def replace_background(model: BackgroundModel, image: Floats, ghost: Bools) -> None:
    """An image becomes background where an object was that has left, `[h, w]`, and around it."""
    import cv2

    wide = cv2.dilate(ghost.astype(np.uint8), np.ones((3, 3), np.uint8))
    np.copyto(model.mean, image, where=np.asarray(wide) > 0)


def noise_share(frames: int, dt: float, p: BackgroundParams) -> float:
    """Share by which the noise follows: that of the first frames is learned as their mean."""
    return max(1 / (frames + 5), smoothing_factor(p.tau_noise, dt))
