"""A large grid of cells in tiles; an update copies only the tiles that it changes."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

BITS = 6
SIDE = 1 << BITS
"""Cells along the side of a tile: a step of a map touches a dozen tiles of 16 KB, where the grid has megabytes."""


class Tiles(NamedTuple):
    """A grid of cells, row after row of tiles `[..., SIDE, SIDE]`.

    Tiles are never changed: an update replaces those it touches and shares the rest with the grid before. Empty tiles
    are one and the same tensor.
    """

    rows: tuple[tuple[Tensor, ...], ...]

    @property
    def cells(self) -> Tensor:
        """All cells as one tensor `[..., rows * SIDE, columns * SIDE]`, put together anew."""
        return torch.cat([torch.cat(row, -1) for row in self.rows], -2)


def empty_tiles(batch: tuple[int, ...], rows: int, columns: int, like: Tensor) -> Tiles:
    """Zeros for this many rows and columns of cells, rounded up to whole tiles."""
    blank = like.new_zeros(*batch, SIDE, SIDE)
    return Tiles(((blank,) * -(-columns // SIDE),) * -(-rows // SIDE))


def add_at(tiles: Tiles, row: Tensor, column: Tensor, weight: Tensor, limit: float | None = None) -> Tiles:
    """Add weights `[..., k]` to cells of these rows and columns; changed tiles are then clamped to plus and minus
    `limit`."""
    across, batch, last = len(tiles.rows[0]), row.shape[:-1], SIDE - 1
    touched, slot = torch.unique((row >> BITS) * across + (column >> BITS), return_inverse=True)
    numbers = touched.tolist()
    if not numbers:
        return tiles
    sums = torch.stack([tiles.rows[n // across][n % across] for n in numbers])  # the copy, [m, ..., SIDE, SIDE]
    car = torch.arange(batch.numel(), device=row.device).view(*batch, 1)
    cell = (slot * batch.numel() + car << 2 * BITS) + ((row & last) << BITS) + (column & last)
    sums.view(-1).index_add_(0, cell.flatten(), weight.flatten())
    if limit is not None:
        sums.clamp_(-limit, limit)
    rows = [list(tiles_of_row) for tiles_of_row in tiles.rows]
    for n, new in zip(numbers, sums.unbind(0), strict=True):
        rows[n // across][n % across] = new.clone()  # a view would keep all of `sums`
    return Tiles(tuple(map(tuple, rows)))
