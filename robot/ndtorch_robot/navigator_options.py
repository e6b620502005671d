"""The options of a navigator on the command line, as `NavigatorOptions` declares them; torch is not imported."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Callable
from dataclasses import fields
from itertools import pairwise
from typing import Annotated, Any, TypeVar, get_type_hints

import tyro

from ndtorch.navigation.options import NavigatorOptions

Command = TypeVar("Command", bound=type)


def navigator_options(*left_out: str) -> Callable[[Command], Command]:
    """Class decorator, under `dataclass`: a command gets an option for each of `NavigatorOptions`.

    What is not given is None, or False where the option is a flag.

    Args:
        left_out: options that the command does not have.
    """

    def add(command: Command) -> Command:
        kinds, words = get_type_hints(NavigatorOptions), described(NavigatorOptions)
        for option in fields(NavigatorOptions):
            if option.name in left_out:
                continue
            flag, text = option.default is False, words[option.name]
            text = text if flag or option.default == "" else f"{text} (default: {option.default})"
            kind: Any = kinds[option.name] if flag else kinds[option.name] | None
            command.__annotations__[option.name] = Annotated[kind, tyro.conf.arg(help=text)]
            setattr(command, option.name, False if flag else None)
        return command

    return add


def described(kind: type) -> dict[str, str]:
    """The docstrings below the fields of a class."""
    made = ast.parse(inspect.getsource(kind)).body[0]
    assert isinstance(made, ast.ClassDef)
    return {
        ast.unparse(field.target): " ".join(str(text.value.value).split())
        for field, text in pairwise(made.body)
        if isinstance(field, ast.AnnAssign) and isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant)
    }
