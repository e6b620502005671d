"""Errors that a user can mend, in one line, and what was probably meant."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class InputError(ValueError):
    """An argument, file or option that cannot be used.

    The message is one line that names the argument, what was given and what is wanted.
    The command lines print it and exit with code 2.
    """

    def __init__(self, *words: object) -> None:
        # Arrays and errors of libraries print as several lines.
        super().__init__(*(" ".join(str(word).split()) if "\n" in str(word) else word for word in words))


LONGEST = 80
"""Characters of a name that are looked at: the time grows with the square of them."""


def did_you_mean(given: object, known: Iterable[str], cutoff: float = 0.6) -> str:
    """`"; did you mean hallway?"` to end a message with; nothing where no name is near."""
    near = difflib.get_close_matches(str(given)[:LONGEST], list(known), 1, cutoff)
    return f"; did you mean {near[0]}?" if near else ""
