"""Evaluating band-limited responses on a coarse grid: thinning, low frequencies, quick lengths."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor


class Thinning(NamedTuple):
    """An image with fewer rows and columns.

    Attributes:
        size: height and width of what is left, margins included.
        blocks: rows, and columns, that become one.
        margins: mirrored rows above and below, and columns at both sides.
    """

    size: tuple[int, int]
    blocks: tuple[int, int]
    margins: tuple[int, int]


def halvings(length: int, spacing: float) -> int:
    """How often a line of `length` can be halved while its samples stay within `spacing`."""
    times = 0
    while length % 2 == 0 and 2 ** (times + 1) <= spacing:
        length //= 2
        times += 1
    return times


def thinning_gain(frequency: Tensor, block: int) -> Tensor:
    """Gain of `thin_rows` at frequencies in cycles per pixel; taking one line of each block divides it by `block`."""
    gain, step = (math.pi * frequency).cos() if block > 1 else torch.ones_like(frequency), 1
    while step < block:
        gain = gain * (math.pi * frequency * step).cos().square()
        step *= 2
    return gain


def thin_rows(image: Tensor, block: int) -> Tensor:
    """One row for each `block` rows of `[..., H, W]` (H a multiple of it, toroidal), at their middle.

    Weights fall off as a triangle from that middle over the length of a block: 1/4, 3/4, 3/4, 1/4 for two. The
    smoothing keeps what lies beyond the new Nyquist frequency from folding back onto the filters' band; and what is
    made of a mirror image is the mirror image of what is made.
    """
    if block == 1:
        return image
    away = (torch.arange(block, dtype=image.dtype, device=image.device) - (block - 1) / 2) / block
    weights = torch.stack([1 - away.abs(), away.clamp_min(0), (-away).clamp_min(0)])
    own, down, up = (weights @ image.reshape(*image.shape[:-2], -1, block, image.shape[-1])).unbind(-2)
    return own + down.roll(1, -2) + up.roll(-1, -2)


def thin_columns(image: Tensor, block: int) -> Tensor:
    """`thin_rows` of the columns."""
    return image if block == 1 else thin_rows(image.mT, block).mT


def mirrored_start(cell: float) -> float:
    """Where a line of samples every `cell` pixels begins, so that a line and its mirror image have the same samples.

    Pixel n of a line of N is N - 1 - n in the mirror: samples must lie around -1/2, on it or half a cell from it. Of
    those the nearest to 0 is taken, which is 0 where every pixel is a sample. The same holds for samples half a
    cell further on.
    """
    return -0.5 + round(1 / cell) * cell / 2


def smooth_margin(length: int, wanted: int) -> int:
    """Smallest margin >= `wanted` that makes `length + 2 margin` a product of 2, 3 and 5: a quick transform."""
    for margin in range(min(wanted, length - 1), length if wanted else 1):
        if is_smooth(length + 2 * margin):
            return margin
    return min(wanted, length - 1)


def smooth_length(at_least: int) -> int:
    """Smallest n >= `at_least` that is a product of 2, 3 and 5: a quick transform."""
    n = max(1, at_least)
    while not is_smooth(n):
        n += 1
    return n


def is_smooth(n: int) -> bool:
    """Whether n is a product of 2, 3 and 5."""
    for factor in (2, 3, 5):
        while n % factor == 0:
            n //= factor
    return n == 1


def low_rows(length: int, rows: int) -> Tensor:
    """Numbers of the lowest `rows` of the frequencies of a line of `length`, in the order of a transform of `rows`."""
    negative = (rows - 1) // 2
    return torch.cat([torch.arange(rows - negative), torch.arange(length - negative, length)])


def inside_weights(length: int, points: int, margin: int, offset: float) -> Tensor:
    """Share of each of `points` equal cells over `length` that lies inside the margins, `[points]`.

    Pixel n covers n - 1/2 to n + 1/2 and a cell is centered on its sample; `offset` shifts samples, in cells.
    """
    cell = length / points
    middle = (torch.arange(points, dtype=torch.float64) + offset) * cell
    low, high = margin - 0.5, length - margin - 0.5
    right = (middle + cell / 2).clamp(low, high)
    left = (middle - cell / 2).clamp(low, high)
    return (right - left) / cell
