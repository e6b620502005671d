"""Trained models by name."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ndtorch.binding.models.published import VisualBinding
from ndtorch.errors import InputError

HERE = Path(__file__).resolve().parent
# In an installed package the models lie inside it, in a checkout beside it.
PLACES = (HERE / "models", HERE.parent / "models")


def model_folders() -> dict[str, Path]:
    """Folder of every model that comes with the package, by name."""
    found: dict[str, Path] = {}
    for place in PLACES:
        for config in sorted(place.glob("*/config.toml")):
            found.setdefault(config.parent.name, config.parent)
    return found


def model_names() -> list[str]:
    """Names of the models that come with the package."""
    return list(model_folders())


def load(name: str, **options: Any) -> VisualBinding:
    """A trained model that comes with the package, such as `load("binding", fps=30, border="reflect")`.

    Args:
        name: one of `model_names()`.
        options: as `VisualBinding.load` takes them.

    Raises:
        InputError: unknown name or option.
    """
    folders = model_folders()
    if name not in folders:
        raise InputError(f"model must be one of {', '.join(folders) or '(none found)'}; got {name!r}")
    return VisualBinding.load(folders[name], **options)
