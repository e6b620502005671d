"""Compiled code that is kept between runs, and looked at before it is loaded: it would run as the user."""

from __future__ import annotations

import hashlib
import os
import stat
from pathlib import Path

WRITABLE_BY_OTHERS = stat.S_IWGRP | stat.S_IWOTH


class UnusableFolder(Exception):
    """Nothing can be kept in a folder; the message says why, in one line."""


def cache_folder() -> Path:
    """Where compiled libraries are kept: `ndtorch` in `$XDG_CACHE_HOME` or `~/.cache`.

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


class KeptCode:
    """Files of native code in a private folder, each named after what it is for and what is in it.

    `find` gives a file only when it is a plain file of this user's that nobody else can write, and its content is
    what its name says. Files that are not are removed.

    Args:
        folder: where; made where it is not there.

    Raises:
        UnusableFolder: nothing can be kept there.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = private_folder(folder)

    def find(self, name: str) -> tuple[Path | None, str]:
        """The file of this name, or None; and what was wrong with one that was there, or nothing."""
        wrong = ""
        for file in sorted(self.folder.glob(f"{name}-*.pt2")):
            trouble = distrust(file, file.stem.removeprefix(f"{name}-"))
            if not trouble:
                return file, ""
            wrong = f"{file} {trouble}"
            self.remove(file)
        return None, wrong

    def keep(self, name: str, made: Path) -> Path:
        """Take a file that was made in this folder's file system; moved, so that nobody ever sees half of it."""
        made.chmod(0o600)
        return made.replace(self.folder / f"{name}-{content_hash(made)}.pt2")

    @staticmethod
    def remove(file: Path) -> None:
        """Remove a file, if it is still there."""
        file.unlink(missing_ok=True)


def distrust(file: Path, wanted: str) -> str:
    """Why a file must not be loaded, or nothing.

    Args:
        wanted: hash of its content.
    """
    try:
        found = file.lstat()
        if not stat.S_ISREG(found.st_mode):
            return "is no plain file"
        if found.st_uid != os.getuid():
            return "belongs to another user"
        if found.st_mode & WRITABLE_BY_OTHERS:
            return "can be written by other users"
        return "" if content_hash(file) == wanted else "is damaged"
    except OSError as error:
        return f"cannot be read ({error.strerror})"


def content_hash(file: Path) -> str:
    """SHA-256 of what is in a file."""
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
