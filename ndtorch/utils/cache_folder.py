"""A folder for compiled code, which runs as the user: nobody else may enter it."""

from __future__ import annotations

import fcntl
import logging
import os
import shutil
import stat
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ndtorch.utils.files import hold

log = logging.getLogger("ndtorch.jit")

STALE = 30 * 86400
"""Seconds after which a folder that nobody has used may go."""


class UnusableFolder(Exception):
    """Nothing can be kept in a folder; the message says why, in one line."""


def cache_folder() -> Path:
    """Where compiled code is kept: `ndtorch` in `$XDG_CACHE_HOME` or `~/.cache`."""
    given = os.environ.get("XDG_CACHE_HOME")
    try:
        return Path(given or Path.home() / ".cache") / "ndtorch"
    except RuntimeError:
        raise UnusableFolder("there is no home folder: set HOME or XDG_CACHE_HOME") from None


def private_folder(folder: Path) -> Path:
    """Make a folder that only its owner can enter, or make one so."""
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


def remove_stale(folder: Path, pattern: str) -> list[Path]:
    """Delete the other folders beside one that nobody has used for `STALE` seconds, and say which.

    A folder that is `locked` now is left alone. Whoever still needs one that is gone makes it anew.
    """
    gone = []
    for other in folder.parent.glob(pattern):
        lock = other / "lock"
        try:
            if other == folder or other.is_symlink() or time.time() - lock.stat().st_mtime < STALE:
                continue
            with lock.open() as file:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(other, ignore_errors=True)
        except OSError:  # in use, without a lock, or not ours
            continue
        gone.append(other)
    return gone


def own_files(folder: Path) -> list[Path]:
    """Files of compiled code below a folder. One of another owner, or that others may write, is deleted unread."""
    found = []
    for path in folder.rglob("*"):
        state = path.lstat()
        if stat.S_ISDIR(state.st_mode) or path.suffix == ".lock" or path.name == "lock":
            continue
        if state.st_uid != os.getuid() or state.st_mode & 0o022 or not stat.S_ISREG(state.st_mode):
            path.unlink(missing_ok=True)
        else:
            found.append(path)
    return found


@contextmanager
def locked(folder: Path | None, part: str | None = None) -> Iterator[None]:
    """Alone in a folder, or with a part of it, among processes that ask for the same."""
    if folder is None:
        yield
        return
    private_folder(folder)
    with (folder / "lock").open("w") as file:
        os.utime(file.fileno())
        if part is None:
            fcntl.flock(file, fcntl.LOCK_EX)
            yield
            return
        fcntl.flock(file, fcntl.LOCK_SH)
        path = folder / f"{part}.lock"
        with path.open("w") as own:
            hold(own, lambda: log.info("waits for another process that compiles, which holds %s", path))
            yield
