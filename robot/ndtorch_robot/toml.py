"""TOML files into checked models, with errors of one line."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from ndtorch.errors import InputError


class Strict(BaseModel):
    """A table of a file: unknown keys are errors, and text is no number."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


Table = TypeVar("Table", bound=Strict)


def read_toml(path: Path, table: type[Table]) -> Table:
    """Read a file.

    Raises:
        InputError: a file that cannot be read, is no TOML, or holds unknown keys or unusable values; the
            message names the file, the key and what is allowed.
    """
    try:
        values = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read ({error})") from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: not valid TOML: {error}") from None
    return check(values, table, str(path))


def check(values: dict[str, object], table: type[Table], source: str) -> Table:
    """Values as a model; raises `InputError` for the first that is unusable."""
    try:
        return table.model_validate(values, strict=False)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        if first["type"] == "extra_forbidden":
            known = ", ".join(table.model_fields) if len(first["loc"]) == 1 else "see `ndtorch arenas`"
            raise InputError(f"{source}: unknown key {key!r}, known keys are {known}") from None
        given = first.get("input")
        reason = first["msg"].removeprefix("Value error, ").removeprefix("Input ")
        raise InputError(f"{source}: {key} = {given!r}: {reason}") from None
