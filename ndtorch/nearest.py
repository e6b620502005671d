"""A name that is not known, and the one that was probably meant."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def meant(given: object, known: Iterable[str], cutoff: float = 0.6) -> str:
    """`"; did you mean hallway?"` to end a message with; nothing where no name is near.

    Args:
        given: what the user wrote.
        known: names there are.
        cutoff: how like they must be, 0..1.
    """
    near = difflib.get_close_matches(str(given), list(known), 1, cutoff)
    return f"; did you mean {near[0]}?" if near else ""
