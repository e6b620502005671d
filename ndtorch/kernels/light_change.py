"""How much lighter a picture is than its ground, color by color, and how noisy, from about every sixteenth pixel."""

from __future__ import annotations

import numpy as np

from ndtorch.kernels.filters import Array
from ndtorch.kernels.nth import few_of, middle_of


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
) -> tuple[float, float]:
    """`exposure`, the noise, and `lit` of `ndtorch.vision.camera.figures`.

    Args:
        picture, ground: `[3, h, w]`.
        dark, light, limit, median_size, least: constants.
        gain, noise: become those of each color, `[3]`.

    Returns:
        Share of the picture, and of the ground, that is not dark.
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
    for c in range(3):
        gain[c] = 1
        if bright / count >= light and bright:
            k = 0
            for n in range(count):
                values[k] = one[c][n] / other[c][n]
                k += keep[n]
            gain[c] = min(max(middle_of(values, bright), kind(1 / limit)), kind(limit))
        for n in range(count):
            values[n] = abs(one[c][n] / gain[c] - other[c][n])
        noise[c] = max(middle_of(values, count) / kind(median_size), kind(least))
    return lit / count, bright / count
