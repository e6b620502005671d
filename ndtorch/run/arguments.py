"""From a command's class to its options on the command line."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any, TypeVar, get_type_hints

from ndtorch.errors import InputError

Kind = TypeVar("Kind", bound=type)

QUIET = ("-q", "--quiet")
"""Flags that every command knows."""

EVERY = "Every command takes --quiet (-q): it prints nothing but errors, and the answer of --json."

UNSAID = ("None", "False", "")
"""Defaults that say nothing: the words before say what happens where an option is not given."""


def choices(**words: Sequence[str]) -> Callable[[Kind], Kind]:
    """Class decorator, under `dataclass`: the help shows what an option takes, `--rule {competitive,hebbian}`.

    What is given is checked where it is used, with one line that names the option.

    Args:
        words: for each option what it takes; words in capitals stand for any such thing.
    """

    def add(kind: Kind) -> Kind:
        import tyro

        hints = get_type_hints(kind, include_extras=True)
        for name, taken in words.items():
            shown = tyro.conf.arg(metavar="{" + ",".join(taken) + "}")
            kind.__annotations__[name] = Annotated[hints[name], shown]
        return kind

    return add


def parse(kind: type[Any], prog: str, arguments: Sequence[str]) -> Any:
    """The command with its options.

    Args:
        kind: a dataclass; its docstring is the help. Its attribute `gone`, where it has one, holds flags of earlier
            versions, and what took their place.
        prog: how it is called.
        arguments: without `--quiet`.

    Raises:
        InputError: a flag that is gone.
        SystemExit: after the help, or with code 2 after saying what is wrong with the arguments.
    """
    import tyro

    gone: Mapping[str, str] = getattr(kind, "gone", {})
    for flag in gone:
        if any(word == flag or word.startswith(f"{flag}=") for word in arguments):
            raise InputError(f"{flag} is gone: {gone[flag]}")
    hints = get_type_hints(kind, include_extras=True)
    hide = tyro.conf.arg(help_behavior_hint=lambda default: "" if default in UNSAID else f"(default: {default})")
    for field in dataclasses.fields(kind):
        kind.__annotations__[field.name] = Annotated[hints[field.name], hide]
    config = (tyro.conf.OmitArgPrefixes, tyro.conf.FlagCreatePairsOff, tyro.conf.DisallowNone)
    return tyro.cli(kind, prog=prog, description=f"{kind.__doc__}\n\n{EVERY}", args=arguments, config=config)
