"""Figure and ground: which pixels of a camera's picture stand out from a slow background, shadows left out."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
import torch

from ndtorch.kernels.load import kernel
from ndtorch.kernels.switch import kernels_wanted
from ndtorch.vision.camera.ground import (
    MEAN_SIZE,
    MEDIAN_SIZE,
    Bools,
    Bytes,
    Floats,
    GroundParams,
    GroundState,
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


def ground_start(picture: Floats, p: GroundParams) -> GroundState:
    """State settled on one picture `[3, h, w]`: no ground is known."""
    # Nothing has moved yet.
    blank = torch.zeros(picture.shape[1:])
    return GroundState(
        torch.from_numpy(picture.copy()),
        torch.full(picture.shape, p.least_noise, dtype=torch.float32),
        torch.from_numpy(softened(picture, p.soft)),
        blank + p.least_noise,
        blank + p.trail,
        blank,
        torch.zeros((), dtype=torch.int64),
    )


def softened(picture: Floats, side: int) -> Floats:
    """Every color blurred by a square, `[3, h, w]`."""
    import cv2

    soft = room(*picture.shape)
    if side == 3 and min(picture.shape[1:]) > 1 and kernels_wanted():
        kernel("softened").run(picture, soft)
        return soft
    for plane, to in zip(picture, soft, strict=True):
        cv2.blur(plane, (side, side), dst=to)
    return soft


def ground_step(
    picture: Floats, state: GroundState, kept: Floats, dt: float, params: GroundParams
) -> tuple[Standing, GroundState]:
    """One step.

    The exposure is corrected by the median ratio to the background, color by color. What differs by more than
    `spread` standard deviations of the noise stands out: of the picture's noise, or of the pixel's own where that is
    larger, as leaves and water flicker. What has only lost light, the same share in all colors and among
    neighbours, is a shadow. The background follows at its pace; where `kept` is 1 (an object is there) only at `hold`
    of it.

    The ground of a pixel is known once nothing has moved there for a while; before, it is the mean since something
    did. Where it is not known, what moves stands out. So a film may begin with objects in view.

    Args:
        picture: `[3, h, w]`, 0..1.
        kept: `[h, w]`, 0..1: where objects are that were followed up to the frame before.
        dt: seconds between pictures.
        params: constants.
    """
    import cv2

    p = params
    raw, ground, deviation = picture, state.mean.numpy(), state.deviation.numpy()
    gain, noise, other, hue = light_change(picture, ground, p)
    picture, grey, light, out, may_be, pale = stand_out(picture, gain, ground, deviation, noise, p)
    known = state.known.numpy()
    seen = int(state.frames) + 1
    soft = softened(picture, p.soft)
    quiet, restless, changed = stillness(soft, out, state, dt, p)
    before = state.before.numpy()
    if other or cv2.countNonZero(out) > p.cut * out.size or (changed > p.changed and unlike(soft, before, p)):
        none = np.zeros(out.shape, np.uint8)
        return Standing(raw, raw, deviation, noise, grey_of(raw), none > 0, none, True), ground_start(raw, p)
    needed = p.still * p.settle / max(p.settle, seen * dt)
    mean, spread, settled = learn(picture, ground, deviation, noise, (kept, quiet, known), (needed, dt, seen), p)
    after = GroundState(
        torch.from_numpy(mean),
        torch.from_numpy(spread),
        torch.from_numpy(soft),
        torch.from_numpy(restless),
        torch.from_numpy(quiet),
        torch.from_numpy(settled),
        torch.tensor(seen, dtype=torch.int64),
    )
    sure = (known > 0).astype(np.uint8)
    out &= sure
    core = without_shadow(out, light, may_be, p)
    # A dark coat looks like a shadow, but the rest of its wearer is around it.
    wide = 2 * round(p.around * core.shape[0] / 2) + 1
    closed = np.asarray(cv2.morphologyEx(core, cv2.MORPH_CLOSE, square(wide)), np.uint8)
    figure = np.asarray(closed & out, np.uint8)
    if cv2.countNonZero(sure) < sure.size:
        # What moves there is believed where it is broad: edges of what stands still tremble.
        young, side = (
            ((quiet < p.trail) & (sure == 0)).astype(np.uint8),
            2 * max(0, round((p.broad * len(sure) - 1) / 2)) + 1,
        )
        figure |= np.asarray(cv2.morphologyEx(young, cv2.MORPH_OPEN, square(side)), np.uint8)
    # A pixel alone is noise; a gap of a pixel is none.
    figure = np.asarray(cv2.morphologyEx(most_of(figure, p.speckle), cv2.MORPH_OPEN, square(p.speckle)))
    # In a film without colors every dark thing is without tint.
    narrow = pale & sure if hue >= p.colored else np.zeros_like(sure)
    if cv2.countNonZero(narrow):
        narrow &= 1 - broad(figure, p)
    return Standing(picture, ground, deviation, noise, grey, np.asarray(figure > 0), narrow, False), after


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
    picture: Floats, gain: Floats, ground: Floats, deviation: Floats, noise: Floats, p: GroundParams
) -> tuple[Floats, Floats, Floats, Bytes, Bytes, Bytes]:
    """The picture without its gain `[3, h, w]`, in grey, its light over that of the ground, and where it stands out,
    where it may be shadow, and where so with hardly any tint, 1 or 0, `[h, w]`."""
    if kernels_wanted():
        new, (out, may_be, pale) = room(*picture.shape), np.empty((3, *picture.shape[1:]), np.uint8)
        grey, light = room(*picture.shape[1:]), room(*picture.shape[1:])
        constants, after = (
            (p.spread, MEAN_SIZE, p.offset, p.darkest, p.tint, p.pure),
            (new, grey, light, out, may_be, pale),
        )
        kernel("stand_out").run(picture, gain, ground, deviation, noise, *constants, *after)
        return after
    picture = np.asarray(picture / gain[:, None, None], np.float32)
    threshold = p.spread * np.maximum(noise[:, None, None], deviation * np.float32(1 / MEAN_SIZE))
    over = np.abs(picture - ground) > threshold
    small = np.float32(p.offset)
    ratio = (picture + small) / (ground + small)
    light = np.asarray((ratio[0] + ratio[1] + ratio[2]) * np.float32(1 / 3))
    apart, dimmed = ratio.max(0) - ratio.min(0), (light < 1) & (light > np.float32(p.darkest))
    may_be, pale = ((dimmed & (apart <= np.float32(tint * 2) * light)).astype(np.uint8) for tint in (p.tint, p.pure))
    return picture, grey_of(picture), light, (over[0] | over[1] | over[2]).astype(np.uint8), may_be, pale


def learn(
    picture: Floats,
    ground: Floats,
    deviation: Floats,
    noise: Floats,
    where: tuple[Floats, Floats, Floats],
    when: tuple[float, float, int],
    p: GroundParams,
) -> tuple[Floats, Floats, Floats]:
    """Background and mean deviation from it `[3, h, w]`, and where the ground is known `[h, w]`, after a step.

    The slow pace is that of known ground; before, the ground is the mean of what was seen since something moved.

    Args:
        picture, ground, deviation: `[3, h, w]`.
        noise: of each color.
        where: kept, seconds without motion, and known, `[h, w]`.
        when: seconds without motion after which ground is known, seconds of a step, and steps so far.
        p: constants.
    """
    (kept, quiet, known), (needed, dt, seen) = where, when
    share = smoothing_factor(p.tau_ground, dt)
    # The noise of the first pictures is learned as their mean.
    follow = max(1 / (seen + 5), smoothing_factor(p.tau_noise, dt))
    if kernels_wanted():
        new, spread, settled = room(*ground.shape), room(*ground.shape), room(*known.shape)
        constants = (needed, dt, share, follow, p.hold, p.surprise, MEAN_SIZE)
        kernel("learn_ground").run(
            picture, ground, deviation, noise, kept, quiet, known, *constants, new, spread, settled
        )
        return new, spread, settled
    free, step, least = 1 - np.float32(1 - p.hold) * kept, np.float32(dt), noise[:, None, None]
    before = known > 0
    now = before | (quiet >= np.float32(needed))
    pace = np.where(before, np.float32(share) * free, step / (quiet + step))
    slow = np.where(before, np.float32(follow) * free, np.float32(follow))
    difference = picture - ground
    limited = np.minimum(np.abs(difference), np.float32(p.surprise) * np.maximum(least, deviation))
    spread = deviation + slow * (limited - deviation)
    spread = np.where(now & ~before, np.minimum(spread, least * np.float32(MEAN_SIZE)), spread)
    return np.asarray(ground + pace * difference), np.asarray(spread), now.astype(np.float32)


def stillness(soft: Floats, out: Bytes, state: GroundState, dt: float, p: GroundParams) -> tuple[Floats, Floats, float]:
    """Seconds since something moved at a pixel or beside it, its mean change from picture to picture, `[h, w]`, and
    `changed_blocks`.

    What moves changes by more than the noise of the picture and of that pixel, or is no more what it was since then,
    where the ground is not known.
    """
    import cv2

    before, own, quiet, known = (part.numpy() for part in (state.before, state.restless, state.quiet, state.known))
    follow = max(1 / (int(state.frames) + 5), smoothing_factor(p.tau_noise, dt))
    if kernels_wanted():
        new, since = room(*own.shape), room(*quiet.shape)
        constants = (dt, p.speckle, p.block, p.other, p.moved, p.spread, (MEAN_SIZE, MEDIAN_SIZE), follow, p.surprise)
        changed = kernel("restless").run(soft, before, own, quiet, known, out, *constants, new, since)
        return since, new, changed if changed >= 0 else changed_blocks(soft, before, p)
    over, own = unrest(soft, before, own, follow, p)
    moved = most_of(over, p.speckle)
    if not known.all():
        moved |= most_of(out, p.speckle) * (known == 0)
    still = np.asarray(cv2.dilate(moved, square(3)), np.uint8) == 0
    return (quiet + np.float32(dt)) * still, own, changed_blocks(soft, before, p)


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


def without_shadow(out: Bytes, light: Floats, may_be: Bytes, p: GroundParams) -> Bytes:
    """Where something stands out, 1 or 0, without `shadow`, `[h, w]`."""
    if not kernels_wanted():
        return out & ~shadow(light, may_be, p)
    core = np.empty_like(out)
    kernel("without_shadow").run(out, light, may_be, p.patch, p.penumbra, p.darkest, p.uneven, core)
    return core


def shadow(light: Floats, may_be: Bytes, p: GroundParams) -> Bytes:
    """255 where the picture is the background with less light, evenly among neighbours, `[h, w]`."""
    import cv2

    mean = cv2.blur(light, (p.patch, p.patch))
    varies = cv2.blur(light * light, (p.patch, p.patch)) - mean * mean
    inner = may_be * ((mean > p.darkest) & (varies < p.uneven**2))
    # Its edge, where neighbours differ, belongs to it.
    wide = np.asarray(cv2.dilate(inner, square(2 * p.penumbra + 1)), np.uint8)
    return (wide & may_be) * np.uint8(255)
