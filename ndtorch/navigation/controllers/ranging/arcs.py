"""How far the body of the car can go along arcs before any part of it meets what is in the patch."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from ndtorch.arguments import check_numbers
from ndtorch.errors import InputError


@dataclass(frozen=True)
class Body:
    """Outline of the car, a rectangle about the point it turns about.

    Args:
        length, width: half of them, m.
        room: kept free ahead and beside, m.
    """

    length: float = 0.25
    width: float = 0.18
    room: float = 0.07

    def __post_init__(self) -> None:
        check_numbers(self)
        if not (self.length > 0 and self.width > 0 and self.room >= 0):
            raise InputError(f"expected length and width > 0 and room >= 0, got {self}")


class ArcTable(NamedTuple):
    """Places the outline passes along arcs.

    Attributes:
        curvature: of the arcs, 1/m, `[A]`.
        forward: +1 or -1, `[A]`.
        x, y: body frame, `[A * S * P]`: P places of the outline at S distances along each arc.
        leading: how many of the P are on the bumper that leads; they come first.
        step: distance between two of the S, m.
        steps: S.
    """

    curvature: Tensor
    forward: Tensor
    x: Tensor
    y: Tensor
    leading: int
    step: float
    steps: int


def arc_table(
    arcs: list[tuple[float, int]], body: Body, longest: float, step: float = 0.08, lag: float = 0.0
) -> ArcTable:
    """Outlines along arcs of (curvature, +1 forward or -1 backward).

    The bumper on the leading side and both flanks are followed; places are at most a step apart, so that no
    cell of that size is missed.

    Args:
        lag: the car goes on straight for this long before its wheels have turned, m.
    """
    if not (longest >= step > 0 and lag >= 0):
        raise InputError(f"expected longest >= step > 0 and lag >= 0, got {longest}, {step} and {lag}")
    steps = round(longest / step)
    wide, ahead = body.width + body.room, body.length + body.room
    across = torch.linspace(-wide, wide, math.ceil(2 * wide / step - 1e-9) + 1, dtype=torch.float64)
    flank = torch.linspace(-ahead, ahead, math.ceil(2 * ahead / (2 * step)) + 1, dtype=torch.float64)[:-1]
    px = torch.cat((torch.full_like(across, ahead), flank, flank))
    py = torch.cat((across, torch.full_like(flank, wide), torch.full_like(flank, -wide)))
    s = step * torch.arange(1, steps + 1, dtype=torch.float64)
    xs, ys = [], []
    for curvature, direction in arcs:
        # Driving backward along an arc mirrors the way that driving forward along it takes.
        bent = (s - lag).clamp(min=0.0)
        turned = curvature * bent
        chord = bent * torch.sinc(turned / 2 / math.pi)
        x = s - bent + chord * torch.cos(turned / 2)
        y = chord * torch.sin(turned / 2)
        cos, sin = turned.cos()[:, None], turned.sin()[:, None]
        ax, ay = x[:, None] + cos * px - sin * py, y[:, None] + sin * px + cos * py
        xs.append(direction * ax)
        ys.append(ay)
    dtype = torch.get_default_dtype()
    return ArcTable(
        torch.tensor([k for k, _ in arcs], dtype=dtype),
        torch.tensor([float(d) for _, d in arcs], dtype=dtype),
        torch.stack(xs).flatten().to(dtype),
        torch.stack(ys).flatten().to(dtype),
        len(across),
        step,
        steps,
    )


def free_travel(evidence: Tensor, table: ArcTable, limits: Tensor) -> Tensor:
    """How far the car can go along each arc, `[..., 2, A]` m in whole steps.

    First, before any place of its outline holds `limits[0]` or more: there something is in the way. Second,
    before a place of the bumper that leads holds `limits[1]` or more: what is there was not seen free.

    Args:
        evidence: at the places of the table, `[..., A * S * P]`.
        limits: `[2]`.
    """
    places = evidence.view(*evidence.shape[:-1], len(table.curvature), table.steps, -1)
    worst = torch.stack((places.amax(-1), places[..., : table.leading].amax(-1)), -3)
    below = worst < limits.view(2, 1, 1)
    free: Tensor = below.cumprod(-1).sum(-1) * table.step
    return free
