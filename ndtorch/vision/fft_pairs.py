"""Responses on two coarse grids by one complex transform a filter: how kernels take the sums of `OrientedDoG`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ndtorch.vision._kernels_orientation import pair_fields as pair_fields_kernel
from ndtorch.vision._kernels_orientation import pair_spectrum, pair_sums

FAINT = 1e-12
"""Share of the largest value of a filter below which it is zero: the numbers at its far ends are so small that a
processor takes a hundred times as long for some of them, and nothing of them is left in a sum."""


class PairFields(NamedTuple):
    """Weights with which magnitudes on both grids are summed over R' x C' fields.

    Attributes:
        places: the two rows of fields to which a row of each grid belongs, `[2, R, 2]`.
        shares: how much, `[2, R, 2]`.
        columns: weights in each column of fields, `[2, C', 2 C]`: the points of the two grids in turn, and zero for
            those of the other grid.
    """

    places: Tensor
    shares: Tensor
    columns: Tensor


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


def pair_fields(rows: Tensor, columns: Tensor) -> PairFields:
    """From weights `[2, R', R]` and `[2, C', C]` of the points of both grids, of which at most two rows are not zero
    at a point."""
    shares, places = rows.mT.topk(2, -1)
    line = columns.new_zeros(2, columns.shape[-2], columns.shape[-1], 2)
    line[0, ..., 0], line[1, ..., 1] = columns[0], columns[1]
    return PairFields(places.contiguous(), shares.contiguous(), line.flatten(-2))


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


def field_sums(found: Tensor, fields: PairFields) -> Tensor:
    """Sums over both grids of the magnitudes of `responses` in every field, `[T, F, R', C']`."""
    values = found.flatten(-2).numpy()
    shares, columns = (weights.to(found.dtype).numpy() for weights in fields[1:])
    sums = np.empty((*values.shape[:2], int(fields.places.max()) + 1, columns.shape[1]), values.dtype)
    for one, into in zip(values, sums, strict=True):
        pair_fields_kernel(one, fields.places.numpy(), shares, columns, into)
    return torch.from_numpy(sums)
