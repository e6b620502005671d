"""Light that changes everywhere, among the sources of the sums."""

from __future__ import annotations

import torch
from torch import Tensor

from ndtorch.binding.readout.directions import LINEAR
from ndtorch.binding.readout.params import SumCriteria
from ndtorch.vision.features import GROUPS

LIGHT_MOST = 4
"""Among more sources, of six signals, even light can be a mixture of them."""


def even_light(delayed: Tensor, count: Tensor, limits: SumCriteria) -> Tensor:
    """The direction of light that changes everywhere, if it is among the sources of covariances `[B, 10, 10]`.

    All colors change alike then, and all orientations, and nothing moves with them. A direction of such light lies in
    the space of the sources to the last digit, or not at all.

    Returns:
        Orientations and colors of it, of unit length, zeros where there is none, `[B, 6]`.
    """
    found = delayed.new_zeros(len(delayed), 6)
    plane = delayed.new_zeros(6, 2)
    plane[:3, 0] = plane[3:, 1] = 3**-0.5
    for m in range(1, LIGHT_MOST + 1):
        at = (count == m).nonzero().squeeze(-1)
        if len(at) == 0:
            continue
        values, vectors = torch.linalg.eigh(delayed[at][:, LINEAR, LINEAR])
        basis, size = vectors[..., -m:], values[:, None, -m:].clamp_min(1e-12)
        _, cosines, axes = torch.linalg.svd(basis.mT @ plane)
        light = (plane @ axes[:, 0, :, None]).squeeze(-1)
        away = (1 - cosines[:, 0].square()).clamp_min(0).sqrt()
        # What the source does by itself, and the motion that goes along with it.
        inside = basis.mT @ light.unsqueeze(-1)
        deviation = (inside / size.transpose(-1, -2).sqrt()).norm(dim=-2)
        unmix = (basis / size @ inside).squeeze(-1) / deviation
        motion = delayed[at][:, GROUPS["motion"], :]
        largest = motion[..., GROUPS["motion"]].diagonal(dim1=-2, dim2=-1).amax(-1).clamp_min(1e-12).sqrt()
        along = (motion[..., LINEAR] @ unmix.unsqueeze(-1)).squeeze(-1).abs().amax(-1)
        one_sign = axes[:, 0, 0] * axes[:, 0, 1] > -0.05
        there = (away < limits.lit) & ((along < limits.unmoved * largest) | (m == 1)) & one_sign
        found[at] = torch.where(there.unsqueeze(-1), light, 0.0)
    return found


def without(white: Tensor, light: Tensor) -> Tensor:
    """Whitening `[B, 6, m]` of the sources other than the one of direction `light` `[B, 6]`, `[B, 6, m - 1]`.

    In white coordinates sources are at right angles, so the others lie in the plane across the light.
    """
    axis = white.mT @ light.unsqueeze(-1)
    others: Tensor = white @ torch.linalg.svd(axis)[0][..., 1:]
    return others
