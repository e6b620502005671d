"""A model's constants: tables checked with pydantic, options by name, written as TOML; errors name the key."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Annotated, Any, TypeVar

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationInfo, field_validator

from ndtorch.arguments import MOST_PIXELS
from ndtorch.errors import InputError
from ndtorch.utils.toml import Strict, check, suggestion


def limited(size: tuple[int, int]) -> tuple[int, int]:
    """A size, as it is; raises `ValueError` where there is nothing, or more than can be computed with."""
    if min(size) < 1 or math.prod(size) > MOST_PIXELS:
        raise ValueError(f"a height and a width of 1 or more, {MOST_PIXELS} pixels in all at most")
    return size


Size = Annotated[
    tuple[int, int],
    BeforeValidator(lambda size: (size, size) if type(size) is int else size),
    AfterValidator(limited),
]
"""Height and width in pixels; a single number means a square."""
Positive = Annotated[float, Field(gt=0)]
"""One of a tuple of numbers above 0."""
Deviations = tuple[Positive, Positive]
"""Of a filter, along and across, pixels."""
MOST_WHOLE = 10_000
"""The largest whole number: of parts, rounds or pixels of a side. Times are limited where they become memory."""


def constant(default: Any, description: str, **limits: Any) -> Any:
    """A key of a table: its default, one sentence that says what it is, with its unit, and its limits."""
    return Field(default, description=description, **limits)


class Constants(Strict):
    """One table of a config.toml. Seconds where nothing else is said.

    Numbers are finite; only a time constant, `tau_...`, may be infinite: it forgets nothing.

    Raises:
        InputError: an unknown key, or a value out of range, in one line that names it.
    """

    model_config = ConfigDict(allow_inf_nan=True)

    @field_validator("*")
    @classmethod
    def check_number(cls, value: Any, info: ValidationInfo) -> Any:
        """Refuse NaN, and infinity where it means nothing."""
        for part in value if isinstance(value, tuple) else (value,):
            if isinstance(part, float) and not math.isfinite(part):
                if not (part == math.inf and str(info.field_name).startswith("tau_")):
                    raise ValueError("should be a finite number")
            elif isinstance(part, int) and abs(part) > MOST_WHOLE:
                raise ValueError(f"should be at most {MOST_WHOLE}")
        return value


class ModelConfig(Constants):
    """What every model's config.toml says; each kind adds a table for every choice that it makes."""

    model: str = Field(description="Kind of the model.")
    size: Size = constant((500, 500), "Height and width of the frames, pixels.")
    fps: float = constant(100.0, "Frames a second.", gt=0, le=100_000)


Kind = TypeVar("Kind", bound=ModelConfig)


def option_places(kind: type[BaseModel]) -> dict[str, list[tuple[str, ...]]]:
    """Every option of a kind of model, by its own name and by `table.name`, and where it stands in the config."""
    places: dict[str, list[tuple[str, ...]]] = {}
    for name, field in kind.model_fields.items():
        inner = field.annotation
        if isinstance(inner, type) and issubclass(inner, BaseModel):
            for leaf in inner.model_fields:
                places.setdefault(leaf, []).append((name, leaf))
                places[f"{name}.{leaf}"] = [(name, leaf)]
        elif name != "model":
            places.setdefault(name, []).append((name,))
    return places


def with_options(config: Kind, options: Mapping[str, Any]) -> Kind:
    """The config with other values for some keys, given by their names: `gamma=1.0`, `{"network.tau_in": 2.0}`."""
    places = option_places(type(config))
    data = config.model_dump()
    for name, value in options.items():
        where = places.get(name, [])
        if not where:
            raise InputError(f"options: unknown key {name!r}; {suggestion(name, places)}")
        if len(where) > 1:
            several = " and ".join(".".join(one) for one in where)
            raise InputError(f"options: {name} is a key of {several}; say which")
        into = data
        for part in where[0][:-1]:
            into = into[part]
        into[where[0][-1]] = value
    return check(data, type(config), "options")


def with_tensors(config: Kind, tensors: Mapping[str, Any]) -> Kind:
    """The config with tensors, unchecked, for some keys of its tables: what modules are made with that learn them."""
    for name, value in tensors.items():
        table, key = option_places(type(config))[name][0]
        part = getattr(config, table).model_copy(update={key: value})
        config = config.model_copy(update={table: part})
    return config


def config_text(config: ModelConfig, head: str = "") -> str:
    """The config as TOML, every key with its meaning."""
    lines = [f"# {line}" for line in head.splitlines()]
    tables: list[str] = []
    for name, field in type(config).model_fields.items():
        value = getattr(config, name)
        if isinstance(value, BaseModel):
            about = f"  # {field.description}" if field.description else ""
            tables += ["", f"[{name}]{about}"]
            tables += [entry(key, getattr(value, key), f.description) for key, f in type(value).model_fields.items()]
        else:
            lines.append(entry(name, value, field.description))
    return "\n".join(lines + tables) + "\n"


def entry(key: str, value: Any, about: str | None) -> str:
    """One line of TOML."""
    text = repr(value) if isinstance(value, float) else json.dumps(value, ensure_ascii=False)
    return f"{key} = {text}" + (f"  # {about}" if about else "")
