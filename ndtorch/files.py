"""Files that are whole or not there: written beside, forced onto the disk, moved into place. It imports no torch."""

from __future__ import annotations

import contextlib
import os
import secrets
import time
from collections.abc import Iterator
from pathlib import Path

PART = "part-"
"""How the name of a file begins while it is written. It is not hidden: what a killed run leaves can be seen."""

LEFT_OVER = 3600.0
"""Seconds after which an unfinished file is left over, and goes when its file is written again."""


@contextlib.contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """A name beside a file to write to; what is written there takes the file's place when the block ends.

    Until then the old file stays, and it stays when the block raises. Two writers do not touch each other: the one
    that ends last is kept whole.

    Raises:
        OSError: the file cannot be written, forced onto the disk, or moved.
    """
    path = Path(path)
    drop_leftovers(path)
    # The end of the name stays, since some writers look at it.
    beside = path.with_name(f"{PART}{secrets.token_hex(4)}-{path.name}")
    try:
        yield beside
        sync(beside)
        beside.replace(path)
        sync(path.parent)
    except OSError as error:
        # On a full disk it is a write that fails, and that knows no name.
        with contextlib.suppress(AttributeError):  # PyAV's cannot be told one
            error.filename = error.filename or str(path)
        raise
    finally:
        beside.unlink(missing_ok=True)


def write_text(path: str | Path, text: str) -> None:
    """Write a text file in UTF-8, whole or not at all.

    Raises:
        OSError: it cannot be written.
    """
    with replacing(path) as beside:
        beside.write_text(text, encoding="utf-8")


def sync(path: Path) -> None:
    """Force a file, or the names in a folder, onto the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    except OSError:
        # Some file systems cannot do it for folders; a file that cannot be forced may be lost.
        if not path.is_dir():
            raise
    finally:
        os.close(handle)


def drop_leftovers(path: Path) -> None:
    """Remove what killed writers of this file have left."""
    with contextlib.suppress(OSError):
        for old in path.parent.glob(f"{PART}????????-{glob_escape(path.name)}"):
            if time.time() - old.stat().st_mtime > LEFT_OVER:
                old.unlink(missing_ok=True)


def glob_escape(name: str) -> str:
    """A name that stands for itself alone in a pattern."""
    return "".join(f"[{c}]" if c in "*?[" else c for c in name)
