"""From a command's class to its options on the command line."""

from __future__ import annotations

import contextlib
import dataclasses
import inspect
import io
import itertools
import re
from collections.abc import Sequence
from typing import Annotated, Any, get_type_hints

from ndtorch.errors import InputError, did_you_mean

QUIET = ("-q", "--quiet")
"""Flags that every command knows."""
EVERY = "Every command takes --quiet (-q): it prints nothing but errors, and the answer of --json."
REFUSED = 2
"""The exit code with which tyro refuses arguments."""

METAVARS = {
    "sources": "SOURCE",
    "config": "CONFIG",
    **dict.fromkeys(("out", "resume", "folder", "save_map"), "DIR"),
    **dict.fromkeys(("seconds", "start_seconds"), "SECONDS"),
}
"""How options of these names are shown in the help; others by their type."""

REWORDED = (
    (r"^Error parsing [A-Z]\w*: (.*)$", r"\1"),
    (r"^Error parsing (\S+): no type matching FLOAT could .* from \[(.*)\]$", r"\1 takes a number, got \2"),
    (r"^Error parsing (\S+): no type matching INT could .* from \[(.*)\]$", r"\1 takes a whole number, got \2"),
    (r"^Error parsing (\S+): Could not find valid parse for arguments: \[(.*)\]$", r"\1 does not take \2"),
    (r"^Missing value for argument '(.*)'\. Expected .*$", r"\1 needs a value"),
)
"""What tyro says, and how we say it."""

RANGES = {
    **dict.fromkeys(("seed", "start", "stop", "frames"), (0, 2**31 - 1)),
    **dict.fromkeys(("scenes", "workers", "trials", "clips", "every"), (1, 10**6)),
    "seconds": (0, 1e7),
    **dict.fromkeys(("fps", "rate"), (0, 1e5)),
    "pictures": (0, 1000),
}
"""What a number may be, wherever an option of that name is; others are within 1e9 of 0."""


def parse(kind: type[Any], prog: str, arguments: Sequence[str]) -> Any:
    """The command with its options.

    Args:
        kind: a dataclass; its docstring is the help.
        prog: how it is called.
        arguments: without `--quiet`.

    Raises:
        InputError: arguments that cannot be used.
        SystemExit: after the help.
    """
    import tyro

    def default_text(default: str) -> str:
        return "" if default in ("None", "False", "", "''") or "(default" in default else f"(default: {default})"

    hints = get_type_hints(kind, include_extras=True)
    for field in dataclasses.fields(kind):
        shown = tyro.conf.arg(metavar=METAVARS.get(field.name), help_behavior_hint=default_text)
        kind.__annotations__[field.name] = Annotated[hints[field.name], shown]
    config = (tyro.conf.OmitArgPrefixes, tyro.conf.FlagCreatePairsOff, tyro.conf.DisallowNone)
    about, said = inspect.cleandoc(kind.__doc__ or ""), io.StringIO()
    try:
        with contextlib.redirect_stderr(said):
            command = tyro.cli(kind, prog=prog, description=f"{about}\n\n{EVERY}", args=arguments, config=config)
            if hasattr(command, "from_files"):  # what files say stands below what is said here
                pairs = (tyro.conf.OmitArgPrefixes, tyro.conf.DisallowNone)
                command = tyro.cli(kind, prog=prog, args=arguments, config=pairs, default=command.from_files())
            check_ranges(command)
            return command
    except SystemExit as end:
        if end.code != REFUSED:
            raise
    named = [field.name for field in dataclasses.fields(kind) if "Positional" not in str(field.type)]
    flags = [f"--{name.replace('_', '-')}" for name in named]
    raise InputError(in_a_line(said.getvalue(), prog, flags, arguments))


def check_ranges(command: Any) -> None:
    """Raise `InputError` for a number that no option of its name takes."""
    for field in dataclasses.fields(command):
        value = getattr(command, field.name)
        low, high = RANGES.get(field.name, (-1e9, 1e9))
        if isinstance(value, int | float) and not isinstance(value, bool) and not low <= value <= high:
            name = field.name.replace("_", "-")
            raise InputError(f"--{name} must be a number from {low:.10g} to {high:.10g}, got {value}")


def in_a_line(box: str, prog: str, flags: Sequence[str], arguments: Sequence[str]) -> str:
    """What tyro draws as a box of many lines, in one; with the flag or the choice that was probably meant."""
    # Where the terminal has no such characters, rules are of hyphens, and one stands under the title.
    rows = [row.strip("│╭╰╮╯ ").strip() for row in box.splitlines()][1:]
    rows = rows[1:] if rows and not rows[0].strip("-") else rows
    text = " ".join(itertools.takewhile(lambda row: row.strip("─-"), rows)).replace(" (required)", "").rstrip(".")
    for pattern, better in REWORDED:
        text = re.sub(pattern, better, text)
    if not text:
        return f"cannot be used: {' '.join(arguments)}"
    unknown = [word for word in arguments if word.startswith("--") and word.partition("=")[0] not in flags]
    choice = re.search(r"invalid choice '(.*)' for argument '(.*)'\. .* one of \((.*)\)", text)
    if choice is not None:
        known = sorted(set(re.findall(r"'([^']*)'", choice[3])) - {"None"})
        return f"{choice[2]} must be one of {', '.join(known)}, got {choice[1]!r}{did_you_mean(choice[1], known)}"
    hint = did_you_mean(unknown[0], flags) if unknown else ""
    return text[0].lower() + text[1:] + (hint or f"; see {prog} --help")
