"""A large grid of cells in tiles; an update copies only the tiles that it changes."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from ndtorch.arguments import check_kind, check_tensor
from ndtorch.errors import InputError
from ndtorch.navigation.mapping._kernels import tile_sums, touched_tiles
from ndtorch.utils.backend import kernels_wanted

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


def check_tiles(name: str, tiles: Tiles, batch: tuple[int, ...], rows: int, columns: int) -> None:
    """Raise `InputError` unless tiles belong to a grid of this batch and size; only the first tile is checked."""
    check_kind(name, tiles, Tiles)
    check_tensor(name, tiles.rows[0][0], half=False, finite=False)
    found = (*tiles.rows[0][0].shape[:-2], len(tiles.rows), len(tiles.rows[0]))
    wanted = (*batch, -(-rows // SIDE), -(-columns // SIDE))
    if found != wanted:
        raise InputError(
            f"{name} [..., rows, columns] of {found} do not fit batch {batch} and a grid that needs {wanted}"
        )


def cell_table(count: int, inner: int, outer: int) -> Tensor:
    """What a row or a column adds to the index of a cell, `[count]`; indices count tile after tile.

    Args:
        inner: difference of the indices of neighbours in a tile.
        outer: the same between tiles.
    """
    at = torch.arange(count)
    return (at >> BITS) * outer + (at & SIDE - 1) * inner


def cell_tables(rows: int, columns: int) -> tuple[Tensor, Tensor]:
    """Tables of rows and columns: the index of a cell is the sum of both."""
    across = -(-columns // SIDE)
    return cell_table(rows, SIDE, across * SIDE * SIDE), cell_table(columns, 1, SIDE * SIDE)


def add_at(tiles: Tiles, number: Tensor, weight: Tensor, limit: float | None = None) -> Tiles:
    """Add weights `[..., k]` to cells of these indices, see `cell_tables`; cells are then clamped to plus and minus
    `limit`."""
    across, batch = len(tiles.rows[0]), number.shape[:-1]
    if not batch and weight.dtype == tiles.rows[0][0].dtype and kernels_wanted(number, weight, tiles.rows[0][0]):
        return add_by_kernel(tiles, number.numpy(), weight.numpy(), limit)
    tile = (number >> 2 * BITS).flatten()
    touched = tile.new_zeros(len(tiles.rows) * across).index_fill_(0, tile, 1)
    numbers = touched.nonzero().flatten().tolist()
    sums = torch.stack([tiles.rows[n // across][n % across] for n in numbers])  # the copy
    count = batch.numel()
    # Those in `sums` begin here, `[tiles, *batch, SIDE, SIDE]` in the order of memory.
    begin = (touched.cumsum(0) - 1) * count - torch.arange(len(touched), device=tile.device) << 2 * BITS
    place = begin.index_select(0, tile).view(number.shape) + number
    if count > 1:
        place = place + (torch.arange(count, device=tile.device).view(*batch, 1) << 2 * BITS)
    sums.view(-1).index_add_(0, place.flatten(), weight.flatten())
    if limit is not None:
        sums.clamp_(-limit, limit)
    return replaced(tiles, numbers, sums)


def add_by_kernel(
    tiles: Tiles, number: npt.NDArray[np.int64], weight: npt.NDArray[Any], limit: float | None = None
) -> Tiles:
    """`add_at` of one grid, arrays `[k]`."""
    across = len(tiles.rows[0])
    slots = np.full(len(tiles.rows) * across, -1)
    touched = np.empty_like(slots)
    numbers = touched[: touched_tiles(number, SIDE * SIDE, slots, touched)].tolist()
    if not numbers:
        return tiles
    sums = torch.stack([tiles.rows[n // across][n % across] for n in numbers])
    tile_sums(number, weight, slots, sums.flatten(1).numpy())
    if limit is not None:
        sums.clamp_(-limit, limit)
    return replaced(tiles, numbers, sums)


def replaced(tiles: Tiles, numbers: list[int], sums: Tensor) -> Tiles:
    """Tiles with k of them replaced by `[k, ..., SIDE, SIDE]`."""
    across = len(tiles.rows[0])
    changed: dict[int, list[Tensor]] = {}
    for n, new in zip(numbers, sums.unbind(0), strict=True):
        parts = changed.setdefault(n // across, list(tiles.rows[n // across]))
        parts[n % across] = new.clone()  # a view would keep all of `sums`
    return Tiles(tuple(tuple(changed[n]) if n in changed else row for n, row in enumerate(tiles.rows)))
