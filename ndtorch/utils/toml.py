"""The one way from TOML files to checked values, with errors of one line that name file and key."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Mapping
from contextvars import ContextVar
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError, ValidationInfo, field_validator

from ndtorch.errors import InputError, did_you_mean
from ndtorch.utils.files import read_text


def no_truth(table: type[BaseModel], value: Any, info: ValidationInfo) -> Any:
    """A value as it is; raises `ValueError` for True and False where the field is a number."""
    if isinstance(value, bool) and table.model_fields[str(info.field_name)].annotation in (int, float):
        raise ValueError("should be a number")
    return value


_READING: ContextVar[bool] = ContextVar("reading", default=False)
"""Whether a file is read: then errors of the tables in it name their keys, not their classes."""


class Strict(BaseModel):
    """A table of a file: unknown keys are errors, and so are NaN and infinity."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    def __init__(self, **data: Any) -> None:
        if _READING.get():
            super().__init__(**data)
            return
        try:
            super().__init__(**data)
        except ValidationError as error:
            raise InputError(f"{type(self).__name__}: {what_is_wrong(error, type(self))}") from None

    @field_validator("*", mode="before")
    @classmethod
    def check_no_truth(cls, value: Any, info: ValidationInfo) -> Any:
        """Refuse True for a number, of which pydantic makes 1."""
        return no_truth(cls, value, info)


Table = TypeVar("Table", bound=BaseModel)

LONGEST = 200
"""Characters of a value that a message shows."""

DOTS = 32
"""Most dots between two commas, brackets or line ends: the time for a key grows with the square of its parts."""


def toml_values(path: Path) -> dict[str, Any]:
    """What a file holds, unchecked."""
    try:
        text = read_text(path)
        if any(part.count(".") > DOTS for part in re.split(r"[\n,=\[\]{}]", text)):
            raise InputError(f"{path}: not a TOML file that can be read: a key of more than {DOTS} parts")
        return tomllib.loads(text)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    except InputError:
        raise
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not a TOML file: {error}") from None
    except (RecursionError, ValueError):  # brackets in brackets in brackets; a number of thousands of digits
        raise InputError(
            f"{path}: not a TOML file that can be read: it is nested too deep, or a number is too long"
        ) from None


def read_toml(path: Path, table: type[Table]) -> Table:
    """Read a file."""
    return check(toml_values(path), table, str(path))


def check(values: Mapping[str, object], table: type[Table], source: str) -> Table:
    """Values as a model; raises `InputError` for the first that is unusable."""
    reading = _READING.set(True)
    try:
        return table.model_validate(dict(values), strict=False)
    except ValidationError as error:
        raise InputError(f"{source}: {what_is_wrong(error, table)}") from None
    finally:
        _READING.reset(reading)


def what_is_wrong(error: ValidationError, table: type[BaseModel]) -> str:
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
        return f"{key}: {inner}"
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
