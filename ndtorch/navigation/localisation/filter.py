"""How well the pose and the odometer are known: an extended Kalman filter of six numbers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from ndtorch.navigation.localisation.params import LocaliserParams

Floats = npt.NDArray[Any]


def predicted(
    doubt: Floats,
    way: float,
    turned: float,
    unsure: Floats,
    seconds: float,
    heading: float,
    params: LocaliserParams,
    known: bool = False,
) -> Floats:
    """The covariance `[6, 6]` of x, y, heading, scale, bend and drift after driving on.

    Args:
        way, turned: driven, m, and radians.
        unsure: variances of both, `[2]`.
        seconds: of driving.
        heading: after it.
        known: seen motion has told the errors of the odometer.
    """
    p, middle = params, heading - turned / 2
    left = p.left if known else 1.0
    cos, sin = way * math.cos(middle), way * math.sin(middle)
    step = np.eye(6)
    step[0, 2], step[1, 2] = -sin, cos
    step[0, 3], step[1, 3] = -cos, -sin
    step[2, 4], step[2, 5] = -turned, -seconds
    step[:2, 4:] = step[:2, 2:3] * step[2, 4:] / 2
    noise = np.zeros(6)
    noise[:2] = p.still**2 + unsure[0]
    noise[2] = p.turn_still**2 + unsure[1]
    if seconds:
        noise[3:] = np.square((left * p.scale_walk, left * p.bend_walk, left * p.drift_walk))
    doubt = step @ doubt @ step.T + np.diag(noise)
    if known:
        most = left * np.array((p.scale, p.bend, p.drift))
        limit = np.ones(6)
        limit[3:] = np.minimum(1.0, most / np.sqrt(doubt.diagonal()[3:]).clip(1e-12))
        doubt = doubt * limit * limit[:, None]
    return doubt


def updated(doubt: Floats, off: Floats, information: Floats, params: LocaliserParams) -> tuple[Floats, Floats]:
    """What a fit changes in the six numbers, `[6]`, and their covariance after it.

    Args:
        off: how far the fit is from the pose expected, `[3]`.
        information: of the fit, see `Fit`.
    """
    p = params
    said = information[[0, 1, 3, 1, 2, 4, 3, 4, 5]].reshape(3, 3) * p.trust + 1e-3 * np.eye(3)
    error = np.linalg.inv(said) + np.diag((p.floor**2, p.floor**2, p.turn_floor**2))
    both = doubt[:3, :3] + error
    surprise = float(off @ np.linalg.solve(both, off))
    if surprise > p.surprise:  # the wheels have slipped
        doubt = doubt.copy()
        doubt[:3, :3] *= surprise / p.surprise
        both = doubt[:3, :3] + error
    gain = np.linalg.solve(both, doubt[:3]).T
    doubt = doubt - gain @ doubt[:3]
    return gain @ off, (doubt + doubt.T) / 2
