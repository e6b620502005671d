"""One pass over silhouettes: box, middle, color and shades of each, and how far it stands out."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ndtorch.kernels.any_of import any_of
from ndtorch.utils.jit import jit
from ndtorch.vision._kernels_row import Array


class ShadeNumbers(NamedTuple):
    """`Light` as plain numbers: its brightest patch, and `ShadeParams`."""

    brightest: float
    palest: float
    pale: float
    white: tuple[float, float]
    black: tuple[float, float]


@jit
def sightings(
    silhouettes: Array,
    slots: Array,
    doubted: Array,
    picture: Array,
    ground: Array,
    deviation: Array,
    noise: Array,
    mean_size: float,
    balance: Array,
    p: ShadeNumbers,
    every: int,
    table: Array,
) -> None:
    """See `ndtorch.binding.tracking.silhouettes.measured`.

    Args:
        silhouettes: number of the track of every pixel plus one, `[h, w]` int32.
        slots: row of the table for each such number, `[n]` int32.
        doubted: of which tracks it is asked how far they stand out, `[K]` bool.
        picture, ground, deviation: `[3, h, w]`.
        noise, balance: of each color, `[3]`.
        mean_size: mean magnitude of a normal variable against its deviation.
        p: the light.
        every: of so many pixels of a silhouette one is looked at for its shade.
        table: becomes what is seen, `[K, 15]` float64; all zero where nothing is.
    """
    height, width = silhouettes.shape
    count, kind = table.shape[0], picture.dtype.type
    own, third, one, none = kind(1 / mean_size), kind(3), kind(1), kind(0)
    white, black = kind(p.white[1] - p.white[0]), kind(p.black[1] - p.black[0])
    sums, looked = np.zeros((count, 2)), np.zeros(count)
    for k in range(count):
        for n in range(15):
            table[k, n] = 0
        table[k, 0], table[k, 1] = height, width
    for y in range(height):
        for x in range(width if any_of(silhouettes[y]) else 0):
            name = silhouettes[y, x]
            if name <= 0:
                continue
            k = slots[name]
            row = table[k]
            row[0], row[1] = min(row[0], y), min(row[1], x)
            row[2], row[3] = max(row[2], y + 1), max(row[3], x + 1)
            red, green, blue = picture[0, y, x], picture[1, y, x], picture[2, y, x]
            row[7], row[8], row[9] = row[7] + red, row[8] + green, row[9] + blue
            sums[k, 0], sums[k, 1] = sums[k, 0] + y, sums[k, 1] + x
            if doubted[k]:
                most = none
                for c in range(3):
                    least = max(deviation[c, y, x] * own, noise[c])
                    most = max(most, abs(picture[c, y, x] - ground[c, y, x]) / least)
                row[14] += most
            if int(row[4]) % every == 0:
                red, green, blue = red * balance[0], green * balance[1], blue * balance[2]
                bright = (red + green + blue) / third
                hue = (max(red, green, blue) - bright) / max(kind(p.pale) * bright, kind(p.palest)) - one
                hue = min(max(hue, none), one)
                light = bright / kind(p.brightest)
                pale = min(max((light - kind(p.white[0])) / white, none), one)
                dark = min(max((kind(p.black[1]) - light) / black, none), one)
                row[10] += pale * (one - hue)
                row[11] += (one - pale - dark) * (one - hue)
                row[12] += dark * (one - hue)
                row[13] += hue
                looked[k] += 1
            row[4] += 1
    for k in range(count):
        row, pixels = table[k], max(table[k, 4], 1)
        for n in range(7, 10):
            row[n] /= pixels
        for n in range(10, 14):
            row[n] /= max(looked[k], 1)
        row[14] /= pixels
        if row[4] == 0:
            row[0] = row[1] = 0
            continue
        # The pixel nearest to the middle, and the nearest point in it: several pixels may be as near.
        down, across = sums[k, 0] / pixels, sums[k, 1] / pixels
        least, best_row, best_column = 1e30, 0, 0
        for y in range(int(row[0]), int(row[2])):
            for x in range(int(row[1]), int(row[3])):
                name = silhouettes[y, x]
                if name > 0 and slots[name] == k:
                    away = (y - down) ** 2 + (x - across) ** 2
                    if away < least:
                        least, best_row, best_column = away, y, x
        row[5] = min(max(down, best_row - 0.5), best_row + 0.5) + 0.5
        row[6] = min(max(across, best_column - 0.5), best_column + 0.5) + 0.5
