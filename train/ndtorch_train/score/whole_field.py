"""Objects over time from sums over the whole field, for comparison with local fields."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from ndtorch.binding import BoundObject, InhibitoryNetwork
from ndtorch.binding.readout.owners import owner_table, signal_statistics
from ndtorch.run.watchers import Watcher
from ndtorch.vision import FEATURES, GROUPS, HighPass

EVERY = 0.5
"""Seconds between read-outs."""
HEADINGS = ((-1.0, 0.0), (1.0, 0.0), (0.0, 1.0), (0.0, -1.0))


class WholeFieldWatcher(Watcher):
    """Collects the inputs of a model with a single field, and reads them out at the end.

    Args:
        dt: seconds between time steps.
        size: height and width of the frames, pixels.
    """

    def __init__(self, dt: float, size: tuple[int, int]) -> None:
        self.dt, self.size = dt, size
        self.parts: list[tuple[Tensor, Tensor]] = []

    def signals(self, signals: Any, weights: Tensor) -> None:
        """Keep the inputs of one chunk."""
        if len(signals.time):
            self.parts.append((signals.inputs[:, 0, 0], signals.time))

    def objects(self) -> list[BoundObject]:
        """The objects so far."""
        if not self.parts:
            return []
        inputs, times = (torch.cat(part) for part in zip(*self.parts, strict=True))
        return whole_field_objects(inputs, times, self.dt, self.size)


def whole_field_objects(inputs: Tensor, times: Tensor, dt: float, size: tuple[int, int]) -> list[BoundObject]:
    """Objects in normalised signals `[T, 10]` of one field taken at `times` `[T]`, by owners of the scale-free network.

    The read-out of the random scenes: an owner that has a direction is an object. Owners of the same main direction and
    color are one object, from the first read-out that shows it to the last; one alone does not count. Where it is
    nobody knows: in the middle.
    """
    steps = max(1, round(EVERY / dt))
    high_pass, network, memory = (
        HighPass(1.0, dt, sample_dims=1),
        InhibitoryNetwork.scale_free(10, dt),
        signal_statistics(dt, 2.0),
    )
    states: tuple[Any, Any, Any] = (None, None, None)
    seen: dict[tuple[int, int], list[tuple[float, Tensor]]] = {}
    for part, when in zip(torch.split(inputs, steps), torch.split(times, steps), strict=True):
        high, filtered = high_pass(part, states[0])
        _, learned = network(high, states[1])
        statistics = memory(high, states[2])
        states = (filtered, learned, statistics)
        table = owner_table(learned.weights, statistics, dt=dt)
        deviation = statistics.covariances[0, 0].diagonal().clamp_min(0).sqrt()
        for k in table.owners.nonzero().flatten().tolist():
            row = table.rows[k]
            motion, color = row[GROUPS["motion"]], row[GROUPS["color"]]
            if motion.max() > 0:
                key = (int(motion.argmax()), int(color.argmax()) if color.max() > 0 else -1)
                seen.setdefault(key, []).append((float(when[-1]), row * deviation))
    return [as_object(key, sights, size) for key, sights in seen.items() if len(sights) > 1]


def as_object(key: tuple[int, int], sights: list[tuple[float, Tensor]], size: tuple[int, int]) -> BoundObject:
    """An object of the whole field as one of those that have places."""
    height, width = size
    values = torch.stack([row for _, row in sights]).sum(0).double().numpy()
    index = GROUPS["motion"].start + key[0] if key[1] < 0 else GROUPS["color"].start + key[1]
    right, down = (float(part) * len(sights) for part in np.array(HEADINGS[key[0]]))
    return BoundObject(
        FEATURES[index],
        index,
        {name: float(v) for name, v in zip(FEATURES, values, strict=True) if v > 0},
        place=(width / 2, height / 2),
        first_seen=sights[0][0],
        last_seen=sights[-1][0],
        heading=(right, down),
        path=tuple((t, width / 2, height / 2) for t, _ in sights),
    )
