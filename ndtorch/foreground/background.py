"""Background of a static camera's video: mean and noise of every pixel -> foreground mask of each frame.

A pixel is foreground if it differs from the mean by more than a multiple of its noise (running average and deviation,
Wren et al. 1997). Shadows are removed by their equal loss of light in all colors (Cucchiara et al. 2003), except
from grey films, where a darker object loses light in the same way. A background is known once nothing has moved there
for a while; before, broad motion is foreground.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from ndtorch.config import Constants, constant
from ndtorch.errors import InputError
from ndtorch.foreground._kernels import (
    compare,
    follow_rest,
    learn_pixels,
    light_ratios,
    mark_candidates,
    mark_motion,
    shadow_marks,
)
from ndtorch.utils.tensors import safe_state
from ndtorch.vision.temporal import smoothing_factor

Floats = npt.NDArray[np.float32]
Bytes = npt.NDArray[np.uint8]
Labels = npt.NDArray[np.int32]
Numbers = npt.NDArray[np.float64]

SQUARE = np.ones((3, 3), np.uint8)
"""Element of dilations by a pixel."""
MEAN_SIZE, MEDIAN_SIZE = 0.798, 0.6745
"""Mean and median of the magnitude of a normal variable, in standard deviations."""
TAU_NOISE_S, OUTLIER = 4.0, 3.0
"""Time constant of the noise, and the largest deviation from which it is learned, in its present values."""
MIN_MOTION, MIN_COLOR_MOTION, MOTION_TRAIL_S, MIN_MOTION_SIDE = 0.012, 0.1, 0.1, 0.06
"""Smallest change from frame to frame that is motion, of grey and of a color (of full scale), how long it counts where
no background is known, and the smallest side of what counts there (of the height)."""
STARTING_S = 2.0
"""From then on, a pixel needs the less time without motion the longer the scene has lasted."""
STEP = 4
"""Medians are taken of every so many pixels across and down."""
DARK, MAX_GAIN = 0.04, 4.0
"""The exposure is measured where the background is lighter than this (of full scale), and corrected by at most this."""
LIGHT_OFFSET, WINDOW_PX, MAX_VARIATION, PENUMBRA_PX = 0.02, 5, 0.06, 2
"""Shadows: light added before a ratio is taken, window in which the ratio varies by at most so much, width of edges."""
NARROW_TINT, MIN_COLORFULNESS, GREY = 0.05, 0.015, 1 / 255
"""A narrow shadow changes the colors' shares by at most this; it is told by its tint where the background has this mean
distance between its largest and smallest color. With less than the last, a film is grey: no shadows are removed."""
COAT = 0.03
"""What looks like a shadow in a gap of this fraction of the height belongs to the foreground around it: a dark coat."""
CUT_AREA, CUT_CHANGE, CUT_BLOCKS, BLOCK_PX, CUT_CORRELATION = 0.7, 0.02, 0.6, 8, 0.25
"""A new scene: foreground of this fraction of the image, or changes by so much (of full scale) of this fraction of the
blocks, of so many pixels, while they correlate by less than this with those before."""


class BackgroundParams(Constants):
    """Constants of the background model; brightness is a fraction of full scale."""

    max_height_px: int = constant(
        288, "Frames are shrunk by a whole number to at most this many rows.", ge=16, le=32_768
    )
    tau_background: float = constant(10.0, "The background follows with this time constant in seconds.", gt=0)
    threshold_sigma: float = constant(
        3.0, "A pixel is foreground if it differs by more than this many standard deviations.", gt=0
    )
    min_noise_ratio: float = constant(
        0.006, "The noise is at least this standard deviation (fraction of full scale).", gt=0
    )
    static_after_s: float = constant(
        0.5, "A pixel without motion for this many seconds is background, or a ghost in it.", ge=0
    )
    shadow_min_ratio: float = constant(
        0.4, "A shadow leaves at least this fraction of the background's light.", ge=0, le=1
    )
    shadow_max_tint_ratio: float = constant(0.12, "A shadow changes the colors' shares by at most this fraction.", ge=0)


@safe_state
class BackgroundState(NamedTuple):
    """State of the background model; arrays in a call, tensors between calls.

    Attributes:
        mean: background, `[3, h, w]` float32.
        deviation: mean distance from it, the largest of the colors, `[h, w]` float32.
        previous: the blurred frame before, `[3, h, w]` float32.
        static_time: seconds without motion, `[h, w]` float32.
        known: 1 where the background is known, else 0, `[h, w]` uint8.
        frames: frames since the scene began, int64 scalar.
    """

    mean: Any
    deviation: Any
    previous: Any
    static_time: Any
    known: Any
    frames: Any


class Segmentation(NamedTuple):
    """One segmented frame.

    Attributes:
        image: without its gain, `[3, h, w]`.
        distance: from the background, the largest of the colors, `[h, w]`.
        sigma: standard deviation of the noise, `[h, w]`.
        mask: 1 for foreground, else 0, `[h, w]` uint8.
        cut: whether a new scene begins.
    """

    image: Floats
    distance: Floats
    sigma: Floats
    mask: Bytes
    cut: bool


def start_background(image: Floats, p: BackgroundParams) -> BackgroundState:
    """The state before the first frame `[3, h, w]`: no background is known."""
    plane = np.zeros(image.shape[1:], np.float32)
    noise = plane + np.float32(p.min_noise_ratio * MEAN_SIZE)
    still = plane + np.float32(MOTION_TRAIL_S)
    return BackgroundState(image.copy(), noise, blurred(image), still, plane.astype(np.uint8), np.zeros((), np.int64))


def segment(raw: Floats, s: BackgroundState, dt: float, p: BackgroundParams) -> Segmentation:
    """Foreground mask of a frame `[3, h, w]`, 0..1; `previous` and `static_time` of the state are updated."""
    import cv2

    shape = raw.shape[1:]
    gain = exposure_gain(raw, s.mean)
    image, distance, sigma = np.empty_like(raw), np.empty(shape, np.float32), np.empty(shape, np.float32)
    candidates = np.empty(shape, np.uint8)
    compare(raw, gain, s.mean, image, distance)
    noise = max(median(distance[::STEP, ::STEP]) / MEDIAN_SIZE, p.min_noise_ratio)
    count = mark_candidates(distance, s.deviation, MEAN_SIZE, noise, p.threshold_sigma, sigma, candidates)
    smooth = blurred(image)
    mask, moved, change = motion(smooth, candidates, s, dt, p)
    faded = (np.abs(np.log(gain)) > 0.999 * math.log(MAX_GAIN)).sum() > 1
    # Less change in all cannot be enough in most blocks.
    other = change > CUT_CHANGE * CUT_BLOCKS and is_other_scene(smooth, s.previous)
    if faded or other or count > CUT_AREA * candidates.size:
        return Segmentation(raw, distance, sigma, np.zeros(shape, np.uint8), True)
    s.previous[...] = smooth
    mask = without_shadow(mask, image, s.mean, p)
    return Segmentation(image, distance, sigma, np.asarray(cv2.medianBlur(mask | moved, 3), np.uint8), False)


def learn(seen: Segmentation, kept: Bytes, s: BackgroundState, dt: float, p: BackgroundParams) -> None:
    """Let the background and its noise follow a frame where `kept` is 0; the state's arrays are updated.

    Where it is not known, the background is the mean since something moved.
    """
    s.frames[...] += 1
    seconds = float(s.frames) * dt
    noise_pace = max(1 / (float(s.frames) + 5), smoothing_factor(TAU_NOISE_S, dt))
    needed = p.static_after_s * min(1.0, STARTING_S / seconds)
    paces = smoothing_factor(p.tau_background, dt), noise_pace, OUTLIER * MEAN_SIZE, dt, needed
    learn_pixels(seen.image, seen.distance, seen.sigma, kept, s.static_time, paces, s.mean, s.deviation, s.known)


def median(values: npt.NDArray[Any]) -> float:
    """Median of all values: `np.median` without its checks."""
    half = values.size // 2
    parted = np.partition(values.ravel(), half)
    upper = float(parted[half])
    return upper if values.size % 2 else (upper + float(parted[:half].max())) / 2


def exposure_gain(image: Floats, background: Floats) -> Floats:
    """Median ratio of each color to the background where that is not dark, `[3]`; 1 where nearly all of it is."""
    sampled = -(-image.shape[1] // STEP) * -(-image.shape[2] // STEP)
    ratios = np.empty((3, sampled), np.float32)
    lit = light_ratios(image, background, DARK, STEP, ratios)
    if lit < 0.1 * sampled:
        return np.ones(3, np.float32)
    return np.array([median(own[:lit]) for own in ratios], np.float32).clip(1 / MAX_GAIN, MAX_GAIN)


def motion(
    smooth: Floats, candidates: Bytes, s: BackgroundState, dt: float, p: BackgroundParams
) -> tuple[Bytes, Bytes, float]:
    """Update the time without motion.

    A pixel moves if it changes by more than the noise, and, where no background is known, if it is a candidate.

    Returns:
        Candidates where the background is known, and broad motion elsewhere, `[h, w]`; mean change of brightness.
    """
    import cv2

    red, green, blue = smooth[:, ::STEP, ::STEP] - s.previous[:, ::STEP, ::STEP]
    noise = median(np.abs(red + green + blue)) / 3 / MEDIAN_SIZE
    least = max(MIN_MOTION, p.threshold_sigma * noise)
    moves, mask, recent = np.empty((3, *candidates.shape), np.uint8)
    change = mark_motion(smooth, s.previous, candidates, s.known, least, MIN_COLOR_MOTION, moves)
    wide = cv2.dilate(cv2.medianBlur(moves, 3), SQUARE)
    if follow_rest(wide, s.known, candidates, dt, MOTION_TRAIL_S, s.static_time, mask, recent):
        side = 2 * round(MIN_MOTION_SIDE * len(mask) / 2) + 1
        recent = np.asarray(cv2.morphologyEx(recent, cv2.MORPH_OPEN, np.ones((side, side), np.uint8)), np.uint8)
    return mask, recent, change


def without_shadow(mask: Bytes, image: Floats, background: Floats, p: BackgroundParams) -> Bytes:
    """A mask without pixels that only lost light, by about the same share in all colors and among neighbours."""
    import cv2

    left, top, width, height = cv2.boundingRect(cv2.medianBlur(mask, 3))
    colors = background[:, ::STEP, ::STEP]
    colorfulness = float((colors.max(0) - colors.min(0)).mean())
    if not width or colorfulness < GREY:
        return mask
    rows = slice(max(0, top - WINDOW_PX), top + height + WINDOW_PX)
    columns = slice(max(0, left - WINDOW_PX), left + width + WINDOW_PX)
    own = mask[rows, columns]
    light, marks = np.empty(own.shape, np.float32), np.empty(own.shape, np.uint8)
    limits = p.shadow_min_ratio, 2 * p.shadow_max_tint_ratio, 2 * NARROW_TINT
    shadow_marks(image, background, rows.start, columns.start, LIGHT_OFFSET, limits, light, marks)
    window, mean = (WINDOW_PX, WINDOW_PX), cv2.blur(light, (WINDOW_PX, WINDOW_PX))
    varies = cv2.subtract(cv2.blur(cv2.multiply(light, light), window), cv2.multiply(mean, mean))
    even = np.asarray(varies < MAX_VARIATION**2).view(np.uint8) & marks
    even = np.asarray(cv2.dilate(even, np.ones((2 * PENUMBRA_PX + 1, 2 * PENUMBRA_PX + 1), np.uint8)), np.uint8)
    narrow = marks >> 1 if colorfulness > MIN_COLORFULNESS else np.uint8(0)
    lit = own & ~(marks & even | narrow) & 1
    side = 2 * round(COAT * len(mask) / 2) + 1
    found = np.zeros_like(mask)
    found[rows, columns] = cv2.bitwise_and(cv2.morphologyEx(lit, cv2.MORPH_CLOSE, np.ones((side, side), np.uint8)), own)
    return found


def blurred(image: Floats) -> Floats:
    """Each color of `[3, h, w]`, blurred."""
    import cv2

    out = np.empty_like(image)
    for plane, to in zip(image, out, strict=True):
        cv2.blur(plane, (3, 3), to)
    return out


def is_other_scene(smooth: Floats, previous: Floats) -> bool:
    """Whether most blocks changed, and are bright elsewhere than before; a change of light leaves them correlated."""
    import cv2

    size = (max(2, smooth.shape[2] // BLOCK_PX), max(2, smooth.shape[1] // BLOCK_PX))
    greys = [(planes[0] + planes[1] + planes[2]) / np.float32(3) for planes in (smooth, previous)]
    one, other = (np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA)) for grey in greys)
    if (np.abs(one - other) > CUT_CHANGE).mean() < CUT_BLOCKS:
        return False
    one, other = one - one.mean(), other - other.mean()
    return float((one * other).sum()) <= CUT_CORRELATION * math.sqrt(float((one**2).sum() * (other**2).sum()))


def is_ghost(region: Bytes, around: Bytes, image: Floats, background: Floats) -> bool:
    """Whether an object stood in a region of the foreground when the background was learned, and has left: the edges
    of the region are those of the background, not those of the image.

    Args:
        region: 1 inside, and around: 1 for other foreground, `[h, w]` uint8.
        image, background: `[3, h, w]`.
    """
    import cv2

    edge = np.asarray(cv2.subtract(cv2.dilate(region, SQUARE), cv2.erode(region, SQUARE)))
    edge = np.asarray(cv2.subtract(edge, cv2.dilate(around, SQUARE)))
    if not edge.any():
        return False
    strengths = []
    for picture in (image, background):
        grey = picture[0] + picture[1] + picture[2]
        slopes = cv2.Sobel(grey, cv2.CV_32F, 1, 0), cv2.Sobel(grey, cv2.CV_32F, 0, 1)
        strengths.append(float(cv2.magnitude(*slopes)[edge > 0].mean()))
    return strengths[0] < strengths[1]


def downscale(frame: Tensor, size: tuple[int, int]) -> Floats:
    """A frame `[3, H, W]` averaged to that height and width, `[3, h, w]`, 0..1.

    Floats are rounded to the 256 levels of uint8: a picture gives the same numbers in whatever type it comes.

    Raises:
        InputError: NaN or infinite values.
    """
    import cv2

    if frame.dtype != torch.uint8:
        if not torch.isfinite(frame.sum()):
            raise InputError("frames must be finite, got NaN or infinite values")
        frame = (frame * 255).round_().clamp_(0, 255).to(torch.uint8)
    planes = frame.detach().cpu().numpy()
    picture = planes.transpose(1, 2, 0)
    if planes.shape[1:] == size:
        small = planes
    elif picture.flags.c_contiguous:
        small = np.asarray(cv2.resize(picture, size[::-1], interpolation=cv2.INTER_AREA)).transpose(2, 0, 1)
    else:
        small = np.stack([cv2.resize(plane, size[::-1], interpolation=cv2.INTER_AREA) for plane in planes])
    scaled = np.multiply(small, np.float32(1 / 255), order="C", dtype=np.float32)
    return np.asarray(scaled, np.float32)
