"""Kinds of binding models by name, and the model that a folder describes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ndtorch.binding.first_stage import FirstStage, first_stage_weights, read_first_stage
from ndtorch.binding.models.base import BindingModel
from ndtorch.binding.models.foreground import ForegroundModel
from ndtorch.binding.models.published import PublishedModel
from ndtorch.binding.models.retinotopic import RetinotopicModel
from ndtorch.binding.models.scale_free import ScaleFreeModel
from ndtorch.config import option_places, validated, with_options
from ndtorch.errors import InputError
from ndtorch.utils.toml import suggestion, toml_values

KINDS: dict[str, type[BindingModel]] = {
    kind.name: kind for kind in (PublishedModel, ScaleFreeModel, RetinotopicModel, ForegroundModel)
}
"""Put a kind of your own in to load folders whose config.toml names it."""


def load_folder(path: str | Path, options: Mapping[str, Any]) -> BindingModel:
    """The model that a folder describes, with other values for some of its constants.

    Args:
        path: a folder with config.toml and, of a kind with a first stage, weights.safetensors.
        options: keys of its config, `first_stage`, and `rule` as an object of models that have the key.

    Raises:
        InputError: folder or file missing, unknown kind, weights missing or of the wrong shape, an option that the
            model does not have: then which models do.
    """
    folder = Path(path)
    where, name = folder / "config.toml", kind_of(folder)
    data, kind, rest = toml_values(where), KINDS[name], dict(options)
    stage: Any = rest.pop("first_stage", None)
    if stage is not None and not kind.trained:
        raise InputError(f"{name} has no option first_stage; {having('first_stage')} have it")
    known = option_places(kind.config_type)
    rule = rest.pop("rule") if "rule" in known and not isinstance(rest.get("rule", ""), str) else None
    for option in rest:
        if option not in known:
            raise InputError(unknown(option, name, list(known)))
    config = with_options(validated(kind.config_type, data | {"model": name}, str(where)), rest)
    if kind.trained:
        stage = read_first_stage(folder / "weights.safetensors") if stage is None else first_stage_weights(stage)
    model = kind.build(config, stage)
    if rule is not None:
        model.use_rule(rule)
    return model


def kind_of(folder: Path) -> str:
    """The kind that the config.toml of a folder names, one of `KINDS`."""
    if not folder.is_dir():
        raise InputError(f"{folder} is not a model folder")
    where = folder / "config.toml"
    name = toml_values(where).get("model")
    if name not in KINDS:
        given = "no key 'model'" if name is None else f"model = {name!r}"
        raise InputError(f"{where}: {given}; model must be one of {', '.join(KINDS)}")
    return str(name)


def having(option: str) -> str:
    """Names of the kinds that have an option."""
    if option == "first_stage":
        return ", ".join(kind.name for kind in KINDS.values() if kind.trained)
    return ", ".join(kind.name for kind in KINDS.values() if option in option_places(kind.config_type))


def unknown(option: str, name: str, known: list[str]) -> str:
    """The error of an option that a kind does not have."""
    others = having(option)
    if others:
        return f"{name} has no option {option}; {others} {'has' if ',' not in others else 'have'} it"
    return f"options: unknown key {option!r}; {suggestion(option, known)}"


__all__ = ["KINDS", "BindingModel", "FirstStage", "load_folder"]
