"""The `ndtorch` command: it finds the commands of what is installed and runs one of them."""

from __future__ import annotations

import ast
import contextlib
import os
import sys
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import EntryPoint, PackageNotFoundError, entry_points, version

import ndtorch
from ndtorch.cli.command_run import INTERRUPTED, UNUSABLE, Subcommand, missing, run_command
from ndtorch.cli.completion import SHELLS, completion
from ndtorch.cli.streams import line, unblocked
from ndtorch.errors import did_you_mean
from ndtorch.run.arguments import EVERY, QUIET, flags_of
from ndtorch.utils.packages import OURS, module_places
from ndtorch.utils.signals import NOTHING_KEPT, ended_like_ctrl_c

GROUP = "ndtorch.commands"
"""Entry points that are commands: `name = "module:Class"`, the class a `Subcommand`."""

ELSEWHERE = {
    "ndtorch-robot": ("arenas", "calibrate", "cameras", "check", "drive", "evaluate", "replay", "run"),
    "ndtorch-train": ("benchmark", "first-stage", "reproduce", "sweep"),
}
"""Commands of our other distributions, to name these where they are missing."""

UNREAD = 141
"""Exit code when the reader of what is printed has gone, as shells have it."""


class CommandError(Exception):
    """A command that is registered cannot be had; the message says why, in one line."""


def installed() -> dict[str, list[EntryPoint]]:
    """The commands of everything that is installed, by name; more than one where two distributions take a name."""
    found: dict[str, dict[str, EntryPoint]] = {}
    for point in entry_points(group=GROUP):
        # One distribution may be found twice, through a checkout and its installation: that is the same command.
        found.setdefault(point.name, {}).setdefault(point.value, point)
    return {name: list(found[name].values()) for name in sorted(found)}


def load_command(name: str, points: Sequence[EntryPoint]) -> type[Subcommand]:
    """The class of a command; its module is imported now, and no other command's."""
    if len(points) > 1:
        raise CommandError(f"{name} is registered {len(points)} times: {', '.join(map(origin, points))}; remove one")
    try:
        kind: type[Subcommand] = points[0].load()
    except Exception as error:  # whatever is wrong with it, other commands work
        words = missing(error) or f"{type(error).__name__}: {error}".splitlines()[0]
        raise CommandError(f"{name} of {origin(points[0])} does not load: {words}") from None
    return kind


def origin(point: EntryPoint) -> str:
    """The distribution that a command comes from."""
    return point.value if point.dist is None else point.dist.name


def main(arguments: Sequence[str] | None = None) -> int:
    """The `ndtorch` command: run the command that comes first on the command line."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    commands = installed()
    if not given or given[0] in ("-h", "--help"):
        print(overview(commands))
        return 0 if given else UNUSABLE
    if given[0] == "--version":
        print(versions())
        return 0
    if given[0] == "--completion":
        return print_completion(given[1:], commands)
    if given[0] not in commands:
        print(f"error: ndtorch has no command {given[0]!r}; {hint(given[0], commands)}", file=sys.stderr)
        return UNUSABLE
    try:
        kind = load_command(given[0], commands[given[0]])
    except CommandError as error:
        print(f"error: {line(error)}", file=sys.stderr)
        return UNUSABLE
    except KeyboardInterrupt:
        print(NOTHING_KEPT, file=sys.stderr)
        return INTERRUPTED
    parts = getattr(kind, "subcommands", None)
    if parts is None:
        return run_command(f"ndtorch {given[0]}", kind, given[1:])
    return run_part(given[0], kind, parts, given[1:])


def run_part(name: str, kind: type[Subcommand], parts: Mapping[str, type[Subcommand]], given: Sequence[str]) -> int:
    """Run one of the sub-commands of a command, which its class names in `subcommands`."""
    if given and given[0] in parts:
        return run_command(f"ndtorch {name} {given[0]}", parts[given[0]], given[1:])
    if not given or given[0] in ("-h", "--help"):
        lines = [f"usage: ndtorch {name} SUBCOMMAND ...", "", kind.__doc__ or "", ""]
        lines += [f"  {part:22}{(one.__doc__ or '').splitlines()[0]}" for part, one in parts.items()]
        print("\n".join([*lines, "", f"`ndtorch {name} SUBCOMMAND --help` says what each takes."]))
        return 0 if given else UNUSABLE
    near = did_you_mean(given[0], parts).removeprefix("; ") or f"there are {', '.join(parts)}"
    print(f"error: ndtorch {name} has no sub-command {given[0]!r}; {near}", file=sys.stderr)
    return UNUSABLE


def program() -> int:
    """`main` as a program: whoever reads what it prints may stop reading, as `head` does."""
    sys.stderr = unblocked(sys.stderr)
    try:
        with ended_like_ctrl_c() as came:
            code = main()
        sys.stdout.flush()
    except BrokenPipeError:
        # Python flushes once more at its end, and would complain.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return UNREAD
    except KeyboardInterrupt:
        # It came before there was a command, or after it.
        print(NOTHING_KEPT, file=sys.stderr)
        code = INTERRUPTED
    return 128 + came[0] if code == INTERRUPTED and came else code


def print_completion(shell: Sequence[str], commands: Mapping[str, Sequence[EntryPoint]]) -> int:
    """Print what completes commands and flags in a shell, bash where none is named; gives the exit code."""
    name = shell[0] if shell else "bash"
    if len(shell) > 1 or name not in SHELLS:
        print(f"error: --completion takes one of {', '.join(SHELLS)}; got {' '.join(shell)!r}", file=sys.stderr)
        return UNUSABLE
    print(completion(name, {name: flags_of_command(name, points) for name, points in commands.items()}), end="")
    return 0


def flags_of_command(name: str, points: Sequence[EntryPoint]) -> list[str]:
    """What completion offers after a command; nothing for one that does not load."""
    try:
        kind = load_command(name, points)
        parts: Mapping[str, type[Subcommand]] = getattr(kind, "subcommands", {})
        flags = dict.fromkeys(flag for one in (kind, *parts.values()) for flag in flags_of(one))
        return [*parts, *flags, *QUIET, "--help"]
    except CommandError:
        return []


def hint(name: str, commands: Iterable[str]) -> str:
    """What to do about a command that is not there."""
    for distribution, names in ELSEWHERE.items():
        if name in names:
            return f"it comes with {distribution}; in a checkout: pip install ./{distribution.removeprefix('ndtorch-')}"
    near = did_you_mean(name, commands)
    if near:
        return near.removeprefix("; ")
    return f"there are {', '.join(commands)}" if commands else "none is installed: pip install ndtorch"


def versions() -> str:
    """One line a distribution of ours that is installed."""
    lines = []
    for name in OURS:
        with contextlib.suppress(PackageNotFoundError):
            lines.append(f"{name} {version(name)}")
    return "\n".join(lines or [f"ndtorch {ndtorch.__version__}"])


def overview(commands: Mapping[str, Sequence[EntryPoint]]) -> str:
    """All commands, each with the first line of its help, or with why there is none."""
    lines = ["usage: ndtorch COMMAND ...", "", "Insect-inspired vision, navigation and a robot.", ""]
    for name, points in commands.items():
        try:
            text = written(points[0]) if len(points) == 1 else ""
            text = text or load_command(name, points).__doc__ or ""
        except CommandError as error:
            text = f"({error})"
        lines.append(f"  {name:14}{next(iter(text.strip().splitlines()), '')}")
    lines += ["", EVERY]
    lines += ["`ndtorch COMMAND --help` says what each takes, `ndtorch --version` what is installed."]
    lines += ['`eval "$(ndtorch --completion)"` in ~/.bashrc completes commands and flags; it knows zsh and fish too.']
    return "\n".join(lines)


def written(point: EntryPoint) -> str:
    """The docstring of a command as it stands in its file, so that the help need not import what the command does.

    Empty where it is not to be found; loading the command then tells why.
    """
    try:
        place = next(module_places(point.module))
        tree = ast.parse((place / "__init__.py" if place.is_dir() else place).read_text(encoding="utf-8"))
    except (StopIteration, OSError, SyntaxError, ValueError):
        return ""
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef) and node.name == point.attr:
            return ast.get_docstring(node) or ""
        if isinstance(node, ast.ImportFrom) and any(alias.name == point.attr for alias in node.names):
            return written(EntryPoint(point.name, f"{node.module}:{point.attr}", point.group))
    return ""
