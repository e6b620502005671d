"""How much a picture changes at every pixel, and where by more than noise."""

from __future__ import annotations

import numpy as np

from ndtorch.kernels.filters import Array
from ndtorch.kernels.nth import few_of, middle_of


def restless(
    picture: Array,
    before: Array,
    own: Array,
    moved: float,
    spread: float,
    sizes: tuple[float, float],
    follow: float,
    surprise: float,
    over: Array,
    after: Array,
) -> None:
    """The first part of `ndtorch.vision.camera.figures.stillness`.

    Args:
        picture, before: blurred, `[3, h, w]`.
        own: mean change from picture to picture, `[h, w]`.
        moved, spread, follow, surprise: constants.
        sizes: mean magnitude of a normal variable against its deviation, and median of its magnitude likewise.
        over: becomes 1 where the change is more than noise, `[h, w]` uint8.
        after: becomes the mean change, `[h, w]`.
    """
    _, height, width = picture.shape
    kind = picture.dtype.type
    change = np.empty((height, width), picture.dtype)
    third, usual = kind(1 / 3), kind(1 / sizes[0])
    for y in range(height):
        for x in range(width):
            red, green = abs(picture[0, y, x] - before[0, y, x]), abs(picture[1, y, x] - before[1, y, x])
            change[y, x] = (red + green + abs(picture[2, y, x] - before[2, y, x])) * third
    some = few_of(change)
    noise = kind(middle_of(some, some.shape[0]) / kind(sizes[1]))
    for y in range(height):
        for x in range(width):
            here, usually = change[y, x], own[y, x]
            least = max(noise, usually * usual)
            over[y, x] = here > max(kind(moved), kind(spread) * least)
            after[y, x] = usually + kind(follow) * (min(here, kind(surprise) * least) - usually)
