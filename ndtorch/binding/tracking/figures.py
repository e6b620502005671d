"""Tracks of figures, as they are in a state and as they are worked with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

Numbers = npt.NDArray[np.float64]
SIGHTING = 10
"""Numbers kept of every sighting: time, row and column of its middle, top, left, bottom and right, pixels, and row and
column by which it is followed."""
PIXELS, FOLLOWED = 7, slice(8, 10)
PATCH = 12
"""Rows and columns of what is kept of a track's looks."""


class FigureTable(NamedTuple):
    """N tracks as tensors, as they are in a state. N and P depend on the run.

    Attributes:
        number: of every track, in the order in which they began, `[N]` int64.
        known: whether it is an object, `[N]` bool.
        velocity: rows and columns (shares of the height) a second, `[N, 2]` float64.
        extent: remembered height and width, shares of the height, `[N, 2]`.
        color: remembered color, `[N, 3]`.
        start: place at which it began, `[N, 2]`; moved: time at which it last moved on, `[N]`.
        rest: place at that time, `[N, 2]`.
        inputs, outputs: of the network, sums over its sightings, `[N, 10]`.
        shades: how much of it was white, grey, black, and colored, sums over its sightings, `[N, 4]`.
        looked: box in which it was looked at closely, shares of the height, and patch: what was seen there, less the
            ground, `[N, 4]` and `[N, 3, PATCH, PATCH]` float32.
        unlike: sums of squared differences between that and what was at the same place later, and at its new one,
            `[N, 2]`.
        sure: by how many deviations of the noise it stood out, and narrow: share of it that may be a narrow shadow,
            summed over the sightings of those that are no objects yet, `[N]` float64.
        since: time at which it first became an object, -1 before, `[N]` float64. With a time and not known it was
            taken back.
        length: sightings of every track, `[N]` int64.
        path: all their sightings, track after track, `[P, 10]`: time, and in shares of the height row and column of its
            middle, top, left, bottom and right, pixels, and row and column by which it is followed.
    """

    number: Tensor
    known: Tensor
    velocity: Tensor
    extent: Tensor
    color: Tensor
    start: Tensor
    moved: Tensor
    rest: Tensor
    inputs: Tensor
    outputs: Tensor
    shades: Tensor
    looked: Tensor
    patch: Tensor
    unlike: Tensor
    sure: Tensor
    narrow: Tensor
    since: Tensor
    length: Tensor
    path: Tensor


@dataclass
class Figure:
    """One track: the attributes are those of `FigureTable`."""

    number: int
    known: bool
    velocity: Numbers
    extent: Numbers
    color: Numbers
    start: Numbers
    moved: float
    rest: Numbers
    inputs: Numbers
    outputs: Numbers
    shades: Numbers
    looked: Numbers
    patch: npt.NDArray[np.float32]
    unlike: Numbers
    sure: float
    narrow: float
    since: float
    before: Numbers
    late: list[tuple[float, ...]] = field(default_factory=list)

    @property
    def path(self) -> Numbers:
        """All sightings, `[n, 10]`."""
        return np.concatenate([self.before, np.array(self.late).reshape(-1, SIGHTING)]) if self.late else self.before

    @property
    def last(self) -> tuple[float, ...]:
        """The latest sighting."""
        return self.late[-1] if self.late else tuple(self.before[-1].tolist())

    @property
    def first_seen(self) -> float:
        """Seconds since the first frame."""
        return float(self.before[0, 0]) if len(self.before) else self.late[0][0]

    @property
    def last_seen(self) -> float:
        """Time of the latest sighting."""
        return self.last[0]

    @property
    def size(self) -> float:
        """Mean of height and width."""
        tall, wide = self.extent.tolist()
        return float(tall + wide) / 2

    def expected(self, time: float, most: float) -> tuple[float, float]:
        """Row and column it should have reached, going on for `most` seconds after it was last seen."""
        last, (down, across) = self.last, self.velocity.tolist()
        row, column = last[FOLLOWED]
        # What is lost is not followed out of the picture for ever.
        gap = min(time - last[0], most)
        return row + down * gap, column + across * gap

    def box(self, time: float, most: float) -> tuple[float, float, float, float]:
        """Top, left, bottom and right of where it should be, as `expected`."""
        (row, column), (tall, wide) = self.expected(time, most), self.extent.tolist()
        return row - tall / 2, column - wide / 2, row + tall / 2, column + wide / 2


def figures_of(table: FigureTable) -> list[Figure]:
    """The tracks of a table. They share its memory and never write to it."""
    paths = np.split(table.path.numpy(), np.cumsum(table.length.numpy())[:-1]) if len(table.number) else []
    rows = zip(
        table.number.tolist(),
        table.known.tolist(),
        table.velocity.numpy(),
        table.extent.numpy(),
        table.color.numpy(),
        table.start.numpy(),
        table.moved.tolist(),
        table.rest.numpy(),
        table.inputs.numpy(),
        table.outputs.numpy(),
        table.shades.numpy(),
        table.looked.numpy(),
        table.patch.numpy(),
        table.unlike.numpy(),
        table.sure.tolist(),
        table.narrow.tolist(),
        table.since.tolist(),
        paths,
        strict=True,
    )
    return [Figure(*row) for row in rows]


def table_of(figures: Sequence[Figure]) -> FigureTable:
    """Tracks as tensors."""

    def stacked(parts: list[Numbers], width: int) -> Tensor:
        return torch.from_numpy(np.stack(parts)) if parts else torch.zeros(0, width, dtype=torch.float64)

    paths, patches = [one.path for one in figures], [one.patch for one in figures]
    return FigureTable(
        torch.tensor([one.number for one in figures], dtype=torch.int64),
        torch.tensor([one.known for one in figures], dtype=torch.bool),
        stacked([one.velocity for one in figures], 2),
        stacked([one.extent for one in figures], 2),
        stacked([one.color for one in figures], 3),
        stacked([one.start for one in figures], 2),
        torch.tensor([one.moved for one in figures], dtype=torch.float64),
        stacked([one.rest for one in figures], 2),
        stacked([one.inputs for one in figures], 10),
        stacked([one.outputs for one in figures], 10),
        stacked([one.shades for one in figures], 4),
        stacked([one.looked for one in figures], 4),
        torch.from_numpy(np.stack(patches)) if patches else torch.zeros(0, 3, PATCH, PATCH),
        stacked([one.unlike for one in figures], 2),
        torch.tensor([one.sure for one in figures], dtype=torch.float64),
        torch.tensor([one.narrow for one in figures], dtype=torch.float64),
        torch.tensor([one.since for one in figures], dtype=torch.float64),
        torch.tensor([len(path) for path in paths], dtype=torch.int64),
        torch.from_numpy(np.concatenate(paths)) if paths else torch.zeros(0, SIGHTING, dtype=torch.float64),
    )
