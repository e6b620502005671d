"""Illumination: the exposure of a frame against the background, its noise, and scene cuts."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ndtorch.foreground.arrays import Array, Floats
from ndtorch.foreground.background import BackgroundParams
from ndtorch.foreground.noise import BLOCK_CHANGE, BLOCK_PX, MEDIAN_SIZE, subsample
from ndtorch.utils.jit import jit
from ndtorch.utils.selection import median

DARK = 0.04
"""The exposure is measured where the background is lighter than this fraction of full scale."""
MAX_GAIN = 4.0
"""The exposure is corrected by at most this gain, or by one over it."""
CUT_CORRELATION = 0.25
"""Blocks are uncorrelated if they correlate by less than this with those before."""
MIN_LIT_RATIO = 0.1
"""The exposure is measured if at least this share of the background is lighter than `DARK`."""


class IlluminationLimits(NamedTuple):
    """Constants of `measure_illumination`."""

    max_gain: float
    min_noise: float


class Illumination(NamedTuple):
    """Gain and noise of each color, `[3]`, whether the frame shows another scene, and the mean distance between the
    largest and the smallest color of the background."""

    gain: Floats
    noise: Floats
    other_scene: bool
    colorfulness: float


def illumination(image: Floats, background: Floats, p: BackgroundParams) -> Illumination:
    """Illumination of an image `[3, h, w]` against the background.

    It shows another scene if it is the first after the dark, where there was nothing to compare with, or if two gains
    are at their limits, which is more than a camera's exposure control does.
    """
    gain, noise = np.empty(3, np.float32), np.empty(3, np.float32)
    limits = IlluminationLimits(MAX_GAIN, p.min_noise_ratio)
    lit, lit_before, colorfulness = measure_illumination(image, background, limits, gain, noise)
    extreme = (np.abs(np.log(gain)) >= np.log(MAX_GAIN) * (1 - 1e-6)).sum() > 1
    return Illumination(gain, noise, bool(extreme) or lit_before < MIN_LIT_RATIO <= lit, colorfulness)


@jit
def measure_illumination(
    image: Array, background: Array, limits: IlluminationLimits, gain: Array, noise: Array
) -> tuple[float, float, float]:
    """Median gain and noise of each color from about every sixteenth pixel.

    Args:
        image, background: `[3, h, w]`.
        gain, noise: become those of each color, `[3]`.

    Returns:
        Share of the image, and of the background, that is not dark, and the colorfulness of the background.
    """
    kind = image.dtype.type
    one = (subsample(image[0]), subsample(image[1]), subsample(image[2]))
    other = (subsample(background[0]), subsample(background[1]), subsample(background[2]))
    count, lit, bright = one[0].shape[0], 0, 0
    values, keep = np.empty(count, image.dtype), np.empty(count, np.bool_)
    for n in range(count):
        lit += min(one[0][n], one[1][n], one[2][n]) > kind(DARK)
        keep[n] = min(other[0][n], other[1][n], other[2][n]) > kind(DARK)
        bright += keep[n]
    measured = bright / count >= MIN_LIT_RATIO
    for c in range(3):
        gain[c] = 1
        if measured:
            k = 0
            for n in range(count):
                values[k] = one[c][n] / other[c][n]
                k += keep[n]
            gain[c] = min(max(median(values, k), kind(1 / limits.max_gain)), kind(limits.max_gain))
        for n in range(count):
            values[n] = abs(one[c][n] / gain[c] - other[c][n])
        noise[c] = max(median(values, count) / kind(MEDIAN_SIZE), kind(limits.min_noise))
    total, many = 0.0, 0
    for y in range(0, background.shape[1], 4):
        for x in range(0, background.shape[2], 4):
            red, green, blue = background[0, y, x], background[1, y, x], background[2, y, x]
            total += max(red, green, blue) - min(red, green, blue)
            many += 1
    return lit / count, bright / count, total / many


def changed_block_ratio(blurred: Floats, previous: Floats) -> float:
    """Share of the blocks of an image that changed at once: if it is large, it may be another scene.

    The noise of an image is measured over all of it, so a cut would pass for noise. Means of blocks hold little noise
    and are compared with a fixed difference from those of the frame before.

    Args:
        blurred, previous: this frame and the one before, `[3, h, w]`.
    """
    return float((np.abs(blocks(blurred - previous)).max(0) > BLOCK_CHANGE).mean())


def is_uncorrelated(blurred: Floats, previous: Floats) -> bool:
    """Whether blocks are bright elsewhere than before; after a change of light they are bright in the same places."""
    one, other = (grey - grey.mean() for grey in (blocks(blurred).mean(0), blocks(previous).mean(0)))
    product = (one * other).sum()
    return bool(product < CUT_CORRELATION * np.sqrt((one * one).sum() * (other * other).sum()))


def blocks(image: Floats) -> Floats:
    """Means of the blocks of an image, `[3, h', w']`."""
    import cv2

    size = (max(1, image.shape[2] // BLOCK_PX), max(1, image.shape[1] // BLOCK_PX))
    return np.stack([np.asarray(cv2.resize(plane, size, interpolation=cv2.INTER_AREA), np.float32) for plane in image])
