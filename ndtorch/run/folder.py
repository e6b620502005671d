"""The folder of a run: a new one for every run, and its files all together or not at all. It imports no torch."""

from __future__ import annotations

import contextlib
import errno
import json
import shutil
import tempfile
from collections.abc import Mapping
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

from ndtorch.errors import InputError
from ndtorch.utils.files import TABLE_BYTES, read_text, sync, write_text

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
        self._parents: list[Path] = []
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
        # A publish may claim again: what was made the first time is there then.
        self._parents += [parent for parent in wanted.parents if not parent.exists()]
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
        """Move everything in; returns the files. A run that was not `whole` never replaces files of an earlier one."""
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
        """Drop what was written, and the folders if they were made for this run and nothing else came in."""
        shutil.rmtree(self.work, ignore_errors=True)
        for made in [self.final, *self._parents] if self._made else self._parents:
            with contextlib.suppress(OSError):
                made.rmdir()


SETTINGS = "settings.json"
"""What the results of a folder are of: a run with the same settings goes on there, any other leaves it alone."""


class Place(NamedTuple):
    """Where a command writes that goes on where it was.

    Attributes:
        folder: it is of one set of settings.
        before: the last folder of other settings, whose parts may be of use; None where there is none.
    """

    folder: Path
    before: Path | None

    def take_over(self, name: str) -> None:
        """Begin with a copy of that folder in the one before. Its files must be named by what they are of."""
        if self.before is not None and (self.before / name).is_dir():
            shutil.copytree(self.before / name, self.folder / name, dirs_exist_ok=True)


def place_for(wanted: Path, settings: Mapping[str, Any], fresh: bool = False, force: bool = False) -> Place:
    """The folder of the run with these settings, options and code, if there was one; else the next that is free:
    `maps`, `maps-2`. `fresh`: nothing of earlier runs is used; `force`: this folder, whatever is in it.
    """
    text = json.dumps(settings, sort_keys=True, indent=1, default=str) + "\n"
    wanted = wanted if wanted.name not in ("", "..") else wanted.resolve()
    before: Path | None = None
    for number in count(1):
        folder = wanted if number == 1 else wanted.with_name(f"{wanted.name}-{number}")
        prepare(folder)
        mark = folder / SETTINGS
        found = read_text(mark, TABLE_BYTES) if mark.is_file() else None
        if force:
            write_text(mark, text)
            break
        if found == text and not fresh:
            break
        if found is None and not any(folder.iterdir()):
            # For one of two processes that begin at once.
            with contextlib.suppress(FileExistsError), mark.open("x", encoding="utf-8") as file:
                file.write(text)
                break
        before = before if found is None or fresh else folder
    return Place(folder, None if found == text else before)


def new_file(file: Path, force: bool = False) -> None:
    """Refuse a file that was named for a result and is there already, unless `force`."""
    if file.exists() and not force:
        raise InputError(f"{file} exists; --force replaces it")


def prepare(folder: Path) -> None:
    """Make a folder and see that files can be written in it. Raises `InputError`: it cannot be made or written to."""
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
