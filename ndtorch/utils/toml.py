"""From tables of files to checked values: pydantic models and plain dataclasses, with errors of one line that name file
and key."""

from __future__ import annotations

import dataclasses
import json
import re
import tomllib
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

from pydantic import BaseModel, ConfigDict, TypeAdapter, ValidationError, ValidationInfo, field_validator

from ndtorch.errors import InputError, did_you_mean
from ndtorch.utils.files import TEXT_BYTES, read_text


class Strict(BaseModel):
    """A table of a file: unknown keys are errors, and so are NaN, infinity, true and texts where a number is wanted.

    Docstrings below keys describe them.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, use_attribute_docstrings=True)

    def __init__(self, **data: Any) -> None:
        try:
            super().__init__(**data)
        except ValidationError as error:
            raise InputError(what_is_wrong(error, type(self))) from None

    @field_validator("*", mode="before")
    @classmethod
    def check_is_number(cls, value: Any, info: ValidationInfo) -> Any:
        """Refuse True and texts for a number, of which pydantic makes one."""
        if isinstance(value, bool | str | bytes) and cls.model_fields[str(info.field_name)].annotation in (int, float):
            raise ValueError("should be a number")
        return value


Table = TypeVar("Table")

LONGEST = 200
"""Characters of a value that a message shows."""


def toml_values(path: Path) -> dict[str, Any]:
    """What a TOML file holds, unchecked."""
    values: dict[str, Any] = file_values(path, tomllib.loads, "TOML")
    return values


def file_values(path: Path, parse: Callable[[str], Any], kind: str, most: int = TEXT_BYTES) -> Any:
    """What a file of a kind and of at most so many bytes holds, unchecked; one that cannot be read is `InputError`."""
    try:
        return parse(read_text(path, most))
    except InputError:
        raise
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    except (RecursionError, ValueError) as error:
        raise InputError(f"{path}: not a {kind} file: {str(error)[:LONGEST]}") from None


def read_toml(path: Path, table: type[Table]) -> Table:
    """Read a file."""
    return check(toml_values(path), table, str(path))


def check(values: Any, table: type[Table], source: str) -> Table:
    """Values as a pydantic model or a dataclass; raises `InputError` for the first that is unusable.

    Of a dataclass, types are checked strictly, unknown keys are errors, and what `__post_init__` raises is told.
    """
    try:
        if issubclass(table, BaseModel):
            return table.model_validate(dict(values), strict=False)
        refuse_unknown(dict(values), table)
        return TypeAdapter(table).validate_json(json.dumps(dict(values), default=str), strict=True)
    except ValidationError as error:
        raise InputError(f"{source}: {what_is_wrong(error, table)}") from None
    except InputError as error:
        raise InputError(f"{source}: {error}") from None


def refuse_unknown(values: Mapping[str, Any], table: type, prefix: str = "") -> None:
    """Raise `InputError` for a key that is no field of a dataclass or of one in it."""
    hints = get_type_hints(table)
    for key, value in values.items():
        if key not in hints:
            raise InputError(f"unknown key {shown(prefix + key)}; {suggestion(key, hints)}")
        if isinstance(value, Mapping) and dataclasses.is_dataclass(hints[key]):
            refuse_unknown(value, hints[key], f"{prefix}{key}.")


def what_is_wrong(error: ValidationError, table: Any) -> str:
    """The first thing that is wrong: the key, what was given and what is wanted."""
    # A key that is misspelt is also one that is missing: say the former.
    errors = error.errors()
    first = next((one for one in errors if one["type"] == "extra_forbidden"), errors[0])
    key = ".".join(str(part) for part in first["loc"])[:LONGEST]
    if first["type"] == "extra_forbidden":
        known = [field.alias or name for name, field in table.model_fields.items()]
        return f"unknown key {shown(key)}" + (f"; {suggestion(key, known)}" if len(first["loc"]) == 1 else "")
    if first["type"] == "missing":
        return f"{key} is missing"
    inner = first.get("ctx", {}).get("error")
    if key and isinstance(inner, InputError):
        # A table in a table says itself which of its keys it is.
        return f"{key}.{inner}" if re.match(r"[\w.]+ (=|is missing)", str(inner)) else f"{key}: {inner}"
    reason = str(first["msg"]).removeprefix("Value error, ").removeprefix("Input ")
    return f"{key} = {shown(first.get('input'))}: {reason}" if key else reason


def shown(value: object) -> str:
    """A value in a message: what a file holds may be of any length."""
    text = repr(value)
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}..."


def suggestion(name: str, known: Iterable[str]) -> str:
    """ "did you mean gamma?", or else all that is known."""
    names = list(known)
    return did_you_mean(name, names).removeprefix("; ") or f"known: {', '.join(names)}"
