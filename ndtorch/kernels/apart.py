"""One pass over a small picture and its background: exposure, what stands out, and what both have become."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ndtorch.kernels.filters import Array
from ndtorch.kernels.nth import nth_of
from ndtorch.utils.jit import jit


class ApartNumbers(NamedTuple):
    """`CameraParams` as plain numbers, the filters' shares, and whether the exposure is corrected."""

    exposure: bool
    noise_floor: bool
    a_background: float
    a_deviation: float
    a_exposure: float
    mean_size: float
    median_size: float
    gain_limit: float
    darkest: float
    lit: float
    hold: float
    spread: float
    first_frames: float
    quietest: float
    outlier: float
    growth: float
    cut: float


@jit
def apart(
    picture: Array,
    mean: Array,
    deviation: Array,
    frames: int,
    p: ApartNumbers,
    corrected: Array,
    seen: Array,
    shown: Array,
    new_mean: Array,
    new_deviation: Array,
) -> tuple[float, bool]:
    """`exposure_gain`, `background_step` and `core` of `ndtorch.vision.camera`.

    Args:
        picture, mean, deviation: `[3, h, w]`.
        frames: how many were seen before.
        p: constants.
        corrected, seen: become the picture without its gain, and what of the difference is beyond the noise.
        shown: becomes by how much it is there, `[h, w]`.
        new_mean, new_deviation: become those after the step.

    Returns:
        The median of what a difference has to pass, and whether a new scene begins; then nothing else is of use.
    """
    _, height, width = picture.shape
    kind, one = picture.dtype.type, picture.dtype.type(1)
    gains, noises = np.ones(3, picture.dtype), np.empty(3, picture.dtype)
    beyond, usable, light = 0, 0, False
    few = fewer(picture[0]).shape[0]
    values, least = np.empty(few, picture.dtype), np.empty(3 * few, picture.dtype)
    for c in range(3):
        here, there, own = fewer(picture[c]), fewer(mean[c]), fewer(deviation[c])
        if p.exposure:
            bright, lit = 0, 0
            for n in range(few):
                values[bright] = here[n] / max(there[n], kind(p.darkest))
                bright += there[n] > kind(p.darkest)
                lit += here[n] > kind(p.darkest)
            light = light or lit > p.lit * few
            if bright > p.lit * few:
                usable += 1
                gain = nth_of(values, bright, (bright - 1) // 2)
                gains[c] = min(max(gain, kind(1 / p.gain_limit)), kind(p.gain_limit))
                beyond += gains[c] != kind(gain)
        for turn in range(2):
            for n in range(few):
                values[n] = own[n] if turn else abs(here[n] / gains[c] - there[n])
            middle = nth_of(values, few, (few - 1) // 2)
            if turn:
                noises[c] = max(min(noises[c], kind(p.growth * middle / p.mean_size)), kind(p.quietest))
            else:
                noises[c] = middle / p.median_size
        for n in range(few):
            least[c * few + n] = kind(p.spread) * max(noises[c], own[n] / kind(p.mean_size))
    noise = nth_of(least, 3 * few, (3 * few - 1) // 2)
    pace = kind(max(1 / (frames + 2), p.a_background))
    follow, held = kind(max(1 / (frames + 1 + p.first_frames), p.a_deviation)), kind(p.hold)
    out = 0
    for y in range(height):
        for x in range(width):
            shown[y, x] = 0
        for c in range(3):
            for x in range(width):
                value = picture[c, y, x] / gains[c]
                difference = value - mean[c, y, x]
                threshold = kind(p.spread) * max(noises[c], deviation[c, y, x] / kind(p.mean_size))
                corrected[c, y, x] = value
                shown[y, x] = max(shown[y, x], abs(difference) / threshold)
                core = difference - min(max(difference, -threshold), threshold)
                seen[c, y, x] = core if p.noise_floor else difference
        for x in range(width):
            out += shown[y, x] > one
        for c in range(3):
            gain = kind(float(gains[c]) ** p.a_exposure)
            for x in range(width):
                difference, own = corrected[c, y, x] - mean[c, y, x], deviation[c, y, x]
                share = pace * (held if shown[y, x] > one else one)
                new_mean[c, y, x] = (mean[c, y, x] + share * difference) * gain
                size = min(abs(difference), kind(p.outlier) * max(noises[c], own))
                new_deviation[c, y, x] = own + follow * (size - own)
        for x in range(width):
            shown[y, x] = min(max(shown[y, x] - one, kind(0)), one)
    dawn = p.exposure and usable == 0 and light
    return noise, beyond > 1 or dawn or out > p.cut * (height * width)


@jit
def fewer(image: Array) -> Array:
    """`every_other` of one plane `[h, w]`, `[n]`."""
    height, width = image.shape
    rows, columns = ((height + 1) // 2 + 1) // 2, ((width + 1) // 2 + 1) // 2
    some, n = np.empty(4 * rows * columns, image.dtype), 0
    for y in range(0, height):
        if not chosen(y, height):
            continue
        for x in range(width):
            if chosen(x, width):
                some[n] = image[y, x]
                n += 1
    return some[:n]


@jit
def chosen(at: int, length: int) -> bool:
    """Whether a row or column is looked at: every other one, counted from both sides."""
    last = 2 * (((length + 1) // 2 + 1) // 2 - 1)
    return (at <= last and at % 2 == 0) or (at >= length - 1 - last and (length - 1 - at) % 2 == 0)
