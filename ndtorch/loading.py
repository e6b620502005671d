"""Models by name, and of one's own by path."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from torch import Tensor

from ndtorch.arguments import set_backend
from ndtorch.binding.first_stage import first_stage_weights, read_first_stage
from ndtorch.binding.models.base import BindingModel
from ndtorch.binding.models.foreground import ForegroundModel
from ndtorch.binding.models.retinotopic import RetinotopicModel
from ndtorch.binding.models.whole_field import PublishedModel, ScaleFreeModel
from ndtorch.config import option_places, with_options, with_tensors
from ndtorch.errors import LONGEST, InputError, did_you_mean
from ndtorch.utils.packages import folder_of
from ndtorch.utils.toml import check, suggestion, toml_values

KINDS: dict[str, type[BindingModel]] = {
    kind.name: kind for kind in (PublishedModel, ScaleFreeModel, RetinotopicModel, ForegroundModel)
}
"""Kinds of models. Put a kind of your own in to load folders whose config.toml names it."""


def model_names() -> list[str]:
    """Names of the models that come with the package.

    >>> model_names()
    ['foreground', 'published', 'retinotopic', 'scale-free']
    """
    return sorted(config.parent.name for config in folder_of("ndtorch", "models").glob("*/config.toml"))


def load(
    model: str | Path,
    *,
    size: int | tuple[int, int] | None = None,
    fps: float | None = None,
    border: str | None = None,
    backend: str = "auto",
    **options: Any,
) -> BindingModel:
    """A model that comes with the package, or one of your own: `load("published", fps=30, border="reflect")`.

    Args:
        model: one of `model_names()`, or the path of a folder (see `BindingModel.save`).
        size: height and width of the frames, pixels; a single number means a square.
        fps: frames a second.
        border: "wrap" where the scene is a torus, "reflect" for video.
        backend: "numba" computes by compiled kernels, "torch" by tensor operations (gradients, GPU, export), "auto" by
            kernels wherever they can do the work.
        options: other values for keys of its config.toml, `first_stage`, a trained `FirstStage` or `[10, 10]`, and for
            `published` a `rule`: the name of one, or a `LearningRule`. A `torch.nn.Parameter` is learned; the model's
            `learnable` lists the keys that may be one.

    Raises:
        InputError: unknown name, missing or broken folder, or an option that the model does not have.

    >>> model = load('scale-free', size=(100, 100), fps=50)
    >>> signals, state = model(torch.zeros(2, 3, 100, 100))
    >>> signals.outputs.shape
    torch.Size([2, 10])
    """
    given = {"size": size, "fps": fps, "border": border}
    rest = options | {name: value for name, value in given.items() if value is not None}
    folder = model_folder(model)
    kind, stage = KINDS[model_kind(folder)], rest.pop("first_stage", None)
    known = option_places(kind.config_type)
    rule = rest.pop("rule") if "rule" in known and not isinstance(rest.get("rule", ""), str) else None
    for option in [*["first_stage"] * (stage is not None and not kind.trained), *rest]:
        if option not in known:
            others = [k.name for k in KINDS.values() if option in option_places(k.config_type)]
            others = [k.name for k in KINDS.values() if k.trained] if option == "first_stage" else others
            if not others:
                raise InputError(f"options: unknown key {option!r}; {suggestion(option, known)}")
            raise InputError(
                f"{kind.name} has no option {option}; {', '.join(others)} ha{'ve' if others[1:] else 's'} it"
            )
    where = folder / "config.toml"
    config = check(toml_values(where) | {"model": kind.name}, kind.config_type, str(where))
    if kind.trained:
        stage = read_first_stage(folder / "weights.safetensors") if stage is None else first_stage_weights(stage)
    tensors = {name: value for name, value in rest.items() if isinstance(value, Tensor)}
    for name in tensors:
        if name.split(".")[-1] not in kind.learnable:
            known_ones = ", ".join(kind.learnable) or "nothing"
            raise InputError(f"{name} of {kind.name} must be a number; what it learns: {known_ones}")
    config = with_options(config, rest | {name: value.tolist() for name, value in tensors.items()})
    made = kind.build(with_tensors(config, tensors), stage)
    made.use_parameters(config, tensors)
    if rule is not None:
        made.use_rule(rule)
    set_backend(made, backend)
    return made


def model_kind(model: str | Path) -> str:
    """The kind of a model as its config.toml names it, one of `KINDS`."""
    where = model_folder(model) / "config.toml"
    name = toml_values(where).get("model")
    if name not in KINDS:
        given = "no key 'model'" if name is None else f"model = {name!r}"
        raise InputError(f"{where}: {given}; model must be one of {', '.join(KINDS)}")
    return str(name)


def model_folder(model: str | Path) -> Path:
    """Where a model is described."""
    if not isinstance(model, str | Path):
        raise InputError(f"model must be a name or a path, got {type(model).__name__}")
    names = model_names()
    if str(model) in names:
        return folder_of("ndtorch", "models") / model
    if os.path.isdir(model):  # noqa: PTH112 - of a name that no path can have, `Path` raises
        return Path(model)
    if isinstance(model, Path) or "/" in model:
        raise InputError(f"{model} is not a model folder")
    raise InputError(
        f"model must be a folder or one of {', '.join(names)}; got {model[:LONGEST]!r}{did_you_mean(model, names)}"
    )
