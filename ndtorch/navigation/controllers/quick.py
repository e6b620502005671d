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
        inward: pixels from the left edges of the fields to those of their cells.
        cells: how many columns of the fields make one that is looked at, and bands and blocks of cells.
        a: share of their high-pass.
        sizes: how many numbers each array of its state has.
        count: of the single numbers of its state.
        whole, numbers: what else the kernel has to know.
    """

    kernel: Any
    shape: tuple[int, int, int]
    cells: tuple[int, int, int]
    inward: tuple[int, int] = (0, 0)
    a: float
    count: int
    sizes: tuple[int, ...] = ()
    whole: tuple[int, ...] = ()
    numbers: tuple[float, ...] = ()

    @abstractmethod
    def take(self, state: Any) -> tuple[Sequence[Tensor], Sequence[Tensor]]:
        """The arrays and the single numbers of a state of the controller."""

    @abstractmethod
    def give(self, arrays: Sequence[Tensor], numbers: Sequence[Tensor]) -> Any:
        """The state that has these, which are flat."""

    @abstractmethod
    def mode(self, numbers: Any) -> int:
        """What a car is doing, of which these are speed, curvature, pose, and the single numbers of the state."""

    def arrays(self, kind: Any) -> tuple[Any, ...]:
        """The kernel's last arguments, which depend on the controller, of this precision, a NumPy dtype."""
        return ()
