"""How the car moved between two looks, as the rows tell it.

What was ranged in one look is searched for in both rows of the next one. Where it is now tells how far the car has
driven and turned: visual odometry [Nistér, Naroditsky & Bergen 2004], of points in one plane. It knows nothing of the
wheels, so that it also tells where they slip.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ndtorch.kernels.row_motion import row_motion
from ndtorch.navigation.localisation.params import MotionParams
from ndtorch.navigation.localisation.walls import Floats, Scan
from ndtorch.navigation.rig import StereoRig


class Look(NamedTuple):
    """Gray rows `[2, W]`, and the points ranged in them, m, `[n, 2]`."""

    rows: Tensor
    points: Tensor


class Motion(NamedTuple):
    """Way and turn, m and radians, `[2]`, and their covariance `[2, 2]`."""

    mean: Floats
    doubt: Floats


def motion_seen(
    before: Look, rows: Tensor, guess: tuple[float, float], rig: StereoRig, params: MotionParams
) -> Motion | None:
    """Way along an arc and turn since a look; None where too little of it is found again, or fits badly.

    Args:
        rows: both gray rows now, `[2, W]`.
        guess: way and turn expected, m and radians.
    """
    p, out = params, np.zeros(8)
    if len(before.points) * 2 < p.least or before.rows.shape != rows.shape:
        return None
    x, y = np.ascontiguousarray(before.points.numpy().T)
    row_motion(
        before.rows.numpy(),
        plain(rows).numpy(),
        x,
        y,
        guess,
        (rig.baseline, rig.focal, rig.center[0], rig.forward),
        (p.half, p.reach, p.max_difference, p.ratio),
        (p.pixel, p.disparity, p.gate, p.steps),
        out,
    )
    if out[5] < max(p.least, p.agree * out[7]) or out[6] > p.worst:
        return None
    information = out[[2, 3, 3, 4]].reshape(2, 2) + 1e-3 * np.eye(2)
    return Motion(out[:2].copy(), np.linalg.inv(information) + np.diag((p.floor**2, p.turn_floor**2)))


def look_of(rows: Tensor, scan: Scan) -> Look:
    """A look at gray rows `[2, W]` to be kept, with what was ranged in it."""
    return Look(plain(rows), torch.from_numpy(np.stack((scan.x, scan.y), -1)))


def plain(rows: Tensor) -> Tensor:
    """Rows as the kernel takes them."""
    return rows.detach().cpu().float().contiguous()
