"""The folder of a run: a new one for every run, and its files all together or not at all. It imports no torch."""

from __future__ import annotations

import contextlib
import errno
import shutil
import tempfile
from itertools import count
from pathlib import Path

from ndtorch.errors import InputError
from ndtorch.files import sync

UNFINISHED = "unfinished"
"""Where files are until a run has ended. It is no hidden name: what a killed run leaves can be seen."""


class RunFolder:
    """A folder for the results of one run; no other run touches it.

    If the wanted folder has anything in it, the run gets the next that is free: `two-bars`, `two-bars-2`. Two runs
    that begin at once get two folders. Files are written into `work` and moved in by `publish`.

    Attributes:
        final: where the results will be. With `force` and an unfinished run this may change in `publish`.
        work: where to write them.

    Args:
        wanted: the folder.
        force: take this folder whatever is in it; files of the same names are replaced, others stay.

    Raises:
        InputError: it cannot be made or written to.
    """

    def __init__(self, wanted: Path, force: bool = False) -> None:
        self._wanted, self._made = wanted, False
        try:
            if force and wanted.is_dir():
                self.final = wanted
                self.work = Path(tempfile.mkdtemp(prefix=f"{UNFINISHED}-", dir=wanted))
            else:
                self._claim()
            try_writing(self.work)
        except OSError as error:
            with contextlib.suppress(AttributeError):
                self.discard()
            raise InputError(f"--out {wanted}: cannot write there ({error.strerror})") from None

    def _claim(self) -> None:
        """Take the first folder that is free. Making `unfinished` in it succeeds for one process only."""
        # `.` and `..` have no name to put a number after.
        wanted = self._wanted if self._wanted.name not in ("", "..") else self._wanted.resolve()
        wanted.parent.mkdir(parents=True, exist_ok=True)
        for number in count(1):
            self.final = wanted if number == 1 else wanted.with_name(f"{wanted.name}-{number}")
            self.work = self.final / UNFINISHED
            try:
                self.final.mkdir()
                self._made = True
            except FileExistsError:
                self._made = False
                if not self.final.is_dir() and number == 1:
                    raise NotADirectoryError(errno.ENOTDIR, "it is a file") from None
                if not self.final.is_dir() or any(self.final.iterdir()):
                    continue
            with contextlib.suppress(FileExistsError):
                self.work.mkdir()
                return

    def publish(self, whole: bool = True) -> list[Path]:
        """Move everything in; returns the files.

        Args:
            whole: the run ended by itself. One that did not never replaces files of an earlier one: with `force` it
                goes to the next folder that is free.
        """
        files = sorted(self.work.iterdir())
        if not whole and any((self.final / file.name).exists() for file in files):
            old = self.work
            self._claim()
            for file in files:
                shutil.move(file, self.work / file.name)
            old.rmdir()
            files = sorted(self.work.iterdir())
        for file in files:
            sync(file)
        moved = [file.replace(self.final / file.name) for file in files]
        sync(self.final)
        self.work.rmdir()
        return moved

    def discard(self) -> None:
        """Drop what was written, and the folder if it was made for this run."""
        shutil.rmtree(self.work, ignore_errors=True)
        if self._made:
            with contextlib.suppress(OSError):
                self.final.rmdir()


def new_file(file: Path, force: bool = False) -> None:
    """See that a file that was named for a result is not there yet.

    Args:
        force: it may be there.

    Raises:
        InputError: it is there, and is not to be replaced.
    """
    if file.exists() and not force:
        raise InputError(f"{file} exists; --force replaces it")


def prepare(folder: Path) -> None:
    """Make a folder that a command goes on in when it is started again, and see that files can be written.

    Raises:
        InputError: it cannot be made or written to.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        try_writing(folder)
    except OSError as error:
        raise InputError(f"--out {folder}: cannot write there ({error.strerror})") from None


def try_writing(folder: Path) -> None:
    """Write a little, before any time is spent: on a full disk folders can be made, and files cannot be written."""
    with tempfile.TemporaryFile(dir=folder) as file:
        file.write(b"0" * 4096)
        file.flush()
