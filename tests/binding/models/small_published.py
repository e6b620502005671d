"""A small published model, and sums for it."""

from __future__ import annotations

import math
from typing import Any

import torch

from ndtorch.binding import PublishedModel
from ndtorch.binding.models.published import PublishedConfig
from ndtorch.config import with_options
from ndtorch.vision import GROUPS

QUICK = {"gamma": 5.0, "settle": 0.1, "tau_onset": 0.1, "window": 0.5, "stable_window": 0.2}


def noise(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.rand(*shape, generator=torch.Generator().manual_seed(seed))


def first_stage() -> torch.Tensor:
    weights = torch.zeros(10, 10)
    for group, value in zip(GROUPS.values(), (0.3, 0.45, 0.45), strict=True):
        weights[group, group] = value
    return weights.fill_diagonal_(0)


def model(**options: Any) -> PublishedModel:
    options = {"size": (12, 14), **QUICK, **options}
    return PublishedModel(with_options(PublishedConfig(), options), first_stage())


def two_things(seconds: float, fps: float = 100.0) -> torch.Tensor:
    """Sums of a red thing going right and a green one going left, a third of a period apart, `[T, 10]`."""
    t = torch.arange(round(seconds * fps)) / fps
    red, green = (1 + 0.5 * torch.sin(2 * math.pi * 0.87 * t + phase) for phase in (0.0, 2.1))
    features = torch.zeros(2, 10)
    features[0, [1, 2, 4, 6, 7]] = torch.tensor([1.0, 0.6, 0.7, 0.7, 0.9])
    features[1, [0, 2, 4, 5, 8]] = torch.tensor([1.0, 0.6, 0.7, 0.7, 0.9])
    return 100 * torch.stack([red, green], -1) @ features
