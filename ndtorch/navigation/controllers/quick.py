"""What the kernel of a whole step has to know of the controller that it steps."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

from torch import Tensor


class QuickControl(ABC):
    """A controller as the kernel of a whole step has it: its state is single numbers and arrays.

    Attributes:
        kernel: its name.
        shape: of the state of the fields' filters, `(2, h, w)`.
        a: share of their high-pass.
        sizes: how many numbers each array of its state has.
    """

    kernel: str
    shape: tuple[int, int, int]
    a: float
    sizes: tuple[int, ...] = ()

    @abstractmethod
    def take(self, state: Any) -> tuple[Sequence[Tensor], Sequence[Tensor]]:
        """The arrays and the single numbers of a state of the controller."""

    @abstractmethod
    def give(self, arrays: Sequence[Tensor], numbers: Sequence[Tensor]) -> Any:
        """The state that has these, which are flat."""

    @abstractmethod
    def arguments(self, kind: Any, before: Sequence[Any], after: Sequence[Any]) -> tuple[Any, ...]:
        """The kernel's last arguments, which depend on the controller.

        Args:
            kind: precision, a NumPy dtype.
            before, after: the arrays of its state.
        """
