"""Evaluating band-limited responses on a coarse grid: halving, low frequencies, quick lengths."""

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


def halving_gain(frequency: Tensor, times: int) -> Tensor:
    """Gain of `times` calls of `halve_rows` at frequencies in cycles per pixel; taking every second line halves it."""
    gain = torch.ones_like(frequency)
    for i in range(times):
        gain = gain * (math.pi * frequency * 2**i).cos().square()
    return gain


def halve_rows(image: Tensor) -> Tensor:
    """Every second row of `[..., H, W]` (H even, toroidal), smoothed with weights 1/2, 1, 1/2 beforehand.

    The smoothing keeps what lies beyond the new Nyquist frequency from folding back onto the filters' band.
    """
    even, odd = image.reshape(*image.shape[:-2], -1, 2, image.shape[-1]).unbind(-2)
    out = torch.add(even, odd, alpha=0.5)
    n = odd.shape[-2] - 1
    out.narrow(-2, 1, n).add_(odd.narrow(-2, 0, n), alpha=0.5)
    out.narrow(-2, 0, 1).add_(odd.narrow(-2, n, 1), alpha=0.5)
    return out


def halve_columns(image: Tensor) -> Tensor:
    """`halve_rows` of the columns."""
    return halve_rows(image.mT).mT


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


def low_rows(spectrum: Tensor, rows: int) -> Tensor:
    """The lowest `rows` frequencies along dim -2 of a spectrum, in the order of a transform of that length."""
    if rows == spectrum.shape[-2]:
        return spectrum
    negative = (rows - 1) // 2
    low = spectrum.narrow(-2, 0, rows - negative)
    return torch.cat([low, spectrum.narrow(-2, spectrum.shape[-2] - negative, negative)], -2)


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
