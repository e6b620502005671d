"""Objects over time from sums over the whole field: owners of the scale-free network, read out again and again."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from ndtorch.binding.network import InhibitoryNetwork, NetworkState
from ndtorch.binding.readout.owners import SignalStatistics, StatisticsState, owner_table
from ndtorch.binding.tracking.tracks import ObjectFile
from ndtorch.vision.temporal import FilterState, HighPass

MIDDLE = 0.5
"""Where an object is when nobody knows."""


class WholeFieldState(NamedTuple):
    """State of `WholeField`: high-pass, network, statistics of its inputs."""

    high: FilterState | None
    network: NetworkState | None
    statistics: StatisticsState | None


class WholeField(nn.Module):
    """Ten sums of the whole picture through the scale-free network, and the objects in view every half second.

    The read-out of the random scenes, for comparison with local fields: an owner that has a direction is an object.
    Owners of the same main direction and colour are one object, from the first read-out that shows it to the last;
    one alone does not count.

    Args:
        dt: seconds between time steps.
        every: seconds between read-outs.
    """

    def __init__(self, dt: float, every: float = 0.5) -> None:
        super().__init__()
        self.dt, self.steps = dt, max(1, round(every / dt))
        self.high_pass = HighPass(1.0, dt, sample_dims=1)
        self.network = InhibitoryNetwork.scale_free(10, dt)
        self.statistics = SignalStatistics(dt, tau=2.0)

    def forward(self, inputs: Tensor, times: Tensor) -> list[ObjectFile]:
        """Objects in normalised signals `[T, 10]` taken at `times` `[T]`."""
        state = WholeFieldState(None, None, None)
        seen: dict[tuple[int, int], list[tuple[float, Tensor]]] = {}
        for part, when in zip(torch.split(inputs, self.steps), torch.split(times, self.steps), strict=True):
            high, filtered = self.high_pass(part, state.high)
            _, network = self.network(high, state.network)
            statistics = self.statistics(high, state.statistics)
            state = WholeFieldState(filtered, network, statistics)
            table = owner_table(network.weights, statistics, dt=self.dt)
            deviation = statistics.covariance.diagonal().clamp_min(0).sqrt()
            for k in table.owners.nonzero().flatten().tolist():
                row = table.rows[k]
                if row[:4].max() > 0:
                    key = (int(row[:4].argmax()), int(row[7:].argmax()) if row[7:].max() > 0 else -1)
                    seen.setdefault(key, []).append((float(when[-1]), row * deviation))
        return [as_file(key, sights) for key, sights in seen.items() if len(sights) > 1]


def as_file(key: tuple[int, int], sights: list[tuple[float, Tensor]]) -> ObjectFile:
    """An object of the whole field as one of those that have places."""
    heading = np.array([(-1.0, 0.0), (1.0, 0.0), (0.0, 1.0), (0.0, -1.0)][key[0]]) * len(sights)
    features = torch.stack([row for _, row in sights]).sum(0).double().numpy()
    winners = np.zeros(10)
    winners[key[0] if key[1] < 0 else 7 + key[1]] = len(sights)
    return ObjectFile([(t, MIDDLE, MIDDLE, 1.0) for t, _ in sights], heading, features, features, winners)
