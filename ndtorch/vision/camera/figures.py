"""Figure and ground: which pixels of a camera's picture stand out from a slow background, shadows left out."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import torch
from pydantic import Field
from torch import Tensor

from ndtorch.config import Constants
from ndtorch.kernels.load import kernel
from ndtorch.kernels.switch import kernels_wanted
from ndtorch.vision.temporal import smoothing_factor

Floats = npt.NDArray[np.float32]
Bools = npt.NDArray[np.bool_]
Bytes = npt.NDArray[np.uint8]
MEAN_SIZE, MEDIAN_SIZE = 0.798, 0.6745
"""Mean magnitude of a normal variable against its standard deviation, and median of its magnitude likewise."""


class GroundParams(Constants):
    """Constants of figure and ground; brightness as a share of full scale, times in seconds."""

    height: int = Field(224, ge=16, description="most rows of the image on which figures are told from the ground")
    tau_ground: float = Field(10.0, gt=0, description="memory of the background")
    tau_noise: float = Field(4.0, gt=0, description="memory of the noise of every pixel")
    spread: float = Field(3.0, gt=0, description="standard deviations of the noise that count as standing out")
    least_noise: float = Field(0.006, gt=0, description="smallest standard deviation of the noise")
    moved: float = Field(0.012, gt=0, description="smallest change from picture to picture that is motion")
    still: float = Field(0.5, ge=0, description="what has not moved for this long is ground, or a hole in memory,")
    settle: float = Field(2.0, gt=0, description="for less, by and by, where nothing was still so long until then")
    broad: float = Field(0.06, ge=0, description="smallest side of what moves there, as a share of the height")
    trail: float = Field(0.1, ge=0, description="what moved so long ago stands out where the ground is not known")
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
    cut: float = Field(0.7, gt=0, le=1, description="share of the picture standing out that makes it a new scene,")
    block: int = Field(8, ge=1, description="or means of blocks of so many pixels, where noise is little:")
    changed: float = Field(0.6, gt=0, le=1, description="more than this share of them differs from those before")
    other: float = Field(0.02, gt=0, description="by more than this,")
    alike: float = Field(0.25, ge=-1, le=1, description="and their correlation with those before is below this")


class GroundState(NamedTuple):
    """What changes: background, mean deviation from it, and the picture before, blurred, `[3, h, w]`; how much that
    changes from picture to picture, seconds since something moved, and whether the ground is known, 1 or 0, `[h, w]`;
    and frames seen since it began, `[]`."""

    mean: Tensor
    deviation: Tensor
    before: Tensor
    restless: Tensor
    quiet: Tensor
    known: Tensor
    frames: Tensor


class Standing(NamedTuple):
    """One step's result: exposure-corrected picture and background `[3, h, w]`, the picture in grey, which pixels
    stand out, `[h, w]`, and whether a new scene begins."""

    picture: Floats
    ground: Floats
    grey: Floats
    figure: Bools
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

    return np.stack([np.asarray(cv2.blur(plane, (side, side)), np.float32) for plane in picture])


def grey_of(picture: Floats) -> Floats:
    """The mean of the colors, `[h, w]`."""
    grey: Floats = (picture[0] + picture[1] + picture[2]) * np.float32(1 / 3)
    return grey


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
    gain = exposure(picture, ground, p)
    some = np.abs(some_of(picture) / gain[:, None] - some_of(ground))
    noise = np.maximum(medians(some) / MEDIAN_SIZE, p.least_noise).astype(np.float32)
    picture, grey, light, out, may_be = stand_out(picture, gain, ground, deviation, noise, p)
    known = state.known.numpy()
    seen = int(state.frames) + 1
    soft = softened(picture, p.soft)
    if np.count_nonzero(out) > p.cut * out.size or new_scene(raw, gain, soft, state, p):
        return Standing(raw, raw, grey_of(raw), np.zeros(out.shape, bool), True), ground_start(raw, p)
    quiet, restless = stillness(soft, out, state, dt, p)
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
    core = out & ~shadow(light, may_be, p)
    # A dark coat looks like a shadow, but the rest of its wearer is around it.
    wide = 2 * round(p.around * core.shape[0] / 2) + 1
    closed = np.asarray(cv2.morphologyEx(core, cv2.MORPH_CLOSE, np.ones((wide, wide), np.uint8)), np.uint8)
    figure = np.asarray(closed & out, np.uint8)
    if not sure.all():
        # What moves there is believed where it is broad: edges of what stands still tremble.
        young, side = (
            ((quiet < p.trail) & (sure == 0)).astype(np.uint8),
            2 * max(0, round((p.broad * len(sure) - 1) / 2)) + 1,
        )
        figure |= np.asarray(cv2.morphologyEx(young, cv2.MORPH_OPEN, np.ones((side, side), np.uint8)), np.uint8)
    # A pixel alone is noise; a gap of a pixel is none.
    square = np.ones((p.speckle, p.speckle), np.uint8)
    figure = np.asarray(cv2.morphologyEx(most_of(figure, p.speckle), cv2.MORPH_OPEN, square))
    return Standing(picture, ground, grey, np.asarray(figure > 0), False), after


def most_of(image: Bytes, side: int) -> Bytes:
    """1 where most pixels of a square around are 1, 0 elsewhere, `[h, w]`."""
    import cv2

    share = np.asarray(cv2.blur(image * np.uint8(255), (side, side)), np.uint8)
    return (share > 127).astype(np.uint8)


def stand_out(
    picture: Floats, gain: Floats, ground: Floats, deviation: Floats, noise: Floats, p: GroundParams
) -> tuple[Floats, Floats, Floats, Bytes, Bytes]:
    """The picture without its gain `[3, h, w]`, in grey, its light over that of the ground, and where it stands out
    and where it may be shadow, 1 or 0, `[h, w]`."""
    if kernels_wanted():
        new, out, may_be = np.empty_like(picture), *(np.empty(picture.shape[1:], np.uint8) for _ in range(2))
        grey, light = (np.empty(picture.shape[1:], np.float32) for _ in range(2))
        constants = (p.spread, MEAN_SIZE, p.offset, p.darkest, p.tint)
        kernel("stand_out").run(picture, gain, ground, deviation, noise, *constants, new, grey, light, out, may_be)
        return new, grey, light, out, may_be
    picture = np.asarray(picture / gain[:, None, None], np.float32)
    threshold = p.spread * np.maximum(noise[:, None, None], deviation * np.float32(1 / MEAN_SIZE))
    over = np.abs(picture - ground) > threshold
    small = np.float32(p.offset)
    ratio = (picture + small) / (ground + small)
    light = np.asarray((ratio[0] + ratio[1] + ratio[2]) * np.float32(1 / 3))
    tint = (ratio.max(0) - ratio.min(0)) <= np.float32(p.tint * 2) * light
    may_be = ((light < 1) & (light > np.float32(p.darkest)) & tint).astype(np.uint8)
    return picture, grey_of(picture), light, (over[0] | over[1] | over[2]).astype(np.uint8), may_be


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
        new, spread, settled = np.empty_like(ground), np.empty_like(ground), np.empty_like(known)
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


def stillness(soft: Floats, out: Bytes, state: GroundState, dt: float, p: GroundParams) -> tuple[Floats, Floats]:
    """Seconds since something moved at a pixel or beside it, and its mean change from picture to picture, `[h, w]`.

    What moves changes by more than the noise of the picture and of that pixel, or is no more what it was since then,
    where the ground is not known.
    """
    import cv2

    change = grey_of(np.asarray(cv2.absdiff(soft, state.before.numpy()), np.float32))
    own = state.restless.numpy()
    noise = np.float32(medians(some_of(change[None]))[0] / MEDIAN_SIZE)
    least = np.maximum(noise, own * np.float32(1 / MEAN_SIZE))
    over = (change > np.maximum(np.float32(p.moved), np.float32(p.spread) * least)).astype(np.uint8)
    moved = most_of(over, p.speckle)
    follow = np.float32(max(1 / (int(state.frames) + 5), smoothing_factor(p.tau_noise, dt)))
    own = own + follow * (np.minimum(change, np.float32(p.surprise) * least) - own)
    known = state.known.numpy()
    if not known.all():
        moved |= most_of(out, p.speckle) * (known == 0)
    moved = np.asarray(cv2.dilate(moved, np.ones((3, 3), np.uint8)), np.uint8)
    quiet = np.where(moved > 0, np.float32(0), state.quiet.numpy() + np.float32(dt))
    return np.asarray(quiet, np.float32), np.asarray(own, np.float32)


def exposure(picture: Floats, ground: Floats, p: GroundParams) -> Floats:
    """Gain of each color, `[3]`: the median ratio over every sixteenth pixel whose background is not dark."""
    one, other = some_of(picture), some_of(ground)
    bright = other.min(0) > p.dark
    if bright.mean() < p.light:
        return np.ones(3, np.float32)
    gain = medians(one[:, bright] / other[:, bright])
    return np.asarray(np.clip(gain, 1 / p.gain_limit, p.gain_limit), np.float32)


def some_of(images: Floats) -> Floats:
    """About every sixteenth pixel of `[C, h, w]`, counted from all four corners, `[C, n]`.

    Those of a mirror image are the same, and so is all that is told from them.
    """
    rows, columns = ((n + 1) // 2 for n in images.shape[1:])
    turned = (images, images[:, ::-1], images[:, :, ::-1], images[:, ::-1, ::-1])
    return np.concatenate([one[:, :rows:4, :columns:4].reshape(len(images), -1) for one in turned], 1)


def medians(rows: Floats) -> Floats:
    """Median of each row; `np.median` takes several times as long for rows as short as these."""
    half = rows.shape[1] // 2
    if rows.shape[1] % 2:
        return np.asarray(np.partition(rows, half, axis=1)[:, half])
    both = np.partition(rows, (half - 1, half), axis=1)[:, half - 1 : half + 1]
    return np.asarray(both.mean(1))


def new_scene(raw: Floats, gain: Floats, soft: Floats, state: GroundState, p: GroundParams) -> bool:
    """Whether the picture is another all of a sudden, or the first after the dark.

    The noise of a picture is told from all of it, so that a cut would pass for noise. The means of blocks hold little
    noise, and are compared with a fixed difference from those of the picture before. They must be unlike, too: other
    light leaves what is bright bright. In the dark there is nothing to compare with, and a gain beyond its limits is
    more than a camera's exposure does.

    Args:
        raw, soft: the picture as it is, and blurred without its gain, `[3, h, w]`.
        gain: of each color, `[3]`.
        state: before this picture.
        p: constants.
    """
    import cv2

    if (np.abs(np.log(gain)) >= np.log(p.gain_limit) * (1 - 1e-6)).sum() > 1:
        return True
    if lit(state.mean.numpy(), p) < p.light <= lit(raw, p):
        return True
    size = (max(1, raw.shape[2] // p.block), max(1, raw.shape[1] // p.block))
    here, there = (
        np.stack([np.asarray(cv2.resize(plane, size, interpolation=cv2.INTER_AREA), np.float32) for plane in image])
        for image in (soft, state.before.numpy())
    )
    if (np.abs(here - there).max(0) > p.other).mean() <= p.changed:
        return False
    one, other = (grey_of(image) - grey_of(image).mean() for image in (here, there))
    return bool((one * other).sum() < p.alike * np.sqrt((one * one).sum() * (other * other).sum()))


def lit(picture: Floats, p: GroundParams) -> float:
    """Share of every sixteenth pixel that is not dark, `[3, h, w]`."""
    return float((some_of(picture).min(0) > p.dark).mean())


def shadow(light: Floats, may_be: Bytes, p: GroundParams) -> Bytes:
    """255 where the picture is the background with less light, evenly among neighbours, `[h, w]`."""
    import cv2

    mean = cv2.blur(light, (p.patch, p.patch))
    varies = cv2.blur(light * light, (p.patch, p.patch)) - mean * mean
    inner = may_be * ((mean > p.darkest) & (varies < p.uneven**2))
    # Its edge, where neighbours differ, belongs to it.
    wide = np.asarray(cv2.dilate(inner, np.ones((2 * p.penumbra + 1,) * 2, np.uint8)), np.uint8)
    return (wide & may_be) * np.uint8(255)
