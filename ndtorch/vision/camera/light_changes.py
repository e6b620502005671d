"""What the light does to a picture: its exposure against the ground, its noise, and another scene."""

from __future__ import annotations

import numpy as np

from ndtorch.kernels.load import kernel
from ndtorch.kernels.switch import kernels_wanted
from ndtorch.vision.camera.ground import MEDIAN_SIZE, Floats, GroundParams, grey_of, medians, some_of


def light_change(picture: Floats, ground: Floats, p: GroundParams) -> tuple[Floats, Floats, bool]:
    """Gain of each color and noise, `[3]`, and whether the picture is another.

    It is the first after the dark, where there was nothing to compare with, or a gain is beyond its limits, which is
    more than a camera's exposure does.

    Args:
        picture, ground: `[3, h, w]`.
        p: constants.
    """
    if kernels_wanted():
        gain, noise = np.empty(3, np.float32), np.empty(3, np.float32)
        constants = (p.dark, p.light, p.gain_limit, MEDIAN_SIZE, p.least_noise)
        here, there = kernel("light_change").run(picture, ground, *constants, gain, noise)
    else:
        gain = exposure(picture, ground, p)
        some = np.abs(some_of(picture) / gain[:, None] - some_of(ground))
        noise = np.maximum(medians(some) / MEDIAN_SIZE, p.least_noise).astype(np.float32)
        here, there = lit(picture, p), lit(ground, p)
    strong = (np.abs(np.log(gain)) >= np.log(p.gain_limit) * (1 - 1e-6)).sum() > 1
    return gain, noise, bool(strong) or there < p.light <= here


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


def new_scene(soft: Floats, before: Floats, p: GroundParams) -> bool:
    """Whether the picture is another all of a sudden.

    The noise of a picture is told from all of it, so that a cut would pass for noise. The means of blocks hold little
    noise, and are compared with a fixed difference from those of the picture before. They must be unlike, too: other
    light leaves what is bright bright.

    Args:
        soft, before: the picture and the one before, blurred, `[3, h, w]`.
        p: constants.
    """
    import cv2

    size = (max(1, soft.shape[2] // p.block), max(1, soft.shape[1] // p.block))

    def blocks(image: Floats) -> Floats:
        means = [cv2.resize(plane, size, interpolation=cv2.INTER_AREA) for plane in image]
        return np.asarray(np.stack(means), np.float32)

    if (np.abs(blocks(soft - before)).max(0) > p.other).mean() <= p.changed:
        return False
    one, other = (grey_of(image) - grey_of(image).mean() for image in (blocks(soft), blocks(before)))
    return bool((one * other).sum() < p.alike * np.sqrt((one * one).sum() * (other * other).sum()))
