"""One command: its options are parsed, it runs, and what it has to say goes to stderr."""

from __future__ import annotations

import contextlib
import logging
import os
import sys
import warnings
from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Protocol

from ndtorch.cli.streams import line
from ndtorch.errors import InputError
from ndtorch.utils.packages import OURS, remedy
from ndtorch.utils.signals import NOTHING_KEPT

INCOMPLETE = 1
"""Exit code when what came first is kept, and figures or a recording could not be."""
UNUSABLE = 2
"""Exit code for input that cannot be used."""
INTERRUPTED = 130
"""Exit code after Ctrl-C; after SIGTERM and SIGHUP it is 143 and 129, as shells have it."""


class Subcommand(Protocol):
    """A dataclass whose fields are the options and whose docstring is the help."""

    def run(self) -> int:
        """Do it; returns the exit code."""
        ...


def missing(error: Exception) -> str | None:
    """What to install where a module is missing that one of our distributions asks for; None for other errors."""
    if not isinstance(error, ModuleNotFoundError) or error.name is None:
        return None
    top = error.name.split(".")[0]
    command = None if top != error.name and find_spec(top) else remedy(top)
    return None if command is None else f"{top} is not installed: {command}"


def run_command(prog: str, kind: type[Subcommand], arguments: Sequence[str]) -> int:
    """Parse the options of a command and run it; the exit code: its own, 2 after an `InputError`, 130 after Ctrl-C."""
    try:
        from ndtorch.run.arguments import QUIET, parse

        quiet = any(word in QUIET for word in arguments)
        command: Subcommand = parse(kind, prog, [word for word in arguments if word not in QUIET])
        with told(quiet, muted=quiet and not getattr(command, "json", False)):
            return command.run()
    except InputError as error:
        print(f"error: {line(error)}", file=sys.stderr)
        return UNUSABLE
    except BrokenPipeError:
        raise  # for `program`
    except (MemoryError, RuntimeError, ImportError, OSError) as error:
        words = system_error(error) or missing(error)
        if words is None:
            raise
        print(f"error: {line(words)}", file=sys.stderr)
        return UNUSABLE
    except KeyboardInterrupt:
        print(NOTHING_KEPT, file=sys.stderr)
        return INTERRUPTED


def system_error(error: Exception) -> str | None:
    """What a user can mend: memory that is short, a full disk, no folder. None for faults of the program."""
    if isinstance(error, MemoryError) or "not enough memory" in str(error) or "out of memory" in str(error):
        return f"there is not enough memory ({error})"
    if not isinstance(error, OSError) or error.strerror is None:
        return None
    where = "a file cannot be written: " if error.filename is None else f"{error.filename}: "
    return f"{where}{error.strerror}"


@contextlib.contextmanager
def told(quiet: bool, muted: bool) -> Iterator[None]:
    """Remarks and log go to stderr, a line each, unless `quiet`; `muted`: nothing on stdout either."""
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
            warnings.showwarning = lambda message, *_, **__: print(f"note: {line(message)}", file=sys.stderr)
            if muted:
                nowhere = stack.enter_context(Path(os.devnull).open("w", encoding="utf-8"))
                stack.enter_context(contextlib.redirect_stdout(nowhere))
            yield
    finally:
        for logger, level in zip(loggers, before, strict=True):
            logger.removeHandler(handler)
            logger.setLevel(level)
