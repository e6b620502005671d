"""The folder that a command writes to."""

from __future__ import annotations

import tempfile
from pathlib import Path

from ndtorch.errors import InputError


def prepare(folder: Path) -> None:
    """Make the folder and see that files can be written, before any time is spent.

    Raises:
        InputError: it cannot be made or written to.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(b"0" * 4096)
            file.flush()
    except OSError as error:
        raise InputError(f"--out {folder}: cannot write there ({error.strerror})") from None
