"""What every binding model can do: take frames, say what it found and what that is worth, save itself."""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any, ClassVar, Literal, Protocol

from torch import Tensor, nn

from ndtorch.binding.objects import BoundObject, ObjectTable
from ndtorch.errors import InputError

Verdict = Literal["stable", "learning", "alternating", "static"]
"""What the objects are worth. `static`: nothing fluctuates, or nothing moved, so there is nothing to bind.
`alternating`: the outputs flip sign from step to step, a fault of delayed feedback at high learning rates.
`learning`: what was learned still changes. `stable`: none of these."""

Nested = Any
"""Of one trial the thing itself, of a batch lists of it, nested as the batch is."""


class Signals(Protocol):
    """What the forward of every model gives at least, a NamedTuple.

    Attributes:
        outputs: of the network, one row a time step, `[..., T', 10]`; of models with fields `[..., T', R, C, 10]`.
        time: seconds since the first frame, `[T']` float64.
    """

    @property
    def outputs(self) -> Tensor: ...
    @property
    def time(self) -> Tensor: ...


class BindingModel(nn.Module, ABC):
    """Frames -> signals -> objects. A model is five choices, and its config has a table for each that it makes:
    receptive fields, what a camera needs before, normalisation, network, read-out and tracking.

    Called as `signals, state = model(frames, state)` with frames `[..., T, C, H, W]`; `state=None` starts settled on
    the first frame. Chunks of any length give the same result. Everything that changes is in the state.

    Attributes:
        name: of the kind, as in config.toml.
        tracks: whether its objects have places and times.
        config: all constants.
        size: height and width of the frames, pixels.
        fps: frames a second.
        dt: seconds between the rows of its signals.
        settle: seconds before it learns.
    """

    name: ClassVar[str]
    tracks: ClassVar[bool] = False
    config: Any
    size: tuple[int, int]
    fps: float
    dt: float
    settle: float

    @abstractmethod
    def objects(self, state: Any) -> Nested:
        """The objects at this moment, `list[BoundObject]`; of a batch nested lists, one a trial."""

    @abstractmethod
    def verdict(self, state: Any) -> Nested:
        """What they are worth, a `Verdict`; of a batch a list."""

    @abstractmethod
    def weights(self, state: Any) -> Tensor:
        """The learned weights, `[..., 10, 10]`."""

    def table(self, state: Any) -> ObjectTable:
        """The table of owners, of models whose neurons own objects.

        Raises:
            InputError: this model's objects are tracks, not neurons.
        """
        raise InputError(f"the objects of {self.name} are tracks and have no table of owners; use objects(state)")

    @abstractmethod
    def save(self, path: str | Path) -> None:
        """Write a folder (config.toml, weights.safetensors, README.md) that `ndtorch.load` gives back equal."""


def by_trial(things: list[Any], batch: tuple[int, ...]) -> Nested:
    """A flat list as lists nested like the batch; the only thing itself without one."""
    if not batch:
        return things[0]
    step = max(1, len(things) // batch[0]) if batch[0] else 1
    return [by_trial(things[n * step : (n + 1) * step], batch[1:]) for n in range(batch[0])]


__all__ = ["BindingModel", "BoundObject", "Nested", "ObjectTable", "Signals", "Verdict", "by_trial"]
