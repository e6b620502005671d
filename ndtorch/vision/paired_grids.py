"""Responses on two coarse grids by one complex transform a filter: how kernels take the sums of `OrientedDoG`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ndtorch.kernels.load import kernel


class Pairs(NamedTuple):
    """What the filters and the weights of two grids become.

    Attributes:
        filters: spectra `[F, R, C]`, complex: of the first grid plus i times of the second, so that the responses on
            the first are the real part of an inverse transform, and those on the second its imaginary part.
        rows: weights of rows, `[2, R]`.
        columns: weights of columns, the two grids in turn, `[2 C]`.
    """

    filters: Tensor
    rows: Tensor
    columns: Tensor


def pair_up(spectra: Tensor, rows: Tensor, columns: Tensor) -> Pairs:
    """From half spectra `[2, F, R, C / 2 + 1]` and weights `[2, R]` and `[2, C]`.

    Frequencies that are their own mirror image must be zero, or real.
    """
    points = columns.shape[-1]
    back = -torch.arange(spectra.shape[-2]) % spectra.shape[-2]
    mirrored = spectra[..., back, 1 : (points + 1) // 2].conj().flip(-1)
    first, second = torch.cat([spectra, mirrored], -1)
    return Pairs(first + 1j * second, rows, columns.T.flatten())


def responses(columns: Tensor, pairs: Pairs) -> Tensor:
    """Of a half spectrum `[N, C / 2 + 1]` of an image: `[F, R, C, 2]`, both grids last.

    As large as those of `torch.fft.irfft2` times the number of points.
    """
    spectrum, filters = columns.numpy(), pairs.filters.to(columns.dtype).numpy()
    out = np.empty(filters.shape, filters.dtype)
    kernel("pair_spectrum", out.dtype).run(spectrum, filters, out)
    return torch.view_as_real(torch.fft.ifft2(torch.from_numpy(out)))


def weighted_sums(found: Tensor, pairs: Pairs) -> Tensor:
    """Sums over both grids of the magnitudes of `responses`, `[F]`."""
    values = found.flatten(-2).numpy()
    rows, columns = (weights.to(found.dtype).numpy() for weights in pairs[1:])
    sums = np.empty(len(values), values.dtype)
    kernel("pair_sums", values.dtype).run(values, rows, columns, sums)
    return torch.from_numpy(sums)
