"""Subcommands as dataclasses with a `run` method: one way in for `ndtorch`, `python -m train` and `python -m robot`."""

from __future__ import annotations

import functools
import operator
import sys
import warnings
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Protocol

from ndtorch.errors import InputError

UNUSABLE = 2
"""Exit code for input that cannot be used."""

INTERRUPTED = 130
"""Exit code after Ctrl-C."""


class Subcommand(Protocol):
    """A dataclass whose fields are the options and whose docstring is the help."""

    def run(self) -> int:
        """Do it; returns the exit code."""
        ...


def run_subcommand(
    prog: str, description: str, commands: Mapping[str, type[Any]], arguments: Sequence[str] | None = None
) -> int:
    """Parse the command line and run what it asks for.

    Args:
        prog: how the program is called, for the help.
        description: one line of help.
        commands: subcommands by name, each a dataclass with `run() -> int`.
        arguments: instead of those of the process.

    Returns:
        The exit code: that of the subcommand, 2 after an `InputError` (one line on stderr), 130 after Ctrl-C.
    """
    import tyro

    choices = [Annotated[kind, tyro.conf.subcommand(name)] for name, kind in commands.items()]
    union: Any = functools.reduce(operator.or_, choices)
    command: Any = tyro.cli(
        union,
        prog=prog,
        description=description,
        args=arguments,
        config=(tyro.conf.OmitArgPrefixes, tyro.conf.FlagCreatePairsOff, tyro.conf.DisallowNone),
    )
    try:
        with warnings.catch_warnings():
            # Remarks such as "is grey" are for the user of the command: one line, and no source code.
            warnings.simplefilter("always", UserWarning)
            warnings.showwarning = note
            code: int = command.run()
            return code
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return UNUSABLE
    except KeyboardInterrupt:
        print("stopped before there was anything to keep", file=sys.stderr)
        return INTERRUPTED


def note(message: Warning | str, *_: object, **__: object) -> None:
    """Show a warning as one line."""
    print(f"note: {message}", file=sys.stderr)
