"""A folder for compiled code, which runs as the user: nobody else may enter it."""

from __future__ import annotations

import fcntl
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


class UnusableFolder(Exception):
    """Nothing can be kept in a folder; the message says why, in one line."""


def cache_folder() -> Path:
    """Where compiled code is kept: `ndtorch` in `$XDG_CACHE_HOME` or `~/.cache`.

    Raises:
        UnusableFolder: there is no home.
    """
    given = os.environ.get("XDG_CACHE_HOME")
    try:
        return Path(given or Path.home() / ".cache") / "ndtorch"
    except RuntimeError:
        raise UnusableFolder("there is no home folder: set HOME or XDG_CACHE_HOME") from None


def private_folder(folder: Path) -> Path:
    """Make a folder that only its owner can enter, or make one so.

    Raises:
        UnusableFolder: it cannot be made, belongs to somebody else, or cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        found = folder.stat()
        if found.st_uid != os.getuid():
            raise UnusableFolder(f"{folder} belongs to another user")
        if stat.S_IMODE(found.st_mode) != 0o700:
            folder.chmod(0o700)
    except OSError as error:
        raise UnusableFolder(f"{folder} cannot be used ({error.strerror})") from None
    if not os.access(folder, os.R_OK | os.W_OK | os.X_OK):
        raise UnusableFolder(f"{folder} cannot be read and written")
    return folder


@contextmanager
def locked(folder: Path | None) -> Iterator[None]:
    """Alone in a folder, among processes that ask for the same."""
    if folder is None:
        yield
        return
    with (folder / "lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield
