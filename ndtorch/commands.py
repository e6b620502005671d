"""The `ndtorch` command: it finds the commands of what is installed and runs one of them."""

from __future__ import annotations

import ast
import contextlib
import difflib
import errno
import logging
import os
import signal
import sys
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib.metadata import EntryPoint, PackageNotFoundError, entry_points, version
from pathlib import Path
from typing import Protocol

import ndtorch
from ndtorch.code_digest import module_places
from ndtorch.errors import InputError
from ndtorch.optional import OURS, remedy
from ndtorch.run.arguments import EVERY

GROUP = "ndtorch.commands"
"""Entry points that are commands: `name = "module:Class"`, the class a `Subcommand`."""

ELSEWHERE = {
    "ndtorch-robot": ("arenas", "calibrate", "cameras", "check", "drive", "evaluate", "replay", "run"),
    "ndtorch-train": ("first-stage", "reproduce", "score", "sweep"),
}
"""Commands of our other distributions, to name these where they are missing."""

UNUSABLE = 2
"""Exit code for input that cannot be used."""

UNWRITABLE = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG, errno.EACCES, errno.EPERM)
"""Errors of the disk that a user can mend, told in one line."""

INTERRUPTED = 130
"""Exit code after Ctrl-C; after SIGTERM and SIGHUP it is 143 and 129, as shells have it."""

ENDING = (signal.SIGTERM, *((signal.SIGHUP,) if hasattr(signal, "SIGHUP") else ()))
"""Signals that end a command as Ctrl-C does."""

UNREAD = 141
"""Exit code when the reader of what is printed has gone, as shells have it."""


class Subcommand(Protocol):
    """A dataclass whose fields are the options and whose docstring is the help."""

    def run(self) -> int:
        """Do it; returns the exit code."""
        ...


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
    """The class of a command; its module is imported now, and no other command's.

    Raises:
        CommandError: two distributions have a command of this name, or the command's module cannot be imported.
    """
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


def missing(error: Exception) -> str | None:
    """What to install where a module is missing that one of our distributions asks for; None for other errors."""
    if not isinstance(error, ModuleNotFoundError) or error.name is None:
        return None
    top = error.name.split(".")[0]
    if top != error.name and any(module_places(top)):
        return None  # it is installed, and only a part of it is not there
    command = remedy(top)
    return None if command is None else f"{top} is not installed: {command}"


def main(arguments: Sequence[str] | None = None) -> int:
    """The `ndtorch` command: run the command that comes first on the command line.

    Args:
        arguments: instead of those of the process.

    Returns:
        The exit code: that of the command, 2 for a command that does not exist or cannot be loaded.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    commands = installed()
    if not given or given[0] in ("-h", "--help"):
        print(overview(commands))
        return 0 if given else UNUSABLE
    if given[0] == "--version":
        print(versions())
        return 0
    if given[0] not in commands:
        print(f"error: ndtorch has no command {given[0]!r}; {hint(given[0], commands)}", file=sys.stderr)
        return UNUSABLE
    try:
        kind = load_command(given[0], commands[given[0]])
    except CommandError as error:
        print(f"error: {error}", file=sys.stderr)
        return UNUSABLE
    except KeyboardInterrupt:
        return INTERRUPTED
    return run_command(f"ndtorch {given[0]}", kind, given[1:])


def program() -> int:
    """`main` as a program: whoever reads what it prints may stop reading, as `head` does."""
    try:
        with ended_like_ctrl_c() as came:
            code = main()
        sys.stdout.flush()
    except BrokenPipeError:
        # Python flushes once more at its end, and would complain.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return UNREAD
    except KeyboardInterrupt:
        code = INTERRUPTED  # it came before there was a command, or after it
    return 128 + came[0] if code == INTERRUPTED and came else code


@contextlib.contextmanager
def ended_like_ctrl_c() -> Iterator[list[int]]:
    """SIGTERM and SIGHUP raise KeyboardInterrupt inside, as Ctrl-C does: what was computed is kept.

    A signal that is ignored stays ignored, as `nohup` wants it.

    Yields:
        The number of the first of these signals that came, once it has.
    """
    came: list[int] = []

    def interrupt(number: int, _: object) -> None:
        came.append(number)
        raise KeyboardInterrupt

    old = {number: signal.getsignal(number) for number in ENDING}
    for number, handler in old.items():
        if handler == signal.SIG_DFL:
            signal.signal(number, interrupt)
    try:
        yield came
    finally:
        for number, handler in old.items():
            if handler == signal.SIG_DFL:
                signal.signal(number, handler)


def hint(name: str, commands: Iterable[str]) -> str:
    """What to do about a command that is not there."""
    for distribution, names in ELSEWHERE.items():
        if name in names:
            return f"it comes with {distribution}; in a checkout: pip install ./{distribution.removeprefix('ndtorch-')}"
    near = difflib.get_close_matches(name, commands, 1)
    if near:
        return f"did you mean {near[0]!r}?"
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
    for node in tree.body:
        if isinstance(node, ast.ClassDef) and node.name == point.attr:
            return ast.get_docstring(node) or ""
        if isinstance(node, ast.ImportFrom) and any(alias.name == point.attr for alias in node.names):
            return written(EntryPoint(point.name, f"{node.module}:{point.attr}", point.group))
    return ""


def run_command(prog: str, kind: type[Subcommand], arguments: Sequence[str]) -> int:
    """Parse the options of one command and run it.

    Args:
        prog: how the command is called, for the help.
        kind: the command, a dataclass with `run() -> int`.
        arguments: its options.

    Returns:
        The exit code: that of the command, 2 after an `InputError` (one line on stderr), 130 after Ctrl-C.
    """
    try:
        from ndtorch.run.arguments import QUIET, parse

        quiet = any(word in QUIET for word in arguments)
        command: Subcommand = parse(kind, prog, [word for word in arguments if word not in QUIET])
        with told(quiet, muted=quiet and not getattr(command, "json", False)):
            return command.run()
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return UNUSABLE
    except BrokenPipeError:
        raise  # for `program`
    except OSError as error:
        # A full disk, a folder that became read-only: what could be kept has been.
        if error.errno not in UNWRITABLE:
            raise
        where = "" if error.filename is None else f"{error.filename}: "
        print(f"error: {where}{error.strerror}", file=sys.stderr)
        return UNUSABLE
    except ModuleNotFoundError as error:
        words = missing(error)
        if words is None:
            raise
        print(f"error: {prog}: {words}", file=sys.stderr)
        return UNUSABLE
    except KeyboardInterrupt:
        print("stopped before there was anything to keep", file=sys.stderr)
        return INTERRUPTED


@contextlib.contextmanager
def told(quiet: bool, muted: bool) -> Iterator[None]:
    """What a command has to say goes to stderr, a line each: what it logs, and remarks such as "is grey".

    Args:
        quiet: say nothing of that.
        muted: print nothing on stdout either.
    """
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(logging.Formatter("note: %(message)s"))
    loggers = [logging.getLogger(name.replace("-", "_")) for name in OURS]
    before = [logger.level for logger in loggers]
    for logger in loggers:
        logger.addHandler(handler)
        logger.setLevel(logging.ERROR if quiet else logging.INFO)
    try:
        with contextlib.ExitStack() as stack:
            stack.enter_context(warnings.catch_warnings())
            warnings.simplefilter("ignore" if quiet else "always", UserWarning)
            warnings.showwarning = note
            if muted:
                nowhere = stack.enter_context(Path(os.devnull).open("w", encoding="utf-8"))
                stack.enter_context(contextlib.redirect_stdout(nowhere))
            yield
    finally:
        for logger, level in zip(loggers, before, strict=True):
            logger.removeHandler(handler)
            logger.setLevel(level)


def note(message: Warning | str, *_: object, **__: object) -> None:
    """Show a warning as one line."""
    print(f"note: {message}", file=sys.stderr)
