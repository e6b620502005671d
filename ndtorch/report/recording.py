"""Recordings for the rerun viewer: whether a file is whole, and how to close one on a full disk."""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any

from ndtorch.utils.packages import need

END, TAIL = b"RRF2FOOT", 64
"""What a file that was written to its end has in so many last bytes."""


def why_not_whole(path: Path) -> str | None:
    """What is wrong with a recording that was closed, in one line; None where it was written to its end.

    The writer of the SDK only logs what goes wrong: on a full disk it leaves half a file that no viewer opens.
    """
    try:
        with path.open("rb") as file:
            file.seek(max(0, path.stat().st_size - TAIL))
            whole = END in file.read()
    except OSError as error:
        return f"the recording {path} cannot be read: {error.strerror}"
    return None if whole else f"the recording {path} is not whole: the disk was full, or failed"


def end_stream(stream: Any, patience: float = 15.0) -> None:
    """Write what is waiting and close a stream; `why_not_whole` tells what could not be written.

    On a full disk the writer of the SDK ends by itself. Whatever waits for it then waits forever: a flush, closing the
    stream, and the end of the program. Such a stream is left as it is.
    """
    try:
        stream.flush(timeout_sec=patience)
    except RuntimeError:
        need("rerun", "a recording").unregister_shutdown()
        for kept in (stream, stream.inner):
            ctypes.pythonapi.Py_IncRef(ctypes.py_object(kept))  # never closed
        return
    stream.disconnect()
