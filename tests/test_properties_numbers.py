"""What holds numbers takes what is a number, and refuses the rest in one line."""

from __future__ import annotations

import dataclasses
import inspect
import math
from typing import Any

import pydantic
import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.utils.tensors import leaves, mapped
from tests.properties import PUBLIC, same_leaves

ODD = (
    0,
    1,
    -1,
    2,
    7,
    0.5,
    -0.5,
    1e-9,
    1e9,
    1e308,
    -1e308,
    math.nan,
    math.inf,
    -math.inf,
    10**400,
    True,
    None,
    "x",
    (1,),
)


def numbers_of(kind: type) -> dict[str, Any]:
    """The fields of a class of numbers, with their defaults."""
    if issubclass(kind, pydantic.BaseModel):
        return {name: part.get_default(call_default_factory=True) for name, part in kind.model_fields.items()}
    made = {part.name: part.default for part in dataclasses.fields(kind) if part.default is not dataclasses.MISSING}
    needed = [part for part in dataclasses.fields(kind) if part.default_factory is part.default is dataclasses.MISSING]
    return {} if needed else made


def is_numbers(thing: Any) -> bool:
    """Whether it is a class of numbers that all have defaults."""
    if not inspect.isclass(thing) or not (dataclasses.is_dataclass(thing) or issubclass(thing, pydantic.BaseModel)):
        return False
    return bool(numbers_of(thing))


CLASSES = {
    name: getattr(module, name) for module in PUBLIC for name in module.__all__ if is_numbers(getattr(module, name))
}


@pytest.mark.parametrize("name", CLASSES)
def test_numbers_are_taken_as_they_are_or_refused_in_one_line(name: str) -> None:
    bad = []
    kind = CLASSES[name]
    for part, value in ((part, value) for part in numbers_of(kind) for value in ODD):
        try:
            made = kind(**{part: value})
        except (InputError, pydantic.ValidationError) as error:
            if isinstance(error, InputError) and (part not in str(error) or "\n" in str(error)):
                bad.append(f"{part}={value!r}: the message is {error}")
            continue
        except Exception as error:
            bad.append(f"{part}={value!r}: {type(error).__name__}: {error}")
            continue
        wanted = numbers_of(kind)[part]
        taken = getattr(made, part)
        if isinstance(value, str | tuple) and not isinstance(wanted, type(value)) and taken == value:
            bad.append(f"{part}={value!r} is taken")
        if isinstance(wanted, float | int) and isinstance(value, float) and math.isnan(value):
            bad.append(f"{part}=nan is taken")
    assert not bad


TUPLES = {
    name: getattr(module, name)
    for module in PUBLIC
    for name in module.__all__
    if inspect.isclass(getattr(module, name)) and issubclass(getattr(module, name), tuple)
}


@pytest.mark.parametrize("name", TUPLES)
def test_tuples_are_walked_over_and_put_together_again(name: str) -> None:
    kind = TUPLES[name]
    tree = kind(*(torch.full((2,), float(n)) for n in range(len(kind._fields))))
    assert [float(part[0]) for part in leaves(tree).values()] == list(map(float, range(len(kind._fields))))
    same_leaves(mapped(tree, lambda _, part: part), tree)
