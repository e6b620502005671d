"""What the light does to a picture: its exposure against the ground, its noise, and another scene."""

from __future__ import annotations

import numpy as np

from ndtorch.kernels.light_change import light_change as light_change_kernel
from ndtorch.kernels.switch import kernels_wanted
from ndtorch.vision.camera.ground import MEDIAN_SIZE, Floats, GroundParams, grey_of, medians, some_of


def light_change(picture: Floats, ground: Floats, p: GroundParams) -> tuple[Floats, Floats, bool, float]:
    """Gain of each color and noise, `[3]`, whether the picture is another, and how colored its ground is.

    It is the first after the dark, where there was nothing to compare with, or a gain is beyond its limits, which is
    more than a camera's exposure does.

    Args:
        picture, ground: `[3, h, w]`.
        p: constants.
    """
    if kernels_wanted():
        gain, noise = np.empty(3, np.float32), np.empty(3, np.float32)
        constants = (p.dark, p.light, p.gain_limit, MEDIAN_SIZE, p.least_noise)
        here, there, hue = light_change_kernel(picture, ground, *constants, gain, noise)
    else:
        gain = exposure(picture, ground, p)
        some = np.abs(some_of(picture) / gain[:, None] - some_of(ground))
        noise = np.maximum(medians(some) / MEDIAN_SIZE, p.least_noise).astype(np.float32)
        here, there, hue = lit(picture, p), lit(ground, p), chroma(ground)
    strong = (np.abs(np.log(gain)) >= np.log(p.gain_limit) * (1 - 1e-6)).sum() > 1
    return gain, noise, bool(strong) or there < p.light <= here, hue


def chroma(ground: Floats) -> float:
    """Mean distance of a pixel's largest color from its smallest, of every fourth row and column, `[3, h, w]`."""
    some = ground[:, ::4, ::4]
    return float((some.max(0) - some.min(0)).mean())


def exposure(picture: Floats, ground: Floats, p: GroundParams) -> Floats:
    """Gain of each color, `[3]`: the median ratio over every sixteenth pixel whose background is not dark."""
    one, other = some_of(picture), some_of(ground)
    bright = other.min(0) > p.dark
    if bright.mean() < p.light:
        return np.ones(3, np.float32)
    gain = medians(one[:, bright] / other[:, bright])
    return np.asarray(np.clip(gain, 1 / p.gain_limit, p.gain_limit), np.float32)


def lit(picture: Floats, p: GroundParams) -> float:
    """Share of every sixteenth pixel that is not dark, `[3, h, w]`."""
    return float((some_of(picture).min(0) > p.dark).mean())


def changed_blocks(soft: Floats, before: Floats, p: GroundParams) -> float:
    """Share of the blocks of a picture that changed at once: where that is large, it may be another scene.

    The noise of a picture is told from all of it, so that a cut would pass for noise. The means of blocks hold little
    noise, and are compared with a fixed difference from those of the picture before.

    Args:
        soft, before: the picture and the one before, blurred, `[3, h, w]`.
        p: constants.
    """
    return float((np.abs(blocks(soft - before, p)).max(0) > p.other).mean())


def unlike(soft: Floats, before: Floats, p: GroundParams) -> bool:
    """Whether blocks are bright elsewhere than before, as of `changed_blocks`: other light leaves what is bright
    bright."""
    one, other = (grey_of(image) - grey_of(image).mean() for image in (blocks(soft, p), blocks(before, p)))
    return bool((one * other).sum() < p.alike * np.sqrt((one * one).sum() * (other * other).sum()))


def blocks(image: Floats, p: GroundParams) -> Floats:
    """Means of blocks of an image, `[3, h', w']`."""
    import cv2

    size = (max(1, image.shape[2] // p.block), max(1, image.shape[1] // p.block))
    return np.stack([np.asarray(cv2.resize(plane, size, interpolation=cv2.INTER_AREA), np.float32) for plane in image])
