"""Signals of a camera's fields by kernels: the numbers of the steps in torch, in two passes around the transform."""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor

from ndtorch.kernels.hue_fields import hue_fields
from ndtorch.kernels.scale_motion import scale_motion
from ndtorch.kernels.switch import kernels_wanted
from ndtorch.vision.camera.params import CameraParams
from ndtorch.vision.camera.scales import ScaleState
from ndtorch.vision.motion import MotionState
from ndtorch.vision.orientation import OrientedDoG

Weights = list[tuple[Tensor, Tensor]]
"""Of the fields' rows and columns, on every level of the pyramid."""


def quick_signals(
    images: tuple[Tensor, Tensor, Tensor, Tensor],
    scales: ScaleState,
    filters: tuple[float, float, float],
    weights: Weights,
    orientation: OrientedDoG,
    params: CameraParams,
) -> tuple[tuple[Tensor, Tensor, Tensor, Tensor, Tensor], ScaleState] | None:
    """`scale_step`, `hues_and_shades` and what `CameraFrontEnd` makes of them; None where torch is to do it.

    Args:
        images: frame, its background and what differs, `[3, h, w]`, and by how much something stands out `[1, h, w]`.
        scales: state of the pyramid.
        filters: time step and smoothing factors of the detectors.
        weights: see there.
        orientation: filters, with mirrored edges.
        params: constants.

    Returns:
        signals `[R, C, 10]`, motion `[R, C, 2]`, presence `[R, C]`, level, shades `[R, C, 4]`; the state.
    """
    given = (*images, *scales.fine, *scales.middle, *scales.coarse, scales.last)
    fits = params.background and orientation.exact and orientation.border == "reflect"
    if not fits or any(part.dtype != torch.float32 for part in given) or not kernels_wanted(*given):
        return None
    from ndtorch.kernels.hue_fields import HueNumbers
    from ndtorch.kernels.scale_motion import ScaleNumbers

    frame, ground, seen, shown = (part.contiguous().numpy() for part in images)
    levels = (scales.fine, scales.middle, scales.coarse)
    after = fine, middle, small = empty_like(scales.fine), empty_like(scales.middle), empty_like(scales.coarse)
    rows, columns = (tuple(part.numpy() for part in parts) for parts in zip(*weights, strict=True))
    coarse, size = torch.empty_like(scales.last), torch.empty(orientation.padded)
    shape = (len(rows[0]), len(columns[0]))
    motion = torch.empty(2, *shape)
    dt, a_high, a_low = filters
    numbers = ScaleNumbers(
        dt,
        a_high,
        a_low,
        params.tau_low,
        math.exp(-dt / params.tau_shift),
        params.best_shift,
        -1 if params.scale == "auto" else params.scale,
    )
    level, change, slope = scale_motion(
        seen,
        arrays(levels),
        scales.last.contiguous().numpy(),
        float(scales.change),
        float(scales.slope),
        numbers,
        rows,
        columns,
        orientation.margin,
        arrays(after),
        coarse.numpy(),
        size.numpy(),
        motion.numpy(),
    )
    responses = orientation.responses(size).numpy()
    signals, shades, presence = torch.empty(*shape, 10), torch.empty(*shape, 4), torch.empty(shape)
    p = params
    hues = HueNumbers(p.color_inhibition, p.compression, p.palest, p.pale, p.shade, p.dimmest_white, *p.white, *p.black)
    hue_fields(
        frame,
        ground,
        shown[0],
        responses,
        orientation.margin,
        motion.numpy(),
        hues,
        rows[0],
        columns[0],
        signals.numpy(),
        shades.numpy(),
        presence.numpy(),
    )
    state = ScaleState(fine, middle, small, coarse, scales.change.new_tensor(change), scales.slope.new_tensor(slope))
    return (signals, motion.movedim(0, -1), presence, torch.tensor(level), shades), state


def empty_like(state: MotionState) -> MotionState:
    """Memory for the state after another."""
    return MotionState(torch.empty_like(state.slow), torch.empty_like(state.delayed))


def arrays(levels: Any) -> tuple[tuple[Any, Any], ...]:
    """States of the detectors as plain pairs of arrays."""
    return tuple((slow.contiguous().numpy(), delayed.contiguous().numpy()) for slow, delayed in levels)
