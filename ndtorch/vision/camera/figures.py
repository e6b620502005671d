"""Figure and ground: which pixels of a camera's picture stand out from a slow background, shadows left out."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from ndtorch.kernels.learn_ground import learn_ground
from ndtorch.kernels.restless import restless
from ndtorch.kernels.softened import softened
from ndtorch.kernels.stand_out import stand_out as stand_out_kernel
from ndtorch.kernels.switch import kernels_wanted
from ndtorch.kernels.tidied import tidied as tidied_kernel
from ndtorch.vision.camera.ground import (
    MEAN_SIZE,
    MEDIAN_SIZE,
    Bools,
    Bytes,
    Floats,
    Ground,
    GroundParams,
    grey_of,
    medians,
    room,
    some_of,
)
from ndtorch.vision.camera.light_changes import changed_blocks, light_change, unlike
from ndtorch.vision.temporal import smoothing_factor as factor

smoothing_factor = cache(factor)
"""It checks its arguments, and here they are always the same."""


@cache
def square(side: int) -> Bytes:
    """Pixels of a square, 1."""
    return np.ones((side, side), np.uint8)


class Standing(NamedTuple):
    """One step's result: exposure-corrected picture, background, and mean deviation from it before this step,
    `[3, h, w]`, noise of each color `[3]`, the picture in grey, which pixels stand out, which may be a narrow
    shadow on known ground, 1 or 0, `[h, w]`, and whether a new scene begins."""

    picture: Floats
    ground: Floats
    deviation: Floats
    noise: Floats
    grey: Floats
    figure: Bools
    narrow: Bytes
    cut: bool


def ground_start(picture: Floats, p: GroundParams) -> Ground:
    """What is settled on one picture `[3, h, w]`: no ground is known."""
    shape = picture.shape[1:]
    # Nothing has moved yet.
    planes = room(3, *shape)
    planes[0], planes[1], planes[2] = p.least_noise, p.trail, 0
    mean, deviation, soft = (room(*picture.shape) for _ in range(3))
    mean[...], deviation[...] = picture, p.least_noise
    ground = Ground(mean, deviation, soft, planes[0], planes[1], planes[2], 0)
    soften(picture, p.soft, soft)
    return ground


def soften(picture: Floats, side: int, soft: Floats) -> None:
    """Every color blurred by a square, `[3, h, w]`, into such an array."""
    import cv2

    if side == 3 and min(picture.shape[1:]) > 1 and kernels_wanted():
        softened(picture, soft)
        return
    for plane, to in zip(picture, soft, strict=True):
        cv2.blur(plane, (side, side), dst=to)


def ground_step(picture: Floats, ground: Ground, dt: float, params: GroundParams) -> Standing:
    """One step, without what is learned at its end.

    The exposure is corrected by the median ratio to the background, color by color. What differs by more than
    `spread` standard deviations of the noise stands out: of the picture's noise, or of the pixel's own where that is
    larger, as leaves and water flicker. What has only lost light, the same share in all colors and among
    neighbours, is a shadow.

    The ground of a pixel is known once nothing has moved there for a while; before, it is the mean since something
    did. Where it is not known, what moves stands out. So a film may begin with objects in view.

    Args:
        picture: `[3, h, w]`, 0..1.
        ground: what is known of it; is changed, but for background and noise. Where a new scene begins it is of no
            use any more.
        dt: seconds between pictures.
        params: constants.

    Returns:
        what stands out. Its arrays are those of `ground`, until the next step.
    """
    import cv2

    p, raw = params, picture
    gain, noise, other, hue = light_change(picture, ground.mean, p)
    picture, grey, light, out, may_be, pale = stand_out(picture, gain, noise, ground, p)
    soften(picture, p.soft, ground.soft)
    changed = stillness(out, ground, dt, p)
    before, ground.before, ground.soft = ground.before, ground.soft, ground.before
    new = changed > p.changed and unlike(ground.before, before, p)
    if other or new or cv2.countNonZero(out) > p.cut * out.size:
        none = np.zeros(out.shape, np.uint8)
        return Standing(raw, raw, ground.deviation, noise, grey_of(raw), none > 0, none, True)
    figure, narrow = tidied(out, ground, light, may_be, pale if hue >= p.colored else None, p)
    return Standing(picture, ground.mean, ground.deviation, noise, grey, figure.view(np.bool_), narrow, False)


def tidied(
    out: Bytes, ground: Ground, light: Floats, may_be: Bytes, pale: Bytes | None, p: GroundParams
) -> tuple[Bytes, Bytes]:
    """The figure, and where a narrow shadow may be on known ground, 1 or 0, `[h, w]`.

    What stands out is no figure where it is shadow, a speck, or where no ground is known; what moves there is one if
    it is broad.

    Args:
        out: 1 where a pixel stands out, `[h, w]`; it may be changed.
        ground: tells where it is known, and for how long nothing has moved.
        light: of the picture over that of the ground, `[h, w]`.
        may_be: where shadow may be, and pale: where so with hardly any tint, 1 or 0, `[h, w]`. In a film without colors
            every dark thing is without tint: None.
        p: constants.
    """
    import cv2

    known, quiet = ground.known, ground.quiet
    # A dark coat looks like a shadow, but the rest of its wearer is around it.
    wide = 2 * round(p.around * len(out) / 2) + 1
    # What moves where no ground is known is believed where it is broad: edges of what stands still tremble.
    moving = 2 * max(0, round((p.broad * len(out) - 1) / 2)) + 1
    if kernels_wanted():
        figure, narrow = ground.marks[3:]
        sides = (wide, moving, p.speckle, 0 if pale is None else p.patch + 2 * p.penumbra)
        shadows = (p.patch, p.penumbra, p.darkest, p.uneven)
        shade = np.zeros_like(out) if pale is None else pale
        tidied_kernel(out, known, quiet, light, may_be, shade, shadows, sides, p.trail, figure, narrow)
        return figure, narrow
    sure = (known > 0).astype(np.uint8)
    out = out & sure
    core = out & ~shadow(light, may_be, p)
    figure = np.asarray(cv2.morphologyEx(core, cv2.MORPH_CLOSE, square(wide)), np.uint8) & out
    if not sure.all():
        young = ((quiet < p.trail) & (sure == 0)).astype(np.uint8)
        figure |= np.asarray(cv2.morphologyEx(young, cv2.MORPH_OPEN, square(moving)), np.uint8)
    # A pixel alone is noise; a gap of a pixel is none.
    figure = np.asarray(cv2.morphologyEx(most_of(figure, p.speckle), cv2.MORPH_OPEN, square(p.speckle)), np.uint8)
    narrow = np.zeros_like(sure) if pale is None else pale & sure & (1 - broad(figure, p))
    return figure, narrow


def broad(figure: Bytes, p: GroundParams) -> Bytes:
    """Where something stands out that is too broad to be a shadow's edge, 1, and 0 elsewhere, `[h, w]`.

    What is left of a shadow by `shadow` is no broader than its window and two edges.
    """
    import cv2

    return np.asarray(cv2.morphologyEx(figure, cv2.MORPH_OPEN, square(p.patch + 2 * p.penumbra)), np.uint8)


def most_of(image: Bytes, side: int) -> Bytes:
    """1 where most pixels of a square around are 1, 0 elsewhere, `[h, w]`."""
    import cv2

    share = np.asarray(cv2.blur(image * np.uint8(255), (side, side)), np.uint8)
    return (share > 127).astype(np.uint8)


def stand_out(
    picture: Floats, gain: Floats, noise: Floats, ground: Ground, p: GroundParams
) -> tuple[Floats, Floats, Floats, Bytes, Bytes, Bytes]:
    """The picture without its gain `[3, h, w]`, in grey, its light over that of the ground, and where it stands out,
    where it may be shadow, and where so with hardly any tint, 1 or 0, `[h, w]`."""
    mean, deviation = ground.mean, ground.deviation
    if kernels_wanted():
        constants = (p.spread, MEAN_SIZE, p.offset, p.darkest, p.tint, p.pure)
        after = (ground.picture, ground.grey, ground.light, ground.marks[0], ground.marks[1], ground.marks[2])
        stand_out_kernel(picture, gain, mean, deviation, noise, *constants, *after)
        return after
    picture = np.asarray(picture / gain[:, None, None], np.float32)
    threshold = p.spread * np.maximum(noise[:, None, None], deviation * np.float32(1 / MEAN_SIZE))
    over = np.abs(picture - mean) > threshold
    small = np.float32(p.offset)
    ratio = (picture + small) / (mean + small)
    light = np.asarray((ratio[0] + ratio[1] + ratio[2]) * np.float32(1 / 3))
    apart, dimmed = ratio.max(0) - ratio.min(0), (light < 1) & (light > np.float32(p.darkest))
    may_be, pale = ((dimmed & (apart <= np.float32(tint * 2) * light)).astype(np.uint8) for tint in (p.tint, p.pure))
    return picture, grey_of(picture), light, (over[0] | over[1] | over[2]).astype(np.uint8), may_be, pale


def learn(standing: Standing, ground: Ground, kept: Floats, dt: float, p: GroundParams) -> None:
    """The end of a step: background, mean deviation from it, and where the ground is known.

    The background follows at its pace; where an object is, only at `hold` of it. The slow pace is that of known
    ground; before, the ground is the mean of what was seen since something moved.

    Args:
        standing: of `ground_step`.
        ground: is changed.
        kept: `[h, w]`, 0..1: where objects are that were followed up to the frame before.
        dt: seconds of a step.
        p: constants.
    """
    ground.frames = seen = ground.frames + 1
    # Seconds without motion after which ground is known.
    needed = p.still * p.settle / max(p.settle, seen * dt)
    share = smoothing_factor(p.tau_ground, dt)
    # The noise of the first pictures is learned as their mean.
    follow = max(1 / (seen + 5), smoothing_factor(p.tau_noise, dt))
    picture, noise, mean, deviation = standing.picture, standing.noise, ground.mean, ground.deviation
    quiet, known = ground.quiet, ground.known
    if kernels_wanted():
        constants = (needed, dt, share, follow, p.hold, p.surprise, MEAN_SIZE)
        learn_ground(picture, mean, deviation, noise, kept, quiet, known, *constants)
        return
    free, step, least = 1 - np.float32(1 - p.hold) * kept, np.float32(dt), noise[:, None, None]
    before = known > 0
    now = before | (quiet >= np.float32(needed))
    pace = np.where(before, np.float32(share) * free, step / (quiet + step))
    slow = np.where(before, np.float32(follow) * free, np.float32(follow))
    difference = picture - mean
    limited = np.minimum(np.abs(difference), np.float32(p.surprise) * np.maximum(least, deviation))
    spread = deviation + slow * (limited - deviation)
    deviation[...] = np.where(now & ~before, np.minimum(spread, least * np.float32(MEAN_SIZE)), spread)
    mean += pace * difference
    known[...] = now


def stillness(out: Bytes, ground: Ground, dt: float, p: GroundParams) -> float:
    """`changed_blocks` of the picture blurred, against the one before.

    Seconds since something moved at a pixel or beside it, and its mean change from picture to picture, become those
    after the step. What moves changes by more than the noise of the picture and of that pixel, or is no more what it
    was since then, where the ground is not known.

    Args:
        out: 1 where something stands out, `[h, w]`.
        ground: is changed.
        dt: seconds of a step.
        p: constants.
    """
    import cv2

    soft, before, own, quiet, known = ground.soft, ground.before, ground.restless, ground.quiet, ground.known
    follow = max(1 / (ground.frames + 5), smoothing_factor(p.tau_noise, dt))
    if kernels_wanted():
        constants = (dt, p.speckle, p.block, p.other, p.moved, p.spread, (MEAN_SIZE, MEDIAN_SIZE), follow, p.surprise)
        changed: float = restless(soft, before, own, quiet, known, out, *constants)
        return changed if changed >= 0 else changed_blocks(soft, before, p)
    over, own[...] = unrest(soft, before, own, follow, p)
    moved = most_of(over, p.speckle)
    if not known.all():
        moved |= most_of(out, p.speckle) * (known == 0)
    still = np.asarray(cv2.dilate(moved, square(3)), np.uint8) == 0
    quiet[...] = (quiet + np.float32(dt)) * still
    return changed_blocks(soft, before, p)


def unrest(soft: Floats, before: Floats, own: Floats, follow: float, p: GroundParams) -> tuple[Bytes, Floats]:
    """Where a picture changes by more than noise, 1 or 0, and its mean change from picture to picture, which follows
    at that share, `[h, w]`."""
    import cv2

    change = grey_of(np.asarray(cv2.absdiff(soft, before), np.float32))
    noise = np.float32(medians(some_of(change[None]))[0] / MEDIAN_SIZE)
    least = np.maximum(noise, own * np.float32(1 / MEAN_SIZE))
    over = (change > np.maximum(np.float32(p.moved), np.float32(p.spread) * least)).astype(np.uint8)
    own = own + np.float32(follow) * (np.minimum(change, np.float32(p.surprise) * least) - own)
    return over, np.asarray(own, np.float32)


def shadow(light: Floats, may_be: Bytes, p: GroundParams) -> Bytes:
    """255 where the picture is the background with less light, evenly among neighbours, `[h, w]`."""
    import cv2

    mean = cv2.blur(light, (p.patch, p.patch))
    varies = cv2.blur(light * light, (p.patch, p.patch)) - mean * mean
    inner = may_be * ((mean > p.darkest) & (varies < p.uneven**2))
    # Its edge, where neighbours differ, belongs to it.
    wide = np.asarray(cv2.dilate(inner, square(2 * p.penumbra + 1)), np.uint8)
    return (wide & may_be) * np.uint8(255)
