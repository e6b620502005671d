"""Numbers that may differ between the scenes of a batch."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from ndtorch.errors import InputError

PerScene = float | Sequence[float] | Tensor
"""One number, or B numbers for a batch of B scenes."""

PerBar = float | Sequence[float] | Sequence[Sequence[float]] | Tensor
"""One number for all, one a bar `[bars]`, or one a scene and bar `[B, bars]`."""


def per_scene(name: str, value: PerScene) -> Tensor:
    """`value` as a float64 tensor of shape [] or [B] on the CPU, or `InputError`."""
    return _numbers(name, value, 1, "a finite number or a list of them")


def per_bar(name: str, value: PerBar) -> Tensor:
    """`value` as a float64 tensor of shape [bars] or [B, bars] on the CPU; one number becomes [1]."""
    numbers = _numbers(name, value, 2, "finite: a number, [bars] or [B, bars]")
    return numbers.reshape(1) if numbers.ndim == 0 else numbers


def pairs(
    first_name: str, first: PerScene, second_name: str, second: PerScene
) -> tuple[float, float] | list[tuple[float, float]]:
    """The two values of one scene, or B of them; one number goes with every scene of the other's batch."""
    a, b = per_scene(first_name, first).numpy(), per_scene(second_name, second).numpy()
    try:
        a, b = np.broadcast_arrays(a, b)
    except ValueError as error:
        raise InputError(
            f"{first_name} and {second_name} must hold equally many values, got {len(a)} and {len(b)}"
        ) from error
    if a.ndim == 0:
        return float(a), float(b)
    return list(zip(a.tolist(), b.tolist(), strict=True))


def _numbers(name: str, value: object, most_dims: int, wanted: str) -> Tensor:
    try:
        tensor = torch.as_tensor(value, dtype=torch.float64).cpu()
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} must be {wanted}, got {value!r}") from error
    if tensor.ndim > most_dims or tensor.numel() == 0 or not bool(torch.isfinite(tensor).all()):
        raise InputError(f"{name} must be {wanted}, got {tensor.tolist()}")
    return tensor
