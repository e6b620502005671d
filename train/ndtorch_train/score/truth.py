"""What there is to be found: the features of every bar, through the settled first stage."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from ndtorch.binding.feedback import settled
from ndtorch.binding.normalise import divide, group_max, spread_groups
from ndtorch_train.score.scenes import Scene, gains, moving

PRESENT = 1 / 3
"""Share of its group's largest from which on a feature belongs to an object."""


def by_group(values: Tensor) -> Tensor:
    """Each group of features divided by its own largest, `[..., 10]`; zero where a group has nothing positive."""
    values = values.clamp_min(0)
    return divide(values, spread_groups(group_max(values)))


def present(values: Tensor) -> Tensor:
    """Which features are there, `[..., 10]` bool: at least a third of the largest of their group."""
    return by_group(values) >= PRESENT


def true_features(scenes: Sequence[Scene], first_stage: Tensor) -> list[Tensor]:
    """Features of every bar of every scene, each `[bars, 10]` bool.

    A bar's own fluctuating sums, each group over its largest, go through the settled first stage,
    `(I + W)^-1`; what comes out at a third of its group's largest or more is a feature of the bar.
    """
    bars = [bar for scene in scenes for bar in scene.bars]
    strength = torch.stack([gains(bar) for bar in bars])
    light = torch.from_numpy(np.stack([bar.light for bar in bars]))
    through_motion, direct = moving(light).std(-1, keepdim=True), light.std(-1, keepdim=True)
    own = torch.cat([strength[:, :4] * through_motion, strength[:, 4:] * direct], -1)
    features = present(by_group(own) @ settled(first_stage).T)
    return list(torch.split(features, [len(scene.bars) for scene in scenes]))
