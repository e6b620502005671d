"""Figure and ground: which pixels of a camera's picture stand out from a slow background, shadows left out."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import torch
from pydantic import Field
from torch import Tensor

from ndtorch.config import Constants
from ndtorch.vision.temporal import smoothing_factor

Floats = npt.NDArray[np.float32]
Bools = npt.NDArray[np.bool_]
MEAN_SIZE, MEDIAN_SIZE = 0.798, 0.6745
"""Mean magnitude of a normal variable against its standard deviation, and median of its magnitude likewise."""


SAMPLES = 11
"""Pictures whose median is the background at first."""


class GroundParams(Constants):
    """Constants of figure and ground; brightness as a share of full scale, times in seconds."""

    height: int = Field(120, ge=16, description="rows of the image on which figures are told from the ground")
    tau_ground: float = Field(10.0, gt=0, description="memory of the background")
    tau_noise: float = Field(4.0, gt=0, description="memory of the noise of every pixel")
    spread: float = Field(3.0, gt=0, description="standard deviations of the noise that count as standing out")
    least_noise: float = Field(0.006, gt=0, description="smallest standard deviation of the noise")
    settle: float = Field(1.0, ge=0, description="the background of the first seconds is the median of what was seen")
    moved: float = Field(0.012, gt=0, description="smallest change from picture to picture that is motion")
    hold: float = Field(0.05, ge=0, description="pace of the background where an object is, as a share")
    darkest: float = Field(0.3, ge=0, le=1, description="a shadow leaves at least this share of the light,")
    tint: float = Field(0.12, ge=0, description="changes the colors' shares by at most this,")
    uneven: float = Field(0.06, ge=0, description="and its own share varies by at most this among neighbours")
    penumbra: int = Field(2, ge=0, description="width of a shadow's edge, pixels of that image")
    around: float = Field(0.04, ge=0, description="what lies within this between parts that are no shadow is none")
    gain_limit: float = Field(4.0, ge=1, description="largest gain of the exposure, and 1 / the smallest")
    dark: float = Field(0.04, ge=0, lt=1, description="the exposure is told where the ground is lighter than this,")
    light: float = Field(0.1, ge=0, le=1, description="and only where that is at least this share of the picture")
    offset: float = Field(0.02, gt=0, description="added to both before the light of a shadow is a ratio")
    patch: int = Field(5, ge=1, description="side of what counts as neighbours, pixels of that image")
    speckle: int = Field(3, ge=1, description="side of the window in which most must stand out, and of what is left")
    surprise: float = Field(3.0, gt=0, description="the noise learns no more at a time than so many times itself")
    soft: int = Field(3, ge=1, description="side of the window that smooths pictures before motion is told")
    cut: float = Field(0.7, gt=0, le=1, description="share of the picture standing out that makes it a new scene")


class GroundState(NamedTuple):
    """What changes: background and mean deviation from it, `[3, h, w]`, pictures of the first seconds,
    `[SAMPLES, 3, h, w]`, and frames seen since it began, `[]`."""

    mean: Tensor
    deviation: Tensor
    samples: Tensor
    frames: Tensor


class Standing(NamedTuple):
    """One step's result: exposure-corrected picture and background `[3, h, w]`, and which pixels stand out,
    `[h, w]`."""

    picture: Floats
    ground: Floats
    figure: Bools


def ground_start(picture: Floats, deviation: float) -> GroundState:
    """State settled on one picture `[3, h, w]`."""
    return GroundState(
        torch.from_numpy(picture.copy()),
        torch.full(picture.shape, deviation, dtype=torch.float32),
        torch.from_numpy(np.repeat(picture[None], SAMPLES, 0)),
        torch.zeros((), dtype=torch.int64),
    )


def ground_step(
    picture: Floats, state: GroundState, kept: Floats, dt: float, params: GroundParams
) -> tuple[Standing, GroundState]:
    """One step.

    The exposure is corrected by the median ratio to the background, color by color. What differs by more than
    `spread` standard deviations of the noise stands out: of the picture's noise, or of the pixel's own where that is
    larger, as leaves and water flicker. What has only lost light, the same share in all colors and among
    neighbours, is a shadow. The background follows at its pace, the mean of all frames at first; where `kept` is 1
    (an object is there) only at `hold` of it.

    Args:
        picture: `[3, h, w]`, 0..1.
        kept: `[h, w]`, 0..1: where objects are that were followed up to the frame before.
        dt: seconds between pictures.
        params: constants.
    """
    import cv2

    p = params
    ground, deviation = state.mean.numpy(), state.deviation.numpy()
    gain = exposure(picture, ground, p)
    picture = np.asarray(picture / gain[:, None, None], np.float32)
    difference = picture - ground
    size = np.abs(difference)
    middle = np.median(size[:, ::4, ::4].reshape(3, -1), axis=1) / MEDIAN_SIZE
    noise = np.maximum(middle, p.least_noise).astype(np.float32)[:, None, None]
    threshold = p.spread * np.maximum(noise, deviation * np.float32(1 / MEAN_SIZE))
    over = size > threshold
    out = over[0] | over[1] | over[2]
    if out.mean() > p.cut:
        fresh = ground_start(np.ascontiguousarray(picture * gain[:, None, None], np.float32), p.least_noise)
        whole = fresh.mean.numpy()
        return Standing(whole, whole, np.zeros(out.shape, bool)), fresh
    shaded = shadow(picture, ground, p)
    seen = int(state.frames) + 1
    free = 1 - np.float32(1 - p.hold) * kept
    pace = np.float32(max(1 / (seen + 1), smoothing_factor(p.tau_ground, dt))) * free
    slow = np.float32(max(1 / (seen + 5), smoothing_factor(p.tau_noise, dt))) * free
    limited = np.minimum(size, p.surprise * np.maximum(noise, deviation))
    mean, samples = ground + pace * difference, state.samples
    at, last = (math.floor(n * dt / p.settle * SAMPLES) if p.settle else SAMPLES for n in (seen, seen - 1))
    if last < SAMPLES:
        # What passes covers a place for less than half of the time.
        mean = ground
        if at > last:
            samples = samples.clone()
            samples[min(at, SAMPLES - 1) :] = torch.from_numpy(picture)
            mean = np.median(samples[: min(at, SAMPLES - 1) + 1].numpy(), axis=0).astype(np.float32)
    after = GroundState(
        torch.from_numpy(mean),
        torch.from_numpy(deviation + slow * (limited - deviation)),
        samples,
        torch.tensor(seen, dtype=torch.int64),
    )
    core = (out & ~shaded).astype(np.uint8)
    # A dark coat looks like a shadow, but the rest of its wearer is around it.
    wide = 2 * round(p.around * core.shape[0] / 2) + 1
    closed = cv2.morphologyEx(core, cv2.MORPH_CLOSE, np.ones((wide, wide), np.uint8))
    figure = np.asarray(closed & out.astype(np.uint8), np.uint8) * np.uint8(255)
    # A pixel alone is noise; a gap of a pixel is none.
    figure = np.asarray(cv2.blur(figure, (p.speckle, p.speckle)), np.uint8)
    square = np.ones((p.speckle, p.speckle), np.uint8)
    figure = np.asarray(cv2.morphologyEx((figure > 127).astype(np.uint8), cv2.MORPH_OPEN, square))
    return Standing(picture, ground, np.asarray(figure > 0)), after


def exposure(picture: Floats, ground: Floats, p: GroundParams) -> Floats:
    """Gain of each color, `[3]`: the median ratio over every sixteenth pixel whose background is not dark."""
    one, other = picture[:, ::4, ::4].reshape(3, -1), ground[:, ::4, ::4].reshape(3, -1)
    bright = other.min(0) > p.dark
    if bright.mean() < p.light:
        return np.ones(3, np.float32)
    gain: Floats = np.clip(np.median(one[:, bright] / other[:, bright], axis=1), 1 / p.gain_limit, p.gain_limit).astype(
        np.float32
    )
    return gain


def shadow(picture: Floats, ground: Floats, p: GroundParams) -> Bools:
    """Where the picture is the background with less light, `[h, w]`."""
    import cv2

    small = np.float32(p.offset)
    ratio = (picture + small) / (ground + small)
    light: Any = (ratio[0] + ratio[1] + ratio[2]) * np.float32(1 / 3)
    tint = (ratio.max(0) - ratio.min(0)) <= np.float32(p.tint * 2) * light
    mean = cv2.blur(light, (p.patch, p.patch))
    varies = cv2.blur(light * light, (p.patch, p.patch)) - mean * mean
    may_be = ((light < 1) & (light > p.darkest) & tint).astype(np.uint8)
    inner = (may_be > 0) & (mean > p.darkest) & (varies < p.uneven**2)
    # Its edge, where neighbours differ, belongs to it.
    wide = cv2.dilate(inner.astype(np.uint8), np.ones((2 * p.penumbra + 1,) * 2, np.uint8))
    return np.asarray((wide & may_be) > 0)
