"""Motion primitives: arcs, and the places that the outline of the car passes along them."""

from __future__ import annotations

import math

import numpy as np

from ndtorch.errors import InputError
from ndtorch.navigation.body import Body
from ndtorch.navigation.local_grid._kernels import Primitives


def motion_primitives(
    arcs: list[tuple[float, int]],
    body: Body,
    margin: float,
    longest: float,
    step: float = 0.08,
    lag: float = 0.0,
) -> Primitives:
    """Outlines along arcs of (curvature, +1 forward or -1 backward).

    The bumper on the leading side and both flanks are followed; places are at most a step apart, so that no
    cell of that size is missed.

    Args:
        margin: kept free around the body, m.
        longest: of the arcs, m.
        lag: the car goes on straight for this long before its wheels have turned, m.
    """
    if not (longest >= step > 0 and lag >= 0):
        raise InputError(f"expected longest >= step > 0 and lag >= 0, got {longest}, {step} and {lag}")
    steps = round(longest / step)
    wide, ahead = body.width_m / 2 + margin, body.length_m / 2 + margin
    across = np.linspace(-wide, wide, math.ceil(2 * wide / step - 1e-9) + 1)
    flank = np.linspace(-ahead, ahead, math.ceil(2 * ahead / (2 * step)) + 1)[:-1]
    px = np.concatenate((np.full_like(across, ahead), flank, flank))
    py = np.concatenate((across, np.full_like(flank, wide), np.full_like(flank, -wide)))
    s = step * np.arange(1, steps + 1)
    xs, ys = [], []
    for curvature, direction in arcs:
        # Driving backward along an arc mirrors the path that driving forward along it takes.
        bent = (s - lag).clip(min=0.0)
        turned = curvature * bent
        chord = bent * np.sinc(turned / 2 / math.pi)
        x, y = s - bent + chord * np.cos(turned / 2), chord * np.sin(turned / 2)
        cos, sin = np.cos(turned)[:, None], np.sin(turned)[:, None]
        xs.append(direction * (x[:, None] + cos * px - sin * py))
        ys.append(y[:, None] + sin * px + cos * py)
    kind = np.float32
    return Primitives(
        np.array([k for k, _ in arcs], kind),
        np.array([d for _, d in arcs], kind),
        np.stack(xs).ravel().astype(kind),
        np.stack(ys).ravel().astype(kind),
        len(across),
        steps,
        step,
    )
