"""Spectral radius of inhibitory weights, and keeping it under a limit.

The weights are never negative, so their spectral radius is the Perron root: norms of powers bound it from above,
and powers of `W + I` converge to its eigenvector, where LAPACK cannot be asked.
"""

from __future__ import annotations

import torch
from torch import Tensor

from ndtorch.arguments import check_tensor
from ndtorch.errors import InputError

SQUARINGS = 14


def spectral_radius(weights: Tensor) -> Tensor:
    """Largest magnitude of any eigenvalue, `[..., N, N]` -> `[...]`. [B §2.2.1]

    Raises:
        InputError: not square matrices of finite numbers in single or double precision.

    >>> round(float(spectral_radius(torch.tensor([[0.0, 2.0], [2.0, 0.0]]))), 3)
    2.0
    """
    check_square("weights", weights)
    radius: Tensor = torch.linalg.eigvals(weights).abs().amax(-1)
    return radius


def check_square(name: str, weights: Tensor) -> None:
    """Raise `InputError` unless these are square matrices of finite numbers: with others, LAPACK may crash."""
    check_tensor(name, weights, half=False)
    if weights.ndim < 2 or weights.shape[-1] != weights.shape[-2]:
        raise InputError(f"{name} must be square matrices [..., N, N], got {tuple(weights.shape)}")


def limit_spectral_radius(weights: Tensor, limit: float) -> Tensor:
    """Scale non-negative weights down where their spectral radius exceeds `limit`. [B §2.4]

    Shapes: `[..., N, N]` -> `[..., N, N]`; each matrix of a batch has its own factor, `limit / radius` or 1.
    A cheap bound settles most calls, and then the very same tensor is returned.

    >>> limit_spectral_radius(torch.tensor([[0.0, 2.0], [2.0, 0.0]]), limit=1.0).round(decimals=3)
    tensor([[0., 1.],
            [1., 0.]])
    """
    if not limit > 0:
        raise InputError(f"limit must be a number > 0, got {limit}")
    if weights.ndim < 2 or weights.shape[-1] != weights.shape[-2]:
        raise InputError(f"weights must be [..., N, N], got {tuple(weights.shape)}")
    if torch.compiler.is_compiling() or not weights.is_cpu:
        return always_limited(weights, limit)
    # rho(W)^4 = rho(W^4) <= |W^4|: much tighter than |W|, for weights to silent neurons die out in the powers.
    squared = weights @ weights
    # Not "above": powers of huge weights overflow, and NaN compares false.
    suspect = ~(torch.linalg.matrix_norm(squared @ squared) <= limit**4)
    if not suspect.any():
        return weights
    # Nothing can be done for weights that are not numbers.
    suspect = suspect & torch.isfinite(weights).all(-1).all(-1)
    # In double precision: the root of single-precision weights can lie beyond single precision.
    factor = torch.ones(suspect.shape, dtype=torch.float64)
    # The last digits of the root are rounding: stay just inside.
    root = torch.linalg.eigvals(weights[suspect].double()).abs().amax(-1)
    factor[suspect] = (limit * (1 - 1e-6) / root).clamp_max(1.0)
    return (weights.double() * factor[..., None, None]).to(weights.dtype)


def always_limited(weights: Tensor, limit: float) -> Tensor:
    """`limit_spectral_radius` without decisions, for GPUs and compiled or exported programs: the same to 1e-4.

    Repeated squaring of `W + I` gives the dominant eigenvector, and Collatz and Wielandt's quotient `max (W v)_n / v_n`
    bounds the root from above, so the limit holds. Where neurons inhibit one another in one direction only, the
    bound comes down slowly: for a chain, of which the root is 0, it is `(N - 1) / 2^14` of the largest weight. So a
    chain of ten neurons with weights above 1800 times the limit is scaled down, and `limit_spectral_radius` leaves it.
    """
    w = weights.double()
    finite = torch.isfinite(w).all(-1).all(-1)[..., None, None]
    w = torch.where(finite, w, 0.0)
    scale = w.amax((-1, -2), keepdim=True).clamp_min(torch.finfo(torch.float64).tiny)
    power = w / scale + torch.eye(w.shape[-1], dtype=w.dtype, device=w.device)
    for _ in range(SQUARINGS):
        power = power @ power
        power = power / power.sum((-1, -2), keepdim=True)
    right = power.sum(-1)
    # Rows that have died out in the powers belong to smaller roots.
    tiny = torch.finfo(torch.float64).tiny
    ratio = (w @ right.unsqueeze(-1)).squeeze(-1) / right.clamp_min(tiny)
    root = torch.where(right > tiny, ratio, 0.0).amax(-1)[..., None, None]
    factor = (limit * (1 - 1e-6) / root.clamp_min(tiny)).clamp_max(1.0)
    return torch.where(finite, w * torch.where(root > limit, factor, 1.0), weights.double()).to(weights.dtype)
