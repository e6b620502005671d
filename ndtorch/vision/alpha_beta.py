"""The alpha-beta filter: follow a place by its own velocity, and correct both by what is seen."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
import numpy.typing as npt
from torch import Tensor

Places = TypeVar("Places", Tensor, npt.NDArray[np.float64])


def predicted(place: Places, velocity: Places, dt: float) -> Places:
    """Where a thing is `dt` seconds later, `[..., 2]`."""
    return place + velocity * dt


def corrected(
    place: Places, velocity: Places, residual: Places, alpha: float | Tensor, beta: float | Tensor, dt: float
) -> tuple[Places, Places]:
    """Place and velocity `[..., 2]` after the share `alpha` of the residual, and `beta` of it over `dt`.

    Args:
        place: predicted.
        residual: observed place less the predicted one; zero where nothing was seen.
        alpha, beta: shares, 0..1; numbers, or tensors that broadcast.
        dt: seconds over which the residual came about.
    """
    return place + alpha * residual, velocity + beta * residual / dt
