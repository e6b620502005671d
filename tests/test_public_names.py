"""The names users import: none disappears unnoticed, and each says what it is."""

from __future__ import annotations

import ast
import importlib.metadata
import inspect
from pathlib import Path
from types import ModuleType

import pytest

import ndtorch
import ndtorch.binding
import ndtorch.navigation
import ndtorch.scenes
import ndtorch.vision

MODULES = [ndtorch, ndtorch.vision, ndtorch.scenes, ndtorch.binding, ndtorch.navigation]
NAMES = [(module, name) for module in MODULES for name in module.__all__]


@pytest.mark.parametrize("module", MODULES)
def test_public_names_are_listed(module: ModuleType) -> None:
    assert set(module.__all__) <= set(dir(module))


@pytest.mark.parametrize(("module", "name"), NAMES)
def test_every_public_name_is_documented(module: ModuleType, name: str) -> None:
    thing = getattr(module, name)
    if inspect.isclass(thing) or inspect.isfunction(thing):
        text = thing.__doc__ or ""
        # What dataclasses and named tuples make up for themselves does not count.
        assert text
        assert not text.startswith(f"{thing.__name__}(")
        assert "Alias for field" not in text
    else:
        assert name in constants(module)


def constants(module: ModuleType) -> set[str]:
    """Names assigned at the top of any file of a package."""
    found = set()
    for path in Path(str(module.__file__)).parent.rglob("*.py"):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.Assign | ast.AnnAssign):
                targets = node.targets if isinstance(node, ast.Assign) else [node.target]
                found |= {part.id for target in targets for part in ast.walk(target) if isinstance(part, ast.Name)}
    return found


@pytest.mark.parametrize("module", MODULES[1:])
def test_everything_public_comes_from_its_own_package(module: ModuleType) -> None:
    for name in module.__all__:
        home = getattr(getattr(module, name), "__module__", None)
        if home is not None and home.startswith("ndtorch"):
            assert home.startswith(module.__name__), f"{name} comes from {home}"


def test_there_is_a_version() -> None:
    assert importlib.metadata.version("ndtorch") == ndtorch.__version__
