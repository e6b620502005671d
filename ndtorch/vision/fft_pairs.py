"""Responses on two coarse grids by one complex transform a filter: how kernels take the sums of `OrientedDoG`."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from ndtorch.utils.jit import jit

FAINT = 1e-12
"""Share of the largest value of a filter below which it is zero: the numbers at its far ends are so small that a
processor takes a hundred times as long for some of them, and nothing of them is left in a sum."""


def pair_up(spectra: Tensor, points: int) -> Tensor:
    """One complex spectrum a filter, `[F, R, C]`, from half spectra `[2, F, R, C / 2 + 1]` of two grids `points` wide.

    It is the first plus i times the second: the responses on the first grid are the real part of its inverse
    transform, those on the second the imaginary part. Frequencies that are their own mirror image must be zero, or
    real.
    """
    back = -torch.arange(spectra.shape[-2]) % spectra.shape[-2]
    mirrored = spectra[..., back, 1 : (points + 1) // 2].conj().flip(-1)
    first, second = torch.cat([spectra, mirrored], -1)
    both = first + 1j * second
    size = both.abs()
    kept: Tensor = both.where(size >= FAINT * size.amax((-2, -1), keepdim=True), 0)
    return kept


def responses(columns: Tensor, filters: Tensor) -> Tensor:
    """Of half spectra `[T, N, C / 2 + 1]` of images, by filters as of `halves`: `[T, F, R, C, 2]`, both grids last.

    Their magnitudes are those of `torch.fft.irfft2` of each grid.
    """
    wanted = filters.to(columns.real.dtype).numpy()
    out = np.empty((len(columns), *wanted.shape[1:], 2), wanted.dtype)
    pair_spectrum(torch.view_as_real(columns.contiguous()).numpy(), wanted, out)
    # A transform forward leaves out what the one back does to every number, and takes two thirds of the time.
    return torch.view_as_real(torch.fft.fft2(torch.view_as_complex(torch.from_numpy(out))))


def halves(filters: Tensor) -> Tensor:
    """Real and imaginary parts `[2, F, R, C]` of filters as of `pair_up`, divided by the number of points."""
    return torch.view_as_real(filters / filters[0].numel()).movedim(-1, 0).contiguous()


def pair_weights(rows: Tensor, columns: Tensor) -> Tensor:
    """Weights of the points of both grids in turn, `[R, 2 C]`, from those of rows `[2, R]` and of columns `[2, C]`."""
    return (rows.unsqueeze(-1) * columns.unsqueeze(1)).movedim(0, -1).flatten(-2).contiguous()


def weighted_sums(found: Tensor, weights: Tensor) -> Tensor:
    """Sums over both grids of the magnitudes of `responses`, `[T, F]`, by weights as of `pair_weights`."""
    values = found.flatten(-2).numpy()
    sums = np.empty(values.shape[:2], values.dtype)
    pair_sums(values, weights.to(found.dtype).numpy(), sums)
    return torch.from_numpy(sums)


@jit
def pair_spectrum(columns: Any, filters: Any, out: Any) -> None:
    """Cut the low rows out of half spectra and multiply them, and their mirror images, with every filter.

    Args:
        columns: spectra of real images, real and imaginary parts last, `[T, N, C / 2 + 1, 2]`.
        filters: real and imaginary parts, `[2, F, R, C]`, of the first grid plus i times that of the second.
        out: conjugates of the products, `[T, F, R, C, 2]`: the real part of a transform of them are the responses on
            the first grid, the imaginary part those on the second, with the other sign.
    """
    _, count, rows, full = filters.shape
    times, length, half, _ = columns.shape
    above = rows - (rows - 1) // 2
    real, imaginary = np.empty(full, columns.dtype), np.empty(full, columns.dtype)
    for t in range(times):
        for r in range(rows):
            place = r if r < above else length - rows + r
            back = rows - r if r else 0
            mirrored = back if back < above else length - rows + back
            here, there = columns[t, place], columns[t, mirrored]
            for c in range(half):
                real[c], imaginary[c] = here[c, 0], here[c, 1]
            for c in range(half, full):
                real[c], imaginary[c] = there[full - c, 0], -there[full - c, 1]
            for f in range(count):
                one, other, to = filters[0, f, r], filters[1, f, r], out[t, f, r]
                for c in range(full):
                    to[c, 0] = real[c] * one[c] - imaginary[c] * other[c]
                    to[c, 1] = -(real[c] * other[c] + imaginary[c] * one[c])


@jit
def pair_sums(responses: Any, weights: Any, sums: Any) -> None:
    """For every image and filter, magnitudes of both grids times the weights of their places, added up.

    Args:
        responses: `[T, F, R, 2 C]`, real and imaginary parts in turn.
        weights: `[R, 2 C]`, of both grids in turn.
        sums: `[T, F]`.
    """
    times, count, height, width = responses.shape
    for t in range(times):
        for f in range(count):
            total = 0.0
            for r in range(height):
                line, shares, part = responses[t, f, r], weights[r], responses.dtype.type(0)
                for c in range(width):
                    part += abs(line[c]) * shares[c]
                total += part
            sums[t, f] = total
