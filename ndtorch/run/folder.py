"""The folder of a run: a new one for every run, and its files all together or not at all. It imports no torch."""

from __future__ import annotations

import contextlib
import json
import shutil
import tempfile
from collections.abc import Iterator, Mapping
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

    Args:
        wanted: the folder.
        force: take this folder whatever is in it; files of the same names are replaced, others stay.

    Attributes:
        final: where the results will be.
        work: where to write them.

    Raises:
        InputError: it cannot be made or written to.
    """

    def __init__(self, wanted: Path, force: bool = False) -> None:
        self.parents = [parent for parent in wanted.parents if not parent.exists()]
        for folder in candidates(wanted):
            make_writable(folder)
            self.final, self.work = folder, folder / UNFINISHED
            if force:
                self.work = Path(tempfile.mkdtemp(prefix=f"{UNFINISHED}-", dir=folder))
                return
            # Making it succeeds for one of two processes only.
            with contextlib.suppress(FileExistsError):
                if not any(folder.iterdir()):
                    self.work.mkdir()
                    return

    def publish(self) -> list[Path]:
        """Move everything in; returns the files."""
        files = sorted(self.work.iterdir())
        for file in files:
            sync(file)
        moved = [file.replace(self.final / file.name) for file in files]
        sync(self.final)
        self.work.rmdir()
        return moved

    def discard(self) -> None:
        """Drop what was written, and the folders that were made for it and are empty."""
        shutil.rmtree(self.work, ignore_errors=True)
        for made in (self.final, *self.parents):
            with contextlib.suppress(OSError):
                made.rmdir()


def candidates(wanted: Path) -> Iterator[Path]:
    """`maps`, `maps-2`, `maps-3`, ..."""
    wanted = wanted if wanted.name not in ("", "..") else wanted.resolve()
    yield wanted
    for number in count(2):
        yield wanted.with_name(f"{wanted.name}-{number}")


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


def place_for(wanted: Path, settings: Mapping[str, Any], force: bool = False) -> Place:
    """The folder of the run with these settings, options and code, if there was one; else the next that is free.

    With `force`, this folder, whatever is in it.
    """
    text = json.dumps(settings, sort_keys=True, indent=1, default=str) + "\n"
    before: Path | None = None
    for folder in candidates(wanted):
        make_writable(folder)
        mark = folder / SETTINGS
        kept = read_text(mark, TABLE_BYTES) if mark.is_file() else None
        if force:
            write_text(mark, text)
            return Place(folder, None if kept == text else before)
        if kept == text:
            return Place(folder, None)
        if kept is None and not any(folder.iterdir()):
            # For one of two processes that begin at once.
            with contextlib.suppress(FileExistsError), mark.open("x", encoding="utf-8") as file:
                file.write(text)
                return Place(folder, before)
        before = before if kept is None else folder
    raise AssertionError


def new_file(file: Path, force: bool = False) -> None:
    """Refuse a file that was named for a result and is there already, unless `force`."""
    if file.exists() and not force:
        raise InputError(f"{file} exists; --force replaces it")


def make_writable(folder: Path) -> None:
    """Make a folder and write a little in it, before any time is spent; raises `InputError` where that fails."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(b"0" * 4096)
            file.flush()
    except OSError as error:
        raise InputError(f"--out {folder}: cannot write there ({error.strerror})") from None
