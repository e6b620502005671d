"""How certain a ranged feature is of its place: the product of two Gaussian beams."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ndtorch.navigation.stereo.ranging import Ranges
from ndtorch.navigation.stereo.rig import StereoRig

REACH = 3.0
"""Space constant R_b in metres. [A] gives none; in simulation 2-4 m map best, 1 m works and 0.5 m fails."""


def beam(x: Tensor, y: Tensor, angle: Tensor, spread: float, reach: float = REACH) -> Tensor:
    """The Gaussian certainty beam of one camera at the origin, in 0..1. [A eq. A.6-A.12]

    `exp(-r cos(d) / R_b) exp(-tan(d)^2 / (2 tan(spread)^2))` with d the angle off the beam's axis. Behind the
    camera, `r cos(d) <= 0`, it is zero: as printed, a second beam would grow there.

    Args:
        x, y: points relative to the camera, m.
        angle: direction of the beam, radians. All three broadcast.
        spread: standard deviation, radians: the angle of one pixel, `StereoRig.pixel_angle`.
        reach: R_b, m.
    """
    along = x * angle.cos() + y * angle.sin()
    across = y * angle.cos() - x * angle.sin()
    ahead = along > 0
    along = torch.where(ahead, along, torch.ones_like(along))
    off_axis = across / (along * math.tan(spread))
    return torch.exp(-along / reach - off_axis.square() / 2) * ahead


def certainty(x: Tensor, y: Tensor, ranges: Ranges, rig: StereoRig, reach: float = REACH) -> Tensor:
    """Certainty that the feature is at a point of the body frame: the product of both beams. [A eq. A.13]

    Args:
        x, y: points in the body frame, m, which broadcast against the angles of `ranges`.
    """
    half = rig.baseline / 2
    left = beam(x - rig.forward, y - half, ranges.left_angle, rig.pixel_angle, reach)
    right = beam(x - rig.forward, y + half, ranges.right_angle, rig.pixel_angle, reach)
    valid: Tensor = ranges.valid
    return left * right * valid


SEARCH_SPREAD_PX = 0.2
"""Standard deviation of the beams of a search. In textured arenas 68 % of its disparities are within .15 to .4 pixels
of the true ones."""

SIGMAS = 3  # standard deviations to either side of an axis over which a table of beams reaches
BEYOND_SIGHT = 100.0  # metres at which rays that do not meet are cut off


def beam_table(rig: StereoRig, farthest: float, spacing: float, spread_px: float = 1.0) -> tuple[Tensor, Tensor]:
    """A table of places for `sample_certainty`: tangents `[2, S]` of their angles off the left and the right axis, and
    weights `[S]`, the product of both Gaussians times the step of both tangents, over the baseline.

    A product of beams is a few millimetres wide and decimetres long, so a grid of cells would miss it. Here
    the places are laid along and across it: `spacing` metres apart along, at the range `farthest` and less
    nearer by, and half a standard deviation across, which is one or two millimetres. `spread_px` is the standard
    deviation of a beam.
    """
    sigma = math.tan(rig.pixel_angle) * spread_px
    # Off the axes by s sigma / sqrt(2) each, the rays meet farthest^2 sqrt(2) sigma s / baseline nearer by.
    step = min(0.5, spacing * rig.baseline / (farthest**2 * math.sqrt(2) * sigma))
    half = math.ceil(SIGMAS / step)
    along = torch.arange(-half, half + 1, dtype=torch.float64) * step
    across = torch.arange(-2 * SIGMAS, 2 * SIGMAS + 1, dtype=torch.float64) / 2
    s, c = (grid.flatten() for grid in torch.meshgrid(along, across, indexing="ij"))
    weight = torch.exp(-(s.square() + c.square()) / 2) * (step / 2 * sigma**2 / rig.baseline)
    tangent = torch.stack((c - s, c + s)) * (sigma / math.sqrt(2))
    return tangent.to(torch.get_default_dtype()), weight.to(torch.get_default_dtype())


def sample_certainty(
    ranges: Ranges, rig: StereoRig, tangent: Tensor, weight: Tensor, reach: float = REACH
) -> tuple[Tensor, Tensor, Tensor]:
    """Places within each feature's beams and the certainty gathered there.

    Tangents and weights are of `beam_table`. Summing the weights of the places in an area gives the integral of
    `certainty` over that area.

    Returns:
        x, y in the body frame, m, and weight, m^2, each `[..., n, S]`. Slots that are not valid weigh 0.
    """
    tan = torch.stack((ranges.left_angle, ranges.right_angle)).unsqueeze(-1).tan()
    off = tangent.view(2, *[1] * ranges.x.ndim, -1)
    slope = (tan + off) / (1 - tan * off)
    left, right = slope.unbind()
    # Rays that hardly meet do so beyond sight; the limit keeps the numbers finite where they do not at all.
    x = rig.baseline / (right - left).clamp(min=rig.baseline / BEYOND_SIGHT)
    # Within 3 pixels of the axis r cos(d) is r to 2e-5, and r is x times the root of this.
    stretch = slope.square() + 1
    falloff = torch.exp(stretch.sqrt().sum(0) * x * (-1 / reach))
    # Area that a step of both tangents covers where the rays meet: x^3 / b times the change of both slopes.
    area = x * x * x * stretch.prod(0)
    weight = falloff * area * (weight * ranges.valid.unsqueeze(-1).to(x.dtype))
    return x + rig.forward, left * x + rig.baseline / 2, weight
