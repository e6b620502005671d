"""The names users import: none disappears unnoticed, and each says what it is."""

from __future__ import annotations

import inspect
from types import ModuleType

import pytest

import ndtorch
import ndtorch.binding
import ndtorch.navigation
import ndtorch.scenes
import ndtorch.vision

MODULES = [ndtorch, ndtorch.vision, ndtorch.scenes, ndtorch.binding, ndtorch.navigation]
NAMES = [(module, name) for module in MODULES for name in module.__all__]


@pytest.mark.parametrize(("module", "name"), NAMES)
def test_every_public_name_is_documented(module: ModuleType, name: str) -> None:
    thing = getattr(module, name)
    if inspect.isclass(thing) or inspect.isfunction(thing):
        text = thing.__doc__ or ""
        # What dataclasses and named tuples make up for themselves does not count.
        assert text
        assert not text.startswith(f"{thing.__name__}(")
        assert "Alias for field" not in text
