"""The options of a navigator on the command line.

They are read from where `NavigatorOptions` is declared, and nothing is imported for that: torch takes two seconds, and
`ndtorch drive --help` answers at once.
"""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Callable
from functools import cache
from typing import Annotated, Any, Literal, NamedTuple, TypeVar

import tyro

from ndtorch.utils.packages import module_places

Command = TypeVar("Command", bound=type)

MODULE, CLASS = "ndtorch.navigation.options", "NavigatorOptions"


class Option(NamedTuple):
    """One field of `NavigatorOptions`: name, type, default, and what the docstring says of it."""

    name: str
    kind: Any
    default: Any
    words: str


def navigator_options(*left_out: str) -> Callable[[Command], Command]:
    """Class decorator, under `dataclass`: a command gets an option for each of `NavigatorOptions`.

    What is not given is None, or False where the option is a flag.

    Args:
        left_out: options that the command does not have.
    """

    def add(command: Command) -> Command:
        for option in declared():
            if option.name in left_out:
                continue
            flag = option.default is False
            text = option.words if flag or option.default == "" else f"{option.words} (default: {option.default})"
            kind: Any = option.kind if flag else option.kind | None
            conf = tyro.conf.arg(help=text)
            command.__annotations__[option.name] = Annotated[kind, conf]
            setattr(command, option.name, False if flag else None)
        return command

    return add


@cache
def declared() -> tuple[Option, ...]:
    tree = parsed(MODULE)
    made = next(node for node in tree.body if isinstance(node, ast.ClassDef) and node.name == CLASS)
    words = described(ast.get_docstring(made) or "")
    return tuple(
        Option(node.target.id, value(node.annotation, tree), value(node.value, tree), words[node.target.id])
        for node in made.body
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name) and node.value is not None
    )


def described(text: str) -> dict[str, str]:
    block = re.split(r"^\w+:\n", inspect.cleandoc(text), flags=re.MULTILINE)[1]
    entries = re.split(r"^    (\w+): ", block, flags=re.MULTILINE)[1:]
    lines = zip(entries[::2], entries[1::2], strict=True)
    return {name: " ".join(words.split()).replace("`", "").replace('"', "") for name, words in lines}


def parsed(module: str) -> ast.Module:
    return ast.parse(next(module_places(module)).read_text(encoding="utf-8"))


def value(node: ast.expr, tree: ast.Module) -> Any:
    """A type or a constant as it is written: a literal, a built-in type, `Literal[...]`, or a name for one of these."""
    if isinstance(node, ast.Name):
        kinds = {"str": str, "int": int, "float": float, "bool": bool}
        return kinds[node.id] if node.id in kinds else named(node.id, tree)
    if isinstance(node, ast.Subscript):
        return Literal[ast.literal_eval(node.slice)]
    return ast.literal_eval(node)


def named(name: str, tree: ast.Module) -> Any:
    """What a name of a module stands for, which may come from another module."""
    for node in tree.body:
        if isinstance(node, ast.Assign) and any(isinstance(t, ast.Name) and t.id == name for t in node.targets):
            return value(node.value, tree)
        if isinstance(node, ast.ImportFrom) and node.module and any(alias.name == name for alias in node.names):
            return named(name, parsed(node.module))
    raise LookupError(f"{name} is not declared where {CLASS} is")
