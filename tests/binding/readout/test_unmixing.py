"""Number and mixing of sources in covariances."""

from __future__ import annotations

import torch
from torch import Tensor

from ndtorch.binding.readout.joint_diagonalisation import sources_of
from ndtorch.binding.readout.owners import SourceCriteria, SumCriteria
from ndtorch.binding.readout.source_count import undisturbed
from ndtorch.binding.readout.sums import SumStatistics
from tests.binding.readout.three_lights import MIXING, lights


def separated(sums: Tensor) -> tuple[int, Tensor, float]:
    """Number, mixing and gap of the sources in the long memory."""
    kept = undisturbed(SumStatistics()(sums).all, 12.0, 1.0, SumCriteria())
    found = sources_of((kept / kept[0].diagonal().amax()).double(), SourceCriteria(), SumCriteria())
    return int(found.number), found.mixing, float(found.gap)


def test_the_mixing_of_known_sources_is_found() -> None:
    number, mixing, _ = separated(lights(40) @ MIXING)
    assert number == 3
    unit = torch.nn.functional.normalize
    likeness = unit(mixing[:3].float(), dim=-1) @ unit(MIXING, dim=-1).T
    assert likeness.amax(-1).min() > 0.99
    assert sorted(likeness.argmax(-1).tolist()) == [0, 1, 2]


def test_equal_rates_are_said_to_be_indistinct() -> None:
    t = torch.arange(3000) / 100
    equal = torch.stack([torch.sin(5 * t), torch.sin(5 * t + 1.5)], -1)
    other = torch.stack([torch.sin(5.5 * t), torch.sin(8.2 * t + 1.5)], -1)
    assert separated(equal @ MIXING[:2])[2] < 0.02 < separated(other @ MIXING[:2])[2]
