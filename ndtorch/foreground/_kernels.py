"""Compiled passes over an image and its background: foreground mask, its cleaning, and learning."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ndtorch.foreground.arrays import Array
from ndtorch.foreground.morphology import (
    WORD,
    closing,
    dilate,
    inside_row,
    majority_filter,
    opening,
    pack,
    row_of,
    unpack,
)
from ndtorch.foreground.noise import MEAN_SIZE
from ndtorch.foreground.shadow import LIGHT_OFFSET, NARROW_TINT, WINDOW_PX, ShadowLimits, remove_shadow
from ndtorch.utils.jit import jit

SWINGS, SWING_PACE = 2, 4.0
"""What `kept` is under objects where something swings, and how many times as fast the noise is learned there."""


class MaskLimits(NamedTuple):
    """Constants of `foreground_candidates`."""

    threshold_sigma: float
    shadow_min_ratio: float
    shadow_max_tint: float


class MaskImages(NamedTuple):
    """What `foreground_candidates` computes.

    Attributes:
        image: without its gain, `[3, h, w]`.
        grey, light: mean of its colors, and of their ratios to the background, `[h, w]`.
        candidates, shadow, narrow: 1 for foreground, shadow and narrow shadow candidates, `[h, w]` uint8.
    """

    image: Array
    grey: Array
    light: Array
    candidates: Array
    shadow: Array
    narrow: Array


class CleaningSides(NamedTuple):
    """Sides of squares in `clean_mask`: gaps that are closed, smallest motion where the background is not known,
    specks, and broad foreground (0: no narrow shadows are looked for)."""

    closing: int
    moving: int
    speckle: int
    broad: int


class LearningRates(NamedTuple):
    """Constants of `learn`: seconds without motion after which the background is known, seconds of a step, shares by
    which background and noise follow, factor under an object, and largest outlier of the noise."""

    needed: float
    dt: float
    background: float
    noise: float
    object_ratio: float
    outlier_limit: float


@jit
def foreground_candidates(
    raw: Array, gain: Array, noise: Array, background: Array, deviation: Array, limits: MaskLimits, out: MaskImages
) -> None:
    """Foreground and shadow candidates of an image.

    Args:
        raw, background, deviation: `[3, h, w]`.
        gain, noise: of each color, `[3]`.
        out: arrays that are filled.
    """
    kind = raw.dtype.type
    image, grey, light = out.image, out.grey, out.light
    r_gain, g_gain, b_gain = kind(1) / gain[0], kind(1) / gain[1], kind(1) / gain[2]
    spread = kind(limits.threshold_sigma)
    r_least, g_least, b_least = spread * noise[0], spread * noise[1], spread * noise[2]
    third, own, small = kind(1 / 3), kind(limits.threshold_sigma / MEAN_SIZE), kind(LIGHT_OFFSET)
    low, tint, narrow = kind(limits.shadow_min_ratio), kind(2 * limits.shadow_max_tint), kind(2 * NARROW_TINT)
    one = kind(1)
    for y in range(raw.shape[1]):
        for x in range(raw.shape[2]):
            red, green, blue = raw[0, y, x] * r_gain, raw[1, y, x] * g_gain, raw[2, y, x] * b_gain
            r_mean, g_mean, b_mean = background[0, y, x], background[1, y, x], background[2, y, x]
            image[0, y, x], image[1, y, x], image[2, y, x] = red, green, blue
            grey[y, x] = (red + green + blue) * third
            out.candidates[y, x] = (
                (abs(red - r_mean) > max(r_least, own * deviation[0, y, x]))
                | (abs(green - g_mean) > max(g_least, own * deviation[1, y, x]))
                | (abs(blue - b_mean) > max(b_least, own * deviation[2, y, x]))
            )
            r = (red + small) / (r_mean + small)
            g = (green + small) / (g_mean + small)
            b = (blue + small) / (b_mean + small)
            mean = (r + g + b) * third
            light[y, x] = mean
            spread_of, dimmed = max(r, g, b) - min(r, g, b), (mean < one) & (mean > low)
            out.shadow[y, x] = dimmed & (spread_of <= tint * mean)
            out.narrow[y, x] = dimmed & (spread_of <= narrow * mean)


@jit
def clean_mask(
    found: MaskImages,
    initialised: Array,
    unknown: int,
    static_time: Array,
    trail: float,
    shadow_limits: ShadowLimits,
    sides: CleaningSides,
    mask: Array,
    narrow: Array,
) -> None:
    """The foreground mask: candidates without shadows, gaps and specks, and broad motion where no background is known.

    Args:
        found: of `foreground_candidates`; candidates are removed where no background is known.
        initialised: above 0 where the background is known, `[h, w]`, and unknown: pixels where it is not.
        static_time: seconds without motion, `[h, w]`.
        trail: what moved within so many seconds counts as moving.
        mask: becomes 1 for foreground, and narrow: 1 where a narrow shadow may be, `[h, w]` uint8.
    """
    candidates, (height, width) = found.candidates, mask.shape
    around = 2 * (sides.closing + sides.speckle) - 1
    margin = max(max(around, sides.moving), max(sides.broad, WINDOW_PX))
    inside, dark, young = inside_row(width, margin), 0, 0
    line, size = inside.shape[0], inside.shape[0] * (height + 2 * margin)
    marks, room = np.zeros(size, np.uint64), (np.zeros(size, np.uint64), np.zeros(size, np.uint64))
    for y in range(height):
        if unknown:
            keep_known(candidates[y], found.narrow[y], initialised[y])
        dark |= copy_wanted(found.narrow[y], sides.broad, narrow[y])
        pack(candidates[y], row_of(marks, y, line, margin))
    allowed = marks.copy()
    if not unknown:
        # What is too small, even with its shadow, and not near what is not, changes nothing.
        majority_filter(allowed, width, inside, margin, marks)
        opening(marks, sides.speckle, inside, margin, room)
        dilate(marks, around, inside, margin, room)
        for n in range(size):
            marks[n] &= allowed[n]
    remove_shadow(marks, found.light, found.shadow, shadow_limits, inside, margin, room)
    # A dark coat looks like a shadow, but the rest of its wearer is around it.
    closing(marks, sides.closing, inside, margin, room)
    for n in range(size):
        marks[n] &= allowed[n]
    # Where no background is known, motion counts if it is broad: edges of what is stationary tremble.
    recent = np.zeros(size, np.uint64)
    for y in range(height if unknown else 0):
        if mark_recent(static_time[y], initialised[y], trail, mask[y]):
            pack(mask[y], row_of(recent, y, line, margin))
            young = 1
    if young:
        opening(recent, sides.moving, inside, margin, room)
        for n in range(size):
            marks[n] |= recent[n]
    majority_filter(marks, width, inside, margin, recent)
    opening(recent, sides.speckle, inside, margin, room)
    for y in range(height):
        unpack(row_of(recent, y, line, margin), mask[y])
    if dark:
        opening(recent, sides.broad, inside, margin, room)
        for y in range(height):
            remove(row_of(recent, y, line, margin), narrow[y])


@jit
def keep_known(candidates: Array, pale: Array, initialised: Array) -> None:
    """Remove candidates of a row where no background is known."""
    for x in range(candidates.shape[0]):
        known = np.uint8(initialised[x] > 0)
        candidates[x] &= known
        pale[x] &= known


@jit
def copy_wanted(pale: Array, wanted: int, narrow: Array) -> int:
    """Copy narrow shadow candidates of a row if they are wanted; whether there are any."""
    dark, asked = np.uint8(0), np.uint8(wanted > 0)
    for x in range(narrow.shape[0]):
        narrow[x] = pale[x] & asked
        dark |= narrow[x]
    return int(dark)


@jit
def mark_recent(static_time: Array, initialised: Array, trail: float, marks: Array) -> int:
    """Mark what moved lately where no background is known; whether anything did."""
    lately, some = static_time.dtype.type(trail), np.uint8(0)
    for x in range(marks.shape[0]):
        marks[x] = (static_time[x] < lately) & (initialised[x] <= 0)
        some |= marks[x]
    return int(some)


@jit
def remove(bits: Array, narrow: Array) -> None:
    """Unmark what a row of bits marks."""
    for k in range(bits.shape[0]):
        part, word = narrow[WORD * k : WORD * (k + 1)], bits[k]
        for n in range(part.shape[0] if word else 0):
            part[n] &= ~(word >> np.uint64(n))


@jit
def learn(
    image: Array,
    noise: Array,
    kept: Array,
    mean: Array,
    deviation: Array,
    static_time: Array,
    initialised: Array,
    unknown: int,
    rates: LearningRates,
) -> int:
    """See `ndtorch.foreground.background.update_background`; mean, deviation and initialised are updated.

    Args:
        unknown: pixels where the background is not known.

    Returns:
        The pixels where it is not known then.
    """
    kind, width, left = image.dtype.type, image.shape[2], 0
    pace, slow, fresh = np.empty(width, kind), np.empty(width, kind), np.empty(width, kind)
    for y in range(image.shape[1]):
        paces(kept[y], rates, pace, slow)
        fresh[:] = 0
        if unknown:
            left += first_paces(static_time[y], initialised[y], rates, pace, slow, fresh)
        for c in range(3):
            limits = (kind(noise[c]), kind(rates.outlier_limit), kind(rates.noise))
            follow(image[c, y], mean[c, y], deviation[c, y], limits, pace, slow, fresh)
    return left


@jit
def paces(kept: Array, rates: LearningRates, pace: Array, slow: Array) -> None:
    """Paces of background and noise in a row where the background is known."""
    kind = pace.dtype.type
    share, noise_share, held, one = kind(rates.background), kind(rates.noise), kind(1 - rates.object_ratio), kind(1)
    swing = min(kind(SWING_PACE) * noise_share, one)
    for x in range(pace.shape[0]):
        free = one - held * min(kept[x], one)
        pace[x] = share * free
        slow[x] = swing if kept[x] == SWINGS else noise_share * free if kept[x] <= one else kind(0)


@jit
def first_paces(
    static_time: Array, initialised: Array, rates: LearningRates, pace: Array, slow: Array, fresh: Array
) -> int:
    """Those where it is not known, and 1 where it becomes known, 0 elsewhere; returns where it is not known then."""
    kind, left = pace.dtype.type, np.int32(0)
    step, noise_share = kind(rates.dt), kind(rates.noise)
    for x in range(pace.shape[0]):
        before = initialised[x] > 0
        settled = before | (static_time[x] >= rates.needed)
        initialised[x] = settled
        pace[x] = pace[x] if before else step / (static_time[x] + step)
        slow[x] = slow[x] if before else noise_share
        fresh[x] = settled & (not before)
        left += not settled
    return int(left)


@jit
def follow(
    image: Array,
    mean: Array,
    deviation: Array,
    limits: tuple[float, float, float],
    pace: Array,
    slow: Array,
    fresh: Array,
) -> None:
    """Background and noise of one color of one row follow the image; outliers count in full where it follows fast."""
    kind = mean.dtype.type
    least, most, share, usual = kind(limits[0]), kind(limits[1]), kind(limits[2]), kind(MEAN_SIZE)
    for x in range(mean.shape[0]):
        before, own = mean[x], deviation[x]
        difference = image[x] - before
        size = abs(difference)
        own = own + slow[x] * ((min(size, most * max(least, own)) if slow[x] <= share else size) - own)
        deviation[x] = min(own, least * usual) if fresh[x] > 0 else own
        mean[x] = before + pace[x] * difference
