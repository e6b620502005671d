"""How far a command is, for whoever sits before it."""

from __future__ import annotations

import logging
import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tqdm import tqdm


def progress_bar(total: float | None, quiet: bool = False, **options: Any) -> tqdm[Any]:
    """A bar on stderr. Where stderr is no terminal there is none: in a log every step of it would be a line."""
    from tqdm import tqdm

    # `--quiet` is a level of the log.
    shown = not quiet and sys.stderr.isatty() and logging.getLogger("ndtorch").isEnabledFor(logging.INFO)
    return tqdm(total=total, disable=not shown, file=sys.stderr, **options)
