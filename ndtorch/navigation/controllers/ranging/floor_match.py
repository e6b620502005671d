"""Where both eyes see one floor: behind a line the floor goes on, behind the foot of a wall it does not.

Floor is seen `focal * baseline / depth` columns apart, fewer in every row that is farther up; a wall is seen as far
apart in all rows as its foot. So a cell of floor looks alike in both images along these lines, and a wall does not.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

from ndtorch.navigation.controllers.ranging.floor_view import EVERY, FloorParams, FloorView
from ndtorch.navigation.rig import StereoRig

ROWS = 2
"""Only every second row is compared."""


class MatchTables(NamedTuple):
    """What is compared with what, as numbers of pixels in the rectangles of `FloorView.rects`, every second column.

    Attributes:
        rows: that are compared, `[R]`.
        shift: pixels from a place of the left rectangle to that of the right one that sees the same floor, `[R]`.
        first: pixels from the left edge of both rectangles to that of their cells, `[2]`.
        wide: columns of a block.
        bands, tall: how many bands there are, and rows of each.
        alike, least: correlation from which on it is one floor, and the least mean square of the changes from pixel
            to pixel.
    """

    rows: Tensor
    shift: Tensor
    first: tuple[int, int]
    wide: int
    bands: int
    tall: int
    alike: float
    least: float


def match_tables(rig: StereoRig, params: FloorParams, view: FloorView) -> MatchTables:
    """The tables for a rig."""
    ours, theirs = view.rects
    rows = torch.arange(0, ours.bottom - ours.top, ROWS)
    down = (ours.top + rows.double() - rig.center[1]) / rig.focal
    # Depth along the axis of the floor in a row, as in `floor_view`.
    cos, sin = math.cos(rig.pitch), math.sin(rig.pitch)
    along = rig.camera_height / (sin + down * cos)
    apart = rig.focal * rig.baseline / along
    shift = ((ours.left - theirs.left - apart) / EVERY).round().long()
    cells = view.cells
    first = ((cells[0].left - ours.left) // EVERY, (cells[1].left - theirs.left) // EVERY)
    wide = (cells[0].right - cells[0].left) // EVERY // params.blocks
    tall = (cells[0].bottom - cells[0].top) // params.bands
    return MatchTables(rows, shift, first, wide, params.bands, tall, params.alike, params.texture**2)


def floor_match(pair: Tensor, tables: MatchTables) -> Tensor:
    """Whether each cell, with the one behind it, is one floor: 1; -1 where the other eye does not see it, else 0.

    The changes from pixel to pixel are compared, less their means: neither light nor the foot of a wall, which lies in
    one row of both images, makes rows alike.

    Args:
        pair: grey images `[..., 2, h, w]` of both rectangles, every second column.

    Returns:
        `[..., 2, bands, blocks]`, left image first, nearest band and outermost block first.
    """
    t = tables
    change = pair[..., t.rows, 1:] - pair[..., t.rows, :-1]
    columns, blocks = change.shape[-1], (pair.shape[-1] - t.first[1]) // t.wide
    found = []
    for eye in range(2):
        sign = 1 - 2 * eye
        start = t.first[eye] + t.wide * torch.arange(blocks)
        own = start[:, None] + torch.arange(t.wide - 1)
        other = own + sign * t.shift[:, None, None]
        seen = (other[..., 0] >= 0) & (other[..., -1] < columns)
        index = other.clamp(0, columns - 1).flatten(-2)
        ours = change[..., eye, :, :][..., own]
        theirs = change[..., 1 - eye, :, :].gather(-1, index.expand(*change.shape[:-3], *index.shape))
        theirs = theirs.unflatten(-1, (blocks, -1))  # type: ignore[no-untyped-call]
        ours, theirs = ours - ours.mean(-1, keepdim=True), theirs - theirs.mean(-1, keepdim=True)
        sums = torch.stack(((ours * theirs).sum(-1), ours.square().sum(-1), theirs.square().sum(-1)), -3) * seen
        band = (t.bands - 1 - t.rows // t.tall).clamp(min=0)
        total = sums.new_zeros(*sums.shape[:-2], t.bands, blocks).index_add(-2, band, sums)
        count = torch.zeros(t.bands, blocks, dtype=torch.long).index_add(0, band, seen.long())
        total[..., :-1, :] += total[..., 1:, :].clone()
        count[:-1] += count[1:].clone()
        product, square, other_square = total.unbind(-3)
        least = t.least * (t.wide - 1) * count
        alike = (product > t.alike * (square * other_square).sqrt()) & (torch.minimum(square, other_square) > least)
        verdict = torch.where(2 * ROWS * count < t.tall, -1.0, alike.to(pair.dtype))
        found.append(verdict.flip(-1) if eye else verdict)
    return torch.stack(found, -3)
