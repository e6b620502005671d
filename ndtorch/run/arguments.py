"""From a command's class to its options on the command line."""

from __future__ import annotations

import contextlib
import dataclasses
import io
import itertools
import re
from collections.abc import Callable, Sequence
from typing import Annotated, Any, TypeVar, get_type_hints

from ndtorch.errors import InputError, did_you_mean

Kind = TypeVar("Kind", bound=type)

QUIET = ("-q", "--quiet")
"""Flags that every command knows."""

EVERY = "Every command takes --quiet (-q): it prints nothing but errors, and the answer of --json."

REFUSED = 2
"""The exit code with which tyro refuses arguments."""

PLAINLY = (
    (
        r"^Error parsing (\S+): no type matching FLOAT could be instantiated from \[(.*)\]$",
        r"\1 takes a number, got \2",
    ),
    (r"^Error parsing (\S+): no type matching INT could .* from \[(.*)\]$", r"\1 takes a whole number, got \2"),
    (r"^Error parsing (\S+): Could not find valid parse for arguments: \[(.*)\]$", r"\1 does not take \2"),
    (r"^Missing value for argument '(.*)'\. Expected .*$", r"\1 needs a value"),
)
"""What tyro says, and how we say it."""

RANGES = {
    **dict.fromkeys(("seed", "start", "stop"), (0, 2**31 - 1)),
    **dict.fromkeys(("scenes", "workers", "trials", "clips"), (1, 10**6)),
    **dict.fromkeys(("seconds", "settle"), (0, 1e7)),
    "fps": (0, 1e5),
}
"""What a number may be, wherever an option of that name is."""

HUGEST = 1e9
"""No other number of an option is further from 0."""

UNSAID = ("None", "False", "")
"""Defaults that say nothing: the words before say what happens where an option is not given."""


def choices(**words: Sequence[str]) -> Callable[[Kind], Kind]:
    """Class decorator, under `dataclass`: the help shows what an option takes, `--rule {competitive,hebbian}`.

    What is given is checked where it is used, with one line that names the option.
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
        kind: a dataclass; its docstring is the help.
        prog: how it is called.
        arguments: without `--quiet`.

    Raises:
        InputError: arguments that cannot be used.
        SystemExit: after the help.
    """
    import tyro

    hints = get_type_hints(kind, include_extras=True)
    hide = tyro.conf.arg(help_behavior_hint=lambda default: "" if default in UNSAID else f"(default: {default})")
    for field in dataclasses.fields(kind):
        kind.__annotations__[field.name] = Annotated[hints[field.name], hide]
    config = (tyro.conf.OmitArgPrefixes, tyro.conf.FlagCreatePairsOff, tyro.conf.DisallowNone)
    told = io.StringIO()
    try:
        with contextlib.redirect_stderr(told):
            found = tyro.cli(kind, prog=prog, description=f"{kind.__doc__}\n\n{EVERY}", args=arguments, config=config)
            check_ranges(found)
            return found
    except SystemExit as end:
        if end.code != REFUSED:
            raise
    raise InputError(in_a_line(told.getvalue(), prog, flags_of(kind), arguments))


def check_ranges(command: Any) -> None:
    """Raise `InputError` for a number that no option of its name takes."""
    for field in dataclasses.fields(command):
        value = getattr(command, field.name)
        low, high = RANGES.get(field.name, (-HUGEST, HUGEST))
        if isinstance(value, int | float) and not isinstance(value, bool) and not low <= value <= high:
            raise InputError(
                f"--{field.name.replace('_', '-')} must be a number from {low:.10g} to {high:.10g}, got {value}"
            )


def flags_of(kind: type[Any]) -> list[str]:
    """The flags of a command."""
    named = [field.name for field in dataclasses.fields(kind) if "Positional" not in str(field.type)]
    return [f"--{name.replace('_', '-')}" for name in named]


def in_a_line(box: str, prog: str, flags: Sequence[str], arguments: Sequence[str]) -> str:
    """What tyro draws as a box of many lines, in one; with the flag or the choice that was probably meant."""
    # Where the terminal has no such characters, rules are of hyphens, and one stands under the title.
    rows = [row.strip("│╭╰╮╯ ").strip() for row in box.splitlines()][1:]
    rows = rows[1:] if rows and not rows[0].strip("-") else rows
    about = itertools.takewhile(lambda row: row.strip("─-"), rows)
    words = " ".join(about).replace(" (required)", "").rstrip(".")
    for pattern, better in PLAINLY:
        words = re.sub(pattern, better, words)
    if not words:
        return f"cannot be used: {' '.join(arguments)}"
    given = [word for word in arguments if word.startswith("--") and word.partition("=")[0] not in flags]
    hint = did_you_mean(given[0], flags) if given else ""
    choice = re.search(r"invalid choice '(.*)' for argument '(.*)'\. .* one of \((.*)\)", words)
    if choice is not None:
        known = sorted(set(re.findall(r"'([^']*)'", choice[3])) - {"None"})
        return f"{choice[2]} must be one of {', '.join(known)}, got {choice[1]!r}{did_you_mean(choice[1], known)}"
    return words[0].lower() + words[1:] + (hint or f"; see {prog} --help")
