"""The published controller as the kernel of a whole step has it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from torch import Tensor

from ndtorch.kernels.published_step import published_step
from ndtorch.navigation.controllers.contract import CRUISE, STOPPED
from ndtorch.navigation.controllers.quick import QuickControl


class QuickSaccades(QuickControl):
    """Three numbers are the state of the machine.

    Args:
        shape: of the state of the fields' filters; a: share of their high-pass.
        constants: of the machine.
        state: makes its state of the numbers.
    """

    kernel, count = published_step, 3

    def __init__(
        self, shape: tuple[int, int, int], a: float, constants: tuple[float, ...], state: Callable[..., Any]
    ) -> None:
        self.shape, self.cells, self.a, self.numbers, self.state = shape, (1, 1, 1), a, constants[:9], state

    def take(self, state: Any) -> tuple[Sequence[Tensor], Sequence[Tensor]]:
        """All of it."""
        return (), state

    def give(self, arrays: Sequence[Tensor], numbers: Sequence[Tensor]) -> Any:
        """All of it."""
        return self.state(*numbers)

    def mode(self, numbers: Any) -> int:
        """Only a car that has stopped needs a look of its own."""
        return STOPPED if numbers[6] == -math.inf else CRUISE
