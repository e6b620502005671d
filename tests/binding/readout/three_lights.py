"""Three things of known features and brightness, and how many the read-out of sums counts."""

from __future__ import annotations

import torch
from torch import Tensor

from ndtorch.binding.objects import ObjectTable
from ndtorch.binding.readout.sums import SumState, sums_table

MIXING = torch.zeros(3, 10)
MIXING[0, [1, 4, 5, 7]] = torch.tensor([1.0, 0.9, 0.3, 1.0])
MIXING[1, [0, 5, 6, 8]] = torch.tensor([1.0, 0.8, 0.2, 1.0])
MIXING[2, [3, 6, 4, 9]] = torch.tensor([1.0, 0.9, 0.1, 1.0])


def lights(seconds: float) -> Tensor:
    """Brightness of three things, `[T, 3]`."""
    t = torch.arange(round(seconds * 100)) / 100
    return 1 + 0.5 * torch.stack([(5 * t).sin(), (9 * t + 1).sin(), (3.3 * t).sin().sign()], -1)


def count(statistics: SumState) -> int:
    """How many objects there are, with no word from the network."""
    none = ObjectTable(torch.zeros(10, dtype=torch.bool), torch.zeros(10, 10))
    return int(sums_table(none, torch.zeros(10, 10), statistics, torch.zeros(10, 10)).table.owners.sum())
