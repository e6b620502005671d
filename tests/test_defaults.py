"""Defaults, limits and constants are those of `tests/defaults.txt`: none changes without somebody seeing it.

After a change that is meant: `python -m tests.test_defaults` writes the table anew, and its difference is part of the
change. A number that is wrong by a little fails no other test, for drives and runs end much the same.
"""

from __future__ import annotations

import dataclasses
import enum
import importlib
import inspect
import math
import pkgutil
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest
from pydantic import BaseModel, ValidationError

from ndtorch.errors import InputError

TABLE = Path(__file__).with_name("defaults.txt")

PLACES = (
    "ndtorch.binding",
    "ndtorch.vision",
    "ndtorch.navigation",
    "ndtorch_robot.link",
    "ndtorch_robot.recording",
    "ndtorch_robot.safety",
    "ndtorch_robot.watching.sight",
)
"""Packages and modules; what `make mutants` changes."""

TRIED = (-math.inf, -2.0, -1.0, -1e-9, 0.0, 1e-9, 0.5, 1 - 1e-9, 1.0, 1 + 1e-9, 2.0, 3.0, 1e9, math.inf, math.nan)
"""Numbers that every field of a class of numbers is given."""


def modules() -> Iterator[ModuleType]:
    """All of them, those below packages too."""
    for place in PLACES:
        module = importlib.import_module(place)
        yield module
        for found in pkgutil.walk_packages(getattr(module, "__path__", ()), place + "."):
            yield importlib.import_module(found.name)


def shown(value: object) -> str | None:
    """A value in one line that is the same everywhere; None for what is no plain value."""
    if value is None or isinstance(value, bool | int | str | bytes):
        return repr(value.value if isinstance(value, enum.Enum) else value)
    if isinstance(value, float):
        return f"{value:.12g}"
    if isinstance(value, tuple | list | set | frozenset):
        parts = [shown(each) for each in (sorted(value, key=repr) if isinstance(value, set | frozenset) else value)]
        return None if None in parts else f"({', '.join(map(str, parts))})"
    if isinstance(value, dict):
        parts = [(shown(key), shown(each)) for key, each in value.items()]
        return None if any(None in part for part in parts) else f"{{{', '.join(f'{k}: {v}' for k, v in parts)}}}"
    return None


def of_function(name: str, function: object) -> Iterator[tuple[str, str]]:
    """What its parameters are when nobody says."""
    try:
        parameters = inspect.signature(function).parameters.values()  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return
    for each in parameters:
        if each.default is not inspect.Parameter.empty and (text := shown(each.default)) is not None:
            yield f"{name}({each.name})", text


def taken(name: str, kind: type) -> Iterator[tuple[str, str]]:
    """Which numbers each field takes, the others as they are."""
    try:
        usual = kind()
    except Exception:  # it cannot be made without knowing more
        return
    for field, value in vars(usual).items():
        if isinstance(value, bool) or not isinstance(value, int | float):
            continue
        good = []
        for number in (int(each) if isinstance(value, int) and math.isfinite(each) else each for each in TRIED):
            try:
                kind(**{field: number})
            except (InputError, ValidationError):
                continue
            except TypeError:
                return  # no parameter
            good.append(f"{number:.12g}")
        yield f"{name}.{field}", "takes " + " ".join(dict.fromkeys(good))


def of_class(name: str, kind: type) -> Iterator[tuple[str, str]]:
    """Fields, their limits, constants, members, and whether it can be changed."""
    if issubclass(kind, BaseModel):
        for field, info in kind.model_fields.items():
            limits = " ".join(
                sorted(repr(each) for each in info.metadata if type(each).__module__ == "annotated_types")
            )
            if info.default_factory is None and (text := shown(info.default)) is not None:
                yield f"{name}.{field}", f"{text} {limits}".strip()
            elif limits:
                yield f"{name}.{field}", limits
        yield from taken(name, kind)
        return
    if dataclasses.is_dataclass(kind):
        frozen = kind.__dataclass_params__.frozen  # type: ignore[attr-defined]
        yield name, "frozen" if frozen else "not frozen"
        yield from taken(name, kind)
    for field, value in vars(kind).items():
        function = getattr(value, "__func__", value)
        if inspect.isfunction(function) and function.__module__ == kind.__module__:
            yield from of_function(f"{name}.{field}", function)
        elif isinstance(value, enum.Enum):
            yield f"{name}.{field}", str(shown(value.value))
        elif (not field.startswith("_") or field == "_field_defaults") and (text := shown(value)) is not None:
            yield f"{name}.{field}", text


def lines() -> list[str]:
    """`NAME = VALUE`, one for each default, limit and constant, by module."""
    found = []
    for module in modules():
        for name, value in vars(module).items():
            full = f"{module.__name__}.{name}"
            if inspect.isclass(value):
                entries = of_class(full, value) if value.__module__ == module.__name__ else iter(())
            elif inspect.isfunction(value):
                entries = of_function(full, value) if value.__module__ == module.__name__ else iter(())
            elif name.lstrip("_").isupper() and (text := shown(value)) is not None:
                entries = iter([(full, text)])
            else:
                continue
            found += [f"{entry} = {text}" for entry, text in entries]
    return list(dict.fromkeys(found))


def test_defaults_limits_and_constants_are_those_of_the_table() -> None:
    pytest.importorskip("numba")
    pytest.importorskip("serial")
    there, wanted = lines(), TABLE.read_text(encoding="utf-8").splitlines()
    assert len(wanted) > 1000
    gone, new = [line for line in wanted if line not in there], [line for line in there if line not in wanted]
    assert not gone + new, f"{gone[:5]} became {new[:5]}; where that is meant: python -m tests.test_defaults"


if __name__ == "__main__":
    from tests import test_defaults  # by its name, as the tests have it

    TABLE.write_text("\n".join(test_defaults.lines()) + "\n", encoding="utf-8")
