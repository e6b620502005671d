"""A square root that can be differentiated where it is zero."""

from __future__ import annotations

from torch import Tensor


def root(x: Tensor) -> Tensor:
    """Square root of what is positive, 0 elsewhere; there its gradient is 0, not infinite.

    What is zero because nothing is seen stays so whatever is changed a little, and an infinite slope times the zero
    slope of that would be no number.
    """
    positive = x > 0
    return x.where(positive, 1.0).sqrt().where(positive, 0.0)
