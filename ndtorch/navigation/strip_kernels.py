"""What navigation sees in one frame of each camera, by kernels: the numbers of `FloorMotion` and `RowRanging`."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from ndtorch.kernels.cell_maxima import cell_maxima
from ndtorch.kernels.light_gain import light_gain
from ndtorch.kernels.match_cells import match_cells
from ndtorch.kernels.row_ranges import row_ranges
from ndtorch.kernels.search_ranges import search_ranges
from ndtorch.kernels.switch import kernels_wanted
from ndtorch.navigation.rig import Rect
from ndtorch.vision.feature_kernels import KINDS, image_kind, pixels
from ndtorch.vision.temporal import FilterState

LightLimits = tuple[float, float, float]


class Eyes(NamedTuple):
    """One rectangle of each of two frames, as kernels take them.

    Attributes:
        frames: arrays `[C, H, W]`, or `[H, W, C]` where colors lie `beside` each other.
        tops, lefts: where the rectangles begin.
        unit, over: a grey value is a sum of colors times `unit`, divided by `over`.
    """

    frames: tuple[Any, Any]
    beside: bool
    tops: tuple[int, int]
    lefts: tuple[int, int]
    unit: float
    over: int


def eyes(left: Tensor, right: Tensor, rects: tuple[Rect, Rect], size: tuple[int, int]) -> Eyes | None:
    """The pixels for the kernels; None where torch is to do it: several frames at once, gradients, other types.

    Args:
        left, right: frames `[1, C, H, W]`, whole or cut to the rectangles.
        size: of whole frames.
    """
    if not all(isinstance(eye, Tensor) for eye in (left, right)):
        return None
    if left.ndim != 4 or len(left) != 1 or left.shape != right.shape or left.dtype != right.dtype:
        return None
    channels, given = left.shape[1], tuple(left.shape[2:])
    cut_size = (rects[0].bottom - rects[0].top, rects[0].right - rects[0].left)
    if channels not in (1, 3) or left.dtype not in KINDS or given not in (size, cut_size):
        return None
    if not kernels_wanted(left, right):
        return None
    (ours, beside), (theirs, also) = pixels(left[0]), pixels(right[0])
    if beside != also:
        return None
    whole = given == size
    tops, lefts = ((rects[0].top, rects[1].top), (rects[0].left, rects[1].left)) if whole else ((0, 0), (0, 0))
    unit, count = (1 / (255 * channels), 1) if left.dtype == torch.uint8 else (1.0, channels)
    return Eyes((ours, theirs), beside, tops, lefts, unit, count)


def state_fits(state: FilterState | None, frames: Tensor, shape: tuple[int, ...]) -> bool:
    """Whether the state of the filters is one that the kernels can go on from."""
    return state is None or (
        state.low.dtype == image_kind(frames) and state.low.shape == shape and state.low.device.type == "cpu"
    )


def largest_of_cells(
    seen: Eyes,
    state: FilterState | None,
    like: Tensor,
    shape: tuple[int, int, int],
    every: int,
    a: float,
    cells: Any,
    *,
    lit: LightLimits | None = None,
) -> FilterState:
    """The largest |ND-min| of every cell into `cells` `[2, bands, blocks]`, and the state `[2, h, w]` after.

    Args:
        lit: limits of `light_gain`; without them the light is taken to be steady.
    """
    low = torch.empty(shape, dtype=image_kind(like))
    after = low.numpy()
    before = after if state is None else state.low.contiguous().numpy()
    gain = 1.0
    if lit is not None and state is not None:
        bands, blocks = cells.shape[1:]
        pixels = (seen.frames, seen.beside, seen.tops, seen.lefts, every, seen.unit, seen.over)
        gain = light_gain(*pixels, before, bands, blocks, lit)
    cell_maxima(
        seen.frames,
        seen.beside,
        seen.tops,
        seen.lefts,
        every,
        seen.unit,
        seen.over,
        state is None,
        before,
        gain,
        a,
        after,
        cells,
    )
    return FilterState(low)


def matched_cells(seen: Eyes, like: Tensor, width: int, every: int, tables: tuple[Any, ...]) -> Tensor:
    """What both eyes see in every cell, `[2, bands, blocks]`, see `floor_match`."""
    rows, _, first, wide, tall = tables[:5]
    bands, blocks = (int(rows[-1]) + tall) // tall, (width - first[1]) // wide
    found = torch.empty(2, bands, blocks, dtype=image_kind(like))
    match_cells(
        seen.frames, seen.beside, seen.tops, seen.lefts, every, seen.unit, seen.over, width, *tables, found.numpy()
    )
    return found


def ranges_of_rows(
    seen: Eyes,
    state: FilterState | None,
    like: Tensor,
    width: int,
    a: float,
    finding: tuple[int, int, float, float, int, int, tuple[int, int, int]],
    matching: tuple[float, float, bool, float],
    rig: tuple[float, float, float, float, bool],
) -> tuple[Tensor, Tensor, float, FilterState]:
    """Ranges `[5, 1, n]`, which are valid `[1, n]`, the largest motion, and the state `[2, 1, W]` after."""
    low = torch.empty((2, 1, width), dtype=image_kind(like))
    after = low.numpy()[:, 0]
    before = after if state is None else state.low.contiguous().numpy()[:, 0]
    out, valid = np.empty((5, finding[0]), after.dtype), np.empty(finding[0], np.bool_)
    largest = row_ranges(
        seen.frames,
        seen.beside,
        seen.tops[0],
        seen.unit,
        seen.over,
        state is None,
        before,
        a,
        after,
        finding,
        matching,
        rig,
        out,
        valid,
    )
    return torch.from_numpy(out).unsqueeze(1), torch.from_numpy(valid).unsqueeze(0), largest, FilterState(low)


def searched_ranges(
    seen: Eyes,
    like: Tensor,
    width: int,
    around: int,
    count: int,
    params: tuple[int, int, int, int, float, float, float, float, int, int],
    band: tuple[int, int],
    rig: tuple[float, float, float, float, bool],
) -> tuple[Tensor, Tensor, float, FilterState]:
    """Ranges `[5, 1, n]` by searching, which are valid `[1, n]`, the largest pixel, and horizon rows `[2, 1, W]`."""
    horizon = torch.empty((2, 1, width), dtype=image_kind(like))
    rows = horizon.numpy()[:, 0]
    out, valid = np.empty((5, count), rows.dtype), np.empty(count, np.bool_)
    largest = search_ranges(
        seen.frames, seen.beside, seen.tops[0], seen.unit, seen.over, around, params, band, rig, rows, out, valid
    )
    return torch.from_numpy(out).unsqueeze(1), torch.from_numpy(valid).unsqueeze(0), largest, FilterState(horizon)
