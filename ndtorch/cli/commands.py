"""The `ndtorch` command: it finds the commands of what is installed and runs one of them."""

from __future__ import annotations

import contextlib
import gc
import os
import sys
from collections.abc import Mapping, Sequence
from importlib.metadata import EntryPoint, PackageNotFoundError, entry_points, version

from ndtorch.cli.command_run import INTERRUPTED, UNUSABLE, Subcommand, missing, run_command
from ndtorch.cli.streams import line, open_closed_streams, unblocked
from ndtorch.errors import did_you_mean
from ndtorch.run.arguments import EVERY
from ndtorch.utils.packages import OURS
from ndtorch.utils.signals import NOTHING_KEPT, ended_like_ctrl_c

GROUP = "ndtorch.commands"
"""Entry points that are commands: `name = "module:Class"`, the class a `Subcommand`."""

GROUPS = {
    "Binding": ("bind", "scenes", "render", "first-stage"),
    "Robot": ("drive", "arenas", "run", "check", "doctor", "calibrate", "replay", "import"),
    "Experiments": ("tuning", "evaluate", "barn", "benchmark", "reproduce", "sweep"),
}
"""Where commands stand in the help; all others stand under "Other"."""

DISTRIBUTIONS = {
    **dict.fromkeys((*GROUPS["Robot"], "evaluate", "barn"), "ndtorch-robot"),
    **dict.fromkeys(("benchmark", "first-stage", "reproduce", "sweep"), "ndtorch-train"),
}
"""Which of our other distributions has a command, to name it where it is missing."""

UNREAD = 141
"""Exit code when the reader of what is printed has gone, as shells have it."""


class CommandError(Exception):
    """A command that is registered cannot be had; the message says why, in one line."""


def load_command(point: EntryPoint) -> type[Subcommand]:
    """The class of a command; its module is imported now."""
    try:
        kind: type[Subcommand] = point.load()
    except Exception as error:  # whatever is wrong with it, other commands work
        words = missing(error) or f"{type(error).__name__}: {error}".splitlines()[0]
        origin = point.value if point.dist is None else point.dist.name
        raise CommandError(f"{point.name} of {origin} does not load: {words}") from None
    return kind


def main(arguments: Sequence[str] | None = None) -> int:
    """The `ndtorch` command: run the command that comes first on the command line."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    commands = {point.name: point for point in sorted(entry_points(group=GROUP))}
    if not given or given[0] in ("-h", "--help"):
        print(overview(commands))
        return 0 if given else UNUSABLE
    if given[0] == "--version":
        for name in OURS:
            with contextlib.suppress(PackageNotFoundError):
                print(name, version(name))
        return 0
    name, *rest = given
    try:
        if name not in commands:
            near = did_you_mean(name, commands).removeprefix("; ") or f"there are {', '.join(commands) or 'none'}"
            package = DISTRIBUTIONS.get(name)
            words = f"it comes with {package}: pip install {package}" if package else near
            raise CommandError(f"ndtorch has no command {name!r}; {words}")
        kind = load_command(commands[name])
        parts: Mapping[str, type[Subcommand]] | None = getattr(kind, "subcommands", None)
        if parts is None:
            return run_command(f"ndtorch {name}", kind, rest)
        if not rest or rest[0] in ("-h", "--help"):
            lines = [f"  {part:22}{first_line(one)}" for part, one in parts.items()]
            print("\n".join([f"usage: ndtorch {name} SUBCOMMAND ...", "", kind.__doc__ or "", "", *lines, ""]))
            print(f"`ndtorch {name} SUBCOMMAND --help` says what each takes.")
            return 0 if rest else UNUSABLE
        if rest[0] not in parts:
            near = did_you_mean(rest[0], parts).removeprefix("; ") or f"there are {', '.join(parts)}"
            raise CommandError(f"ndtorch {name} has no sub-command {rest[0]!r}; {near}")
        return run_command(f"ndtorch {name} {rest[0]}", parts[rest[0]], rest[1:])
    except CommandError as error:
        print(f"error: {line(error)}", file=sys.stderr)
        return UNUSABLE
    except KeyboardInterrupt:
        print(NOTHING_KEPT, file=sys.stderr)
        return INTERRUPTED


def program() -> int:
    """`main` as a program: whoever reads what it prints may stop reading, as `head` does."""
    os.environ["MPLBACKEND"] = "Agg"  # figures are files, whatever a notebook has set
    open_closed_streams()
    sys.stderr = unblocked(sys.stderr)
    try:
        with ended_like_ctrl_c() as came:
            sys.stdout = unblocked(sys.stdout, lambda: not came)
            code = main()
    except BrokenPipeError:
        return UNREAD
    except KeyboardInterrupt:
        # It came before there was a command, or after it.
        print(NOTHING_KEPT, file=sys.stderr)
        code = INTERRUPTED
    gc.freeze()  # the interpreter would look through all objects of torch and numba at its end: a second
    return 128 + came[0] if code == INTERRUPTED and came else code


def first_line(kind: type[Subcommand]) -> str:
    """The first line of a command's help."""
    return (kind.__doc__ or "").strip().partition("\n")[0]


def overview(commands: Mapping[str, EntryPoint]) -> str:
    """All commands in their groups, each with the first line of its help, or with why there is none."""
    lines = ["usage: ndtorch COMMAND ...", "", "Insect-inspired vision, navigation and a robot."]
    others = [name for name in commands if not any(name in names for names in GROUPS.values())]
    for title, names in {**GROUPS, "Other": others}.items():
        there = [name for name in names if name in commands]
        lines += ["", f"{title}:"] * bool(there)
        for name in there:
            try:
                text = first_line(load_command(commands[name]))
            except CommandError as error:
                text = f"({error})"
            lines.append(f"  {name:14}{text}")
    return "\n".join(
        [*lines, "", EVERY, "`ndtorch COMMAND --help` lists its options, `ndtorch --version` the versions."]
    )
