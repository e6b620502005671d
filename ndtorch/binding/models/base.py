"""What every binding model can do: take frames, say what it found and what that is worth, save itself."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, Literal, Self

import torch
from torch import Tensor

from ndtorch.arguments import Backend, FullPrecision, as_path
from ndtorch.binding.objects import BoundObject, ObjectTable
from ndtorch.binding.rules import Rule
from ndtorch.config import ModelConfig, config_text, with_options
from ndtorch.errors import InputError
from ndtorch.utils.files import write_text

Verdict = Literal["stable", "learning", "alternating", "static"]
"""What the objects are worth. `static`: nothing fluctuates, or nothing moved, so there is nothing to bind.
`alternating`: the outputs flip sign from step to step, a fault of delayed feedback at high learning rates.
`learning`: what was learned still changes. `stable`: none of these. Of a model that gives a `confidence`, `stable` is a
number of objects that is right with the probability that its config calls `certain`, and `learning` is less."""

Nested = Any
"""Of one trial the thing itself, of a batch lists of it, nested as the batch is."""


class BindingModel(FullPrecision, ABC):
    """Frames -> signals -> objects. A model is five choices, and its config has a table for each that it makes:
    receptive fields, what a camera needs before, normalisation, network, read-out and tracking.

    Called as `signals, state = model(frames, state)` with frames `[..., T, C, H, W]`; `state=None` starts settled on
    the first frame. Chunks of any length give the same result. Everything that changes is in the state.

    Attributes:
        name: of the kind, as in config.toml.
        exportable: whether `torch.export` takes it.
        kernels_only: whether it has no implementation in torch.
        learnable: keys of its config that may be given as `torch.nn.Parameter`.
        config_type: what its config.toml holds.
        tracks: whether its objects have places and times.
        group: frames averaged into a step, of models whose objects have a row for every frame; 0 of others.
        trained: whether it has a trained first stage.
        config: all constants.
        dt: seconds between the rows of its signals.
        settle: seconds before it learns.
        backend: which implementation computes, see `ndtorch.load`.
    """

    backend: Backend = "auto"
    name: ClassVar[str]
    config_type: ClassVar[type[ModelConfig]]
    tracks: ClassVar[bool] = False
    group: int = 0
    trained: ClassVar[bool] = True
    exportable: ClassVar[bool] = True
    kernels_only: ClassVar[bool] = False
    learnable: ClassVar[tuple[str, ...]] = ()
    config: Any
    _learned: Mapping[str, str] = MappingProxyType({})
    dt: float
    settle: float

    def use_parameters(self, config: ModelConfig, given: dict[str, Tensor]) -> None:
        """Set the config to one of plain numbers, for a model built with tensors for some of its keys."""
        self.config = config
        own = dict(self.named_parameters())
        self._learned = {path: key for key, value in given.items() for path, own_one in own.items() if own_one is value}

    def learned_config(self) -> ModelConfig:
        """The config with the present values of what is learned."""
        values = {key: self.get_parameter(path).detach() for path, key in self._learned.items()}
        # Deviations are squared where they are used; other negative values count as 0.
        numbers: dict[str, Any] = {k: (v.abs() if v.ndim else v.clamp_min(0)).tolist() for k, v in values.items()}
        if any(v.ndim for v in values.values()):
            numbers["exact"] = True  # as they were learned
        config: ModelConfig = with_options(self.config, numbers)
        return config

    def check_own(self, state: Any) -> None:
        """Raise `InputError` unless a state is None or one of this kind of model."""

    @classmethod
    @abstractmethod
    def build(cls, config: Any, first_stage: Tensor | None) -> Self:
        """The model of that config, and of first-stage weights `[10, 10]` if it is `trained`."""

    def use_rule(self, rule: Rule) -> None:
        """Learn by a rule of your own.

        Raises:
            InputError: this model has its own.
        """
        raise InputError(f"{self.name} has a learning rule of its own")

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of the frames, pixels."""
        size: tuple[int, int] = self.config.size
        return size

    def extra_repr(self) -> str:
        return f"size={self.size}, fps={self.fps:g}, backend={self.backend!r}"

    @property
    def fps(self) -> float:
        """Frames a second."""
        return float(self.config.fps)

    @property
    def dtype(self) -> torch.dtype:
        """What it computes in, float32 or float64."""
        return next((part.dtype for part in self.buffers() if part.is_floating_point()), torch.float32)

    def objects(self, state: Any) -> list[BoundObject]:
        """The objects of one trial at this moment.

        Raises:
            InputError: the state is that of a batch.
        """
        found = self.objects_batch(state)
        if found and isinstance(found[0], list):
            raise InputError("the state is that of a batch: use objects_batch(state)")
        return list(found)

    @abstractmethod
    def objects_batch(self, state: Any) -> Nested:
        """The objects of every trial, lists nested like the batch; of a single trial as `objects`."""

    def visible_objects(self, state: Any) -> list[BoundObject]:
        """The objects of one trial that were seen at the latest time step.

        Raises:
            InputError: the state is that of a batch.
        """
        found = self.objects(state)
        last = max((one.last_seen or 0.0 for one in found), default=0.0)
        return [one for one in found if one.last_seen == last] if self.tracks else found

    def take_closed(self, state: Any) -> tuple[list[BoundObject], Any]:
        """The objects that are lost since they were last taken, and the state without them.

        The state of a model with tracks grows with all that was ever seen unless they are taken. An object that stays
        in sight for more than some thousand detections comes in parts with the same `track`, each with its own path.

        Returns:
            The objects in the order of their tracks, none of models whose objects do not end, and the state.

        Raises:
            InputError: the state is that of a batch.
        """
        self.check_own(state)
        return [], state

    @abstractmethod
    def verdict(self, state: Any) -> Nested:
        """What they are worth, a `Verdict`; of a batch a list."""

    def confidence(self, state: Any) -> Nested:
        """Probability that the number of objects is right, 0 to 1; of a batch lists. None of models that do not say."""
        self.check_own(state)
        return None

    @abstractmethod
    def weights(self, state: Any) -> Tensor:
        """The learned weights, `[..., 10, 10]`."""

    def table(self, state: Any) -> ObjectTable:
        """The table of owners, of models whose neurons own objects.

        Raises:
            InputError: this model's objects are tracks, not neurons.
        """
        raise InputError(f"the objects of {self.name} are tracks and have no table of owners; use objects(state)")

    def first_stage(self) -> Tensor | None:
        """Weights of the first stage, `[10, 10]`; None of a model without."""
        return None

    def save(self, path: str | Path, overwrite: bool = False) -> None:
        """Write a folder (config.toml, weights.safetensors, README.md) that `ndtorch.load` gives back equal.

        Args:
            path: of the folder.
            overwrite: replace a model that is there. A card that is there is kept.

        Raises:
            InputError: the folder holds a model, or cannot be written.
        """
        from ndtorch.binding.first_stage import write_first_stage

        folder, weights = as_path("path", path), self.first_stage()
        if not overwrite and (folder / "config.toml").exists():
            raise InputError(f"{folder} holds a model; say overwrite=True to replace it, or name another folder")
        try:
            folder.mkdir(parents=True, exist_ok=True)
            write_text(folder / "config.toml", config_text(self.learned_config()))
            card = folder / "README.md"
            if not card.exists():
                write_text(card, CARD.format(name=folder.name, model=self.name))
            if weights is not None:
                write_first_stage(weights, folder / "weights.safetensors")
            elif overwrite:
                (folder / "weights.safetensors").unlink(missing_ok=True)
        except OSError as error:
            raise InputError(f"{folder} cannot be written: {error.strerror}") from None


CARD = """# {name}

A binding model of the kind `{model}`, with the constants of its config.toml. Load it with `ndtorch.load` and the path
of this folder.

What it is for, how it was made and measured, where it fails: to be written by whoever made it.
"""


def by_trial(things: list[Any], batch: tuple[int, ...]) -> Nested:
    """A flat list as lists nested like the batch; the only thing itself without one."""
    if not batch:
        return things[0]
    step = len(things) // batch[0] if batch[0] else 0
    return [by_trial(things[n * step : (n + 1) * step], batch[1:]) for n in range(batch[0])]
