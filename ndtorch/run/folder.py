"""The folder of a run: a new one for every run, and its files all together or not at all. It imports no torch."""

from __future__ import annotations

import contextlib
import shutil
import tempfile
from itertools import count
from pathlib import Path

from ndtorch.errors import InputError
from ndtorch.utils.files import readable, sync

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
        wanted = wanted if wanted.name not in ("", "..") else wanted.resolve()
        for number in count(1):
            folder = wanted if number == 1 else wanted.with_name(f"{wanted.name}-{number}")
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


def new_file(file: Path, force: bool = False) -> None:
    """Refuse a file that was named for a result and is there already, unless `force`."""
    if file.exists() and not force:
        raise InputError(f"{file} exists; --force replaces it")


def make_writable(folder: Path) -> None:
    """Make a folder and write a little in it, before any time is spent; raises `InputError` where that fails."""
    if readable(str(folder)) != str(folder):
        raise InputError(f"--out {folder}: a name that is not UTF-8")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(b"0" * 4096)
            file.flush()
    except OSError as error:
        raise InputError(f"--out {folder}: cannot write there ({error.strerror})") from None
