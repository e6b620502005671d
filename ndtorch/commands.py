"""The `ndtorch` command: it finds the commands of what is installed and runs one of them."""

from __future__ import annotations

import difflib
import sys
import warnings
from collections.abc import Mapping, Sequence
from importlib.metadata import EntryPoint, entry_points
from typing import Protocol

from ndtorch.errors import InputError

GROUP = "ndtorch.commands"
"""Entry points that are commands: `name = "module:Class"`, the class a `Subcommand`."""

UNUSABLE = 2
"""Exit code for input that cannot be used."""

INTERRUPTED = 130
"""Exit code after Ctrl-C."""


class Subcommand(Protocol):
    """A dataclass whose fields are the options and whose docstring is the help."""

    def run(self) -> int:
        """Do it; returns the exit code."""
        ...


def installed() -> dict[str, EntryPoint]:
    """The commands of everything that is installed, by name: entry points of the group `ndtorch.commands`."""
    found = entry_points(group=GROUP)
    return {name: next(point for point in found if point.name == name) for name in sorted(found.names)}


def main(arguments: Sequence[str] | None = None) -> int:
    """The `ndtorch` command: run the command that comes first on the command line.

    Args:
        arguments: instead of those of the process.

    Returns:
        The exit code: that of the command, 2 for a command that does not exist.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    commands = installed()
    if not given or given[0] in ("-h", "--help"):
        print(overview(commands))
        return 0 if given else UNUSABLE
    if given[0] not in commands:
        near = difflib.get_close_matches(given[0], commands, 1)
        hint = f"did you mean {near[0]!r}?" if near else f"there are {', '.join(commands)}"
        print(f"error: ndtorch has no command {given[0]!r}; {hint}", file=sys.stderr)
        return UNUSABLE
    return run_command(f"ndtorch {given[0]}", commands[given[0]].load(), given[1:])


def overview(commands: Mapping[str, EntryPoint]) -> str:
    """All commands, each with the first line of its help."""
    lines = ["usage: ndtorch COMMAND ...", "", "Insect-inspired vision, navigation and a robot.", ""]
    for name, point in commands.items():
        about = (point.load().__doc__ or "").strip().splitlines()
        lines.append(f"  {name:14}{about[0] if about else ''}")
    return "\n".join([*lines, "", "`ndtorch COMMAND --help` says what each takes."])


def run_command(prog: str, kind: type[Subcommand], arguments: Sequence[str]) -> int:
    """Parse the options of one command and run it.

    Args:
        prog: how the command is called, for the help.
        kind: the command, a dataclass with `run() -> int`.
        arguments: its options.

    Returns:
        The exit code: that of the command, 2 after an `InputError` (one line on stderr), 130 after Ctrl-C.
    """
    import tyro

    command: Subcommand = tyro.cli(
        kind,
        prog=prog,
        args=arguments,
        config=(tyro.conf.OmitArgPrefixes, tyro.conf.FlagCreatePairsOff, tyro.conf.DisallowNone),
    )
    try:
        with warnings.catch_warnings():
            # Remarks such as "is grey" are for the user of the command: one line, and no source code.
            warnings.simplefilter("always", UserWarning)
            warnings.showwarning = note
            return command.run()
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return UNUSABLE
    except KeyboardInterrupt:
        print("stopped before there was anything to keep", file=sys.stderr)
        return INTERRUPTED


def note(message: Warning | str, *_: object, **__: object) -> None:
    """Show a warning as one line."""
    print(f"note: {message}", file=sys.stderr)
