"""Segmentation: one frame and the background model -> foreground mask."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ndtorch.foreground._kernels import CleaningSides, MaskImages, MaskLimits, clean_mask, foreground_candidates
from ndtorch.foreground.arrays import Bools, Bytes, Floats
from ndtorch.foreground.background import (
    MIN_MOVING_SIDE_RATIO,
    MOTION_TRAIL_S,
    OUTLIER_LIMIT,
    SHADOW_CLOSING_RATIO,
    BackgroundModel,
    BackgroundParams,
    noise_share,
)
from ndtorch.foreground.illumination import changed_block_ratio, illumination, is_uncorrelated
from ndtorch.foreground.noise import MotionLimits, motion_and_noise
from ndtorch.foreground.shadow import MIN_COLORFULNESS, PENUMBRA_PX, WINDOW_PX, ShadowLimits
from ndtorch.foreground.swinging import SWINGING, update_swinging

CUT_RATIO, CUT_BLOCKS_RATIO = 0.7, 0.6
"""A new scene begins if more than this fraction of the image is foreground, or if more than this fraction of the blocks
changes and they are uncorrelated."""
SPECKLE_PX = 3
"""A foreground pixel needs the majority of the square of this side, and such a square is the smallest foreground."""


class Segmentation(NamedTuple):
    """What one step found.

    Attributes:
        image: without its gain, `[3, h, w]`, and grey: the mean of its colors, `[h, w]`.
        background, deviation: of the model before this step, `[3, h, w]`.
        noise: of each color, `[3]`.
        mask: foreground, `[h, w]`.
        narrow_shadow: 1 where a narrow shadow may be on known background, 0 elsewhere, `[h, w]`.
        swinging: 1 where something swings, `[h / 2, w / 2]`.
        scene_cut: whether a new scene begins; the model is of no use then.
    """

    image: Floats
    grey: Floats
    background: Floats
    deviation: Floats
    noise: Floats
    mask: Bools
    narrow_shadow: Bytes
    swinging: Bytes
    scene_cut: bool


def segment(raw: Floats, model: BackgroundModel, dt: float, p: BackgroundParams) -> Segmentation:
    """Foreground mask of a frame; `update_background` is called when the frame's objects are known.

    The exposure is corrected by the median ratio to the background, color by color. A pixel is foreground if it differs
    by more than `threshold_sigma` standard deviations of the noise: of the image's noise, or of its own if that is
    larger, as leaves and water flicker. Shadows are removed (`ndtorch.foreground.shadow`).

    The background of a pixel is known once nothing has moved there for a while. Before, broad motion is foreground, so
    a film may begin with objects in view.

    Args:
        raw: `[3, h, w]`, 0..1.
        model: updated except for mean, deviation and where they are known.
        dt: seconds between frames.

    Returns:
        The segmentation. Its arrays are those of the model until the next step.
    """
    m, (gain, noise, other_scene, colorfulness) = model, illumination(raw, model.mean, p)
    found = MaskImages(m.image, m.grey, m.light, m.marks[0], m.marks[1], m.marks[2])
    limits = MaskLimits(p.threshold_sigma, p.shadow_min_ratio, p.shadow_max_tint_ratio)
    foreground_candidates(raw, gain, noise, m.mean, m.deviation, limits, found)
    changed = update_motion(model, found, dt, p)
    cut = other_scene or (changed > CUT_BLOCKS_RATIO and is_uncorrelated(m.previous, m.blurred))
    mask, narrow = m.marks[3], m.marks[4]
    if cut or np.count_nonzero(found.candidates.view(np.bool_)) > CUT_RATIO * found.candidates.size:
        mask[:], narrow[:] = 0, 0
        return Segmentation(
            raw, raw.mean(0), raw, m.deviation, noise, mask.view(np.bool_), narrow, m.swinging[SWINGING], True
        )
    height = len(mask)
    sides = CleaningSides(
        closing=2 * round(SHADOW_CLOSING_RATIO * height / 2) + 1,
        moving=2 * max(0, round((MIN_MOVING_SIDE_RATIO * height - 1) / 2)) + 1,
        speckle=SPECKLE_PX,
        # In a film without colors everything dark is without tint.
        broad=WINDOW_PX + 2 * PENUMBRA_PX if colorfulness >= MIN_COLORFULNESS else 0,
    )
    shadow = ShadowLimits(p.shadow_min_ratio, p.shadow_max_variation_ratio)
    clean_mask(found, m.initialised, m.unknown, m.static_time, MOTION_TRAIL_S, shadow, sides, mask, narrow)
    update_swinging(m.swinging, mask, m.frames, dt)
    return Segmentation(
        m.image, m.grey, m.mean, m.deviation, noise, mask.view(np.bool_), narrow, m.swinging[SWINGING], False
    )


def update_motion(model: BackgroundModel, found: MaskImages, dt: float, p: BackgroundParams) -> float:
    """Update static time, flicker and the blurred frame; returns the share of blocks that changed."""
    limits = MotionLimits(dt, p.min_motion_ratio, p.threshold_sigma, noise_share(model.frames, dt, p), OUTLIER_LIMIT)
    m, known = model, (model.initialised, model.unknown)
    changed = motion_and_noise(
        found.image, m.blurred, m.previous, m.flicker, m.static_time, *known, found.candidates, limits
    )
    if changed < 0:
        changed = changed_block_ratio(m.blurred, m.previous)
    m.previous, m.blurred = m.blurred, m.previous
    return changed
