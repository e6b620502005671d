"""The published controller as the kernel of a whole step has it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from torch import Tensor

from ndtorch.navigation.controllers.quick import QuickControl


class QuickSaccades(QuickControl):
    """Three numbers are the state of the machine.

    Args:
        shape: of the state of the fields' filters; a: share of their high-pass.
        constants: of the machine.
        state: makes its state of the numbers.
    """

    kernel = "published_step"

    def __init__(
        self, shape: tuple[int, int, int], a: float, constants: tuple[float, ...], state: Callable[..., Any]
    ) -> None:
        self.shape, self.a, self.constants, self.state = shape, a, constants, state

    def take(self, state: Any) -> tuple[Sequence[Tensor], Sequence[Tensor]]:
        """All of it."""
        return (), state

    def give(self, arrays: Sequence[Tensor], numbers: Sequence[Tensor]) -> Any:
        """All of it."""
        return self.state(*numbers)

    def arguments(self, kind: Any, before: Sequence[Any], after: Sequence[Any]) -> tuple[Any, ...]:
        """The numbers of the state machine."""
        return (self.constants,)
