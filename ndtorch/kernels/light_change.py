"""How much lighter a picture is than its ground, color by color, and how noisy, from about every sixteenth pixel."""

from __future__ import annotations

import numpy as np

from ndtorch.kernels.nth import few_of, middle_of
from ndtorch.utils.jit import jit
from ndtorch.vision._kernels_row import Array


@jit
def light_change(
    picture: Array,
    ground: Array,
    dark: float,
    light: float,
    limit: float,
    median_size: float,
    least: float,
    gain: Array,
    noise: Array,
) -> tuple[float, float, float]:
    """`exposure`, the noise, and `lit` of `ndtorch.vision.camera.figures`.

    Args:
        picture, ground: `[3, h, w]`.
        dark, light, limit, median_size, least: constants.
        gain, noise: become those of each color, `[3]`.

    Returns:
        Share of the picture, and of the ground, that is not dark, and `chroma` of the ground.
    """
    kind = picture.dtype.type
    one = (few_of(picture[0]), few_of(picture[1]), few_of(picture[2]))
    other = (few_of(ground[0]), few_of(ground[1]), few_of(ground[2]))
    count, lit, bright = one[0].shape[0], 0, 0
    values, keep = np.empty(count, picture.dtype), np.empty(count, np.bool_)
    for n in range(count):
        lit += min(one[0][n], one[1][n], one[2][n]) > kind(dark)
        keep[n] = min(other[0][n], other[1][n], other[2][n]) > kind(dark)
        bright += keep[n]
    every = bright == count
    for c in range(3):
        gain[c] = 1
        # First its gain, from what is not dark, then its noise.
        for turn in range(0 if bright / count >= light and bright else 1, 2):
            k = count
            if turn == 1:
                for n in range(count):
                    values[n] = abs(one[c][n] / gain[c] - other[c][n])
            elif every:
                for n in range(count):
                    values[n] = one[c][n] / other[c][n]
            else:
                k = 0
                for n in range(count):
                    values[k] = one[c][n] / other[c][n]
                    k += keep[n]
            middle = middle_of(values, k)
            if turn == 0:
                gain[c] = min(max(middle, kind(1 / limit)), kind(limit))
            else:
                noise[c] = max(middle / kind(median_size), kind(least))
    total, many = 0.0, 0
    for y in range(0, ground.shape[1], 4):
        for x in range(0, ground.shape[2], 4):
            red, green, blue = ground[0, y, x], ground[1, y, x], ground[2, y, x]
            total += max(red, green, blue) - min(red, green, blue)
            many += 1
    return lit / count, bright / count, total / many
