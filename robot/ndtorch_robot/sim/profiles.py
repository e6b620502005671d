"""Brightness along walls, and where it jumps: what there is to see of a building at one height."""

from __future__ import annotations

import numpy as np

from ndtorch_robot.sim.paint import ALONG, Painted
from ndtorch_robot.sim.plan import Floats


def profile(surface: Painted, height: float) -> Floats:
    """Brightness along a surface at one height, 0..1."""
    rows = len(surface.texels)
    share = (height - surface.bottom) / (surface.height - surface.bottom)
    row = min(max(rows - 1 - int(share * rows), 0), rows - 1)
    return np.asarray(surface.texels[row].mean(-1) / 255.0)


def edge_columns(profile_: Floats, contrast: float, within: float = 0.02) -> Floats:
    """Where along a surface its brightness jumps, as metres from its start.

    A jump changes the brightness by `contrast` or more within `within` metres, and more than its surroundings.
    """
    step = max(1, round(within * ALONG / 2))
    if len(profile_) <= 2 * step + 1:
        return np.zeros(0)
    change = np.abs(profile_[2 * step :] - profile_[: -2 * step])
    found = []
    while len(change) and change.max() >= contrast:
        at = int(change.argmax())
        found.append((at + step + 0.5) / ALONG)
        change[max(0, at - 3 * step) : at + 3 * step + 1] = 0
    return np.sort(np.array(found))
