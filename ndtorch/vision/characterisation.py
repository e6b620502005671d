"""How a speed sensor answers images that move at known speeds: the measurement behind [A fig. 3]."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import torch
from torch import Tensor, nn

from ndtorch.arguments import check_tensor
from ndtorch.errors import InputError


def speed_response(sensor: nn.Module, chunks: Iterable[Tensor], settle: int = 0) -> Tensor:
    """Mean over time of a sensor's speed estimate, `max over space of |output|`. [A Methods]

    Args:
        sensor: a module called as `output, state = sensor(frames, state)`, whose outputs are images
            `[..., T, C, H, W]`, such as `NDMin`.
        chunks: frames `[..., T, C, H, W]` in order, as from `FrameSource.chunks`.
        settle: number of first frames that are shown and not counted; [A] gives filters 5 time constants.

    Returns:
        `[..., C]`.

    Raises:
        InputError: when no frame is left to count.
    """
    total, counted, seen, state = None, 0, 0, None
    for frames in chunks:
        output, state = sensor(frames, state)
        estimate = output.flatten(-2).abs().amax(-1)
        skip = min(max(settle - seen, 0), estimate.shape[-2])
        seen += estimate.shape[-2]
        counted += estimate.shape[-2] - skip
        part = estimate[..., skip:, :].sum(-2)
        total = part if total is None else total + part
    if total is None or counted == 0:
        raise InputError(f"settle={settle} leaves none of the {seen} frames to measure")
    mean: Tensor = total / counted
    return mean


class SpeedCurve(NamedTuple):
    """What [A Methods] looks for in a curve of responses against speed, each `[...]`.

    Attributes:
        monotonic_to: the highest speed up to which every faster image gave a larger response; 0 if none did.
        linearity: mean slope of the curve up to there over its slope at the lowest speed: 1 for a straight
            line, smaller the more it saturates, 0 where the sensor does not answer.
    """

    monotonic_to: Tensor
    linearity: Tensor


def judge_speed_curve(speeds: Tensor, responses: Tensor, noise: float = 1e-6) -> SpeedCurve:
    """Measures for choosing time constants: range of monotonic increase first, then absence of saturation.

    Args:
        speeds: `[S]`, increasing from above 0.
        responses: `[..., S]`.
        noise: an increase must be larger than this to count.

    Raises:
        InputError: shapes or types that do not fit, NaN or infinity, or speeds that do not increase from above 0.
    """
    check_tensor("speeds", speeds)
    check_tensor("responses", responses)
    if speeds.ndim != 1 or len(speeds) == 0 or responses.shape[-1:] != speeds.shape:
        raise InputError(
            f"expected speeds [S] and responses [..., S], got {tuple(speeds.shape)} and {tuple(responses.shape)}"
        )
    if not bool((torch.cat([speeds.new_zeros(1), speeds]).diff() > 0).all()):
        raise InputError("speeds must increase from above 0")
    origin = torch.zeros_like(responses[..., :1])
    curve = torch.cat([origin, responses], -1)
    steps = (curve.diff(dim=-1) > noise).cumprod(-1).sum(-1)  # rises before the first one that fails
    reached = torch.cat([speeds.new_zeros(1), speeds])[steps]
    top = curve.gather(-1, steps.unsqueeze(-1)).squeeze(-1)
    answers = steps > 0
    straight = torch.where(answers, responses[..., 0] / speeds[0] * reached, torch.ones_like(top))
    return SpeedCurve(reached, torch.where(answers, top / straight, torch.zeros_like(top)))
