"""How far a command is, for whoever sits before it."""

from __future__ import annotations

import logging
import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tqdm import tqdm


log = logging.getLogger("ndtorch.run")

QUICK = 200.0
"""Frames a second of a quick model on a quick computer."""


def tell_if_long(frames: float | None) -> None:
    """Say so first where a run will take longer than a day, at `QUICK` frames a second."""
    days = (frames or 0) / QUICK / 86400
    if days > 1:
        log.info("%.3g frames: this takes longer than %.3g days even at %g frames a second", frames, days, QUICK)


def progress_bar(total: float | None, quiet: bool = False, **options: Any) -> tqdm[Any]:
    """A bar on stderr. Where stderr is no terminal there is none: in a log every step of it would be a line."""
    from tqdm import tqdm

    # `--quiet` is a level of the log.
    shown = not quiet and sys.stderr.isatty() and logging.getLogger("ndtorch").isEnabledFor(logging.INFO)
    return tqdm(total=total, disable=not shown, file=sys.stderr, **options)
