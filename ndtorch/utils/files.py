"""Reading and writing files: whole or not at all, with checksums, locked against other processes."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import hashlib
import json
import math
import os
import re
import secrets
import stat
import struct
import time
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ndtorch.errors import InputError

if TYPE_CHECKING:
    from torch import Tensor

PART = "part-"
"""How the name of a file begins while it is written. It is not hidden: what a killed run leaves can be seen."""

LEFT_OVER = 3600.0
"""Seconds after which an unfinished file is left over, and goes when its file is written again."""


@contextlib.contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """A name beside a file to write to; what is written there takes the file's place when the block ends.

    Until then the old file stays, and it stays when the block raises. Two writers do not touch each other: the one that
    ends last is kept whole.
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
    """Write a text file in UTF-8, whole or not at all. Raises `OSError`: it cannot be written."""
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


TEXT_BYTES = 1 << 18
"""Most bytes of a configuration, a header, or another text that a person could have written."""

TABLE_BYTES = 1 << 26
"""Most bytes of a text that programs write: results, labels, worlds."""

ARRAY_BYTES = 1 << 30
"""Most bytes of a file of arrays or tensors."""

DECLARED_BYTES = 1 << 29
"""Most bytes of all arrays of a compressed file together, by their own headers."""

MEMBERS = 4096
"""Most arrays of a compressed file."""


def open_regular(path: str | Path, most: int) -> IO[bytes]:
    """Open a regular file of at most so many bytes for reading: pipes and devices are never waited for."""
    number = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOCTTY)
    found, wrong = os.fstat(number), ""
    if not stat.S_ISREG(found.st_mode):
        wrong = "is no regular file"
    elif found.st_size > most:
        wrong = f"has {found.st_size} bytes; {most} are the most"
    if wrong:
        os.close(number)
        raise InputError(f"{path} {wrong}")
    return os.fdopen(number, "rb")


def read_bytes(path: str | Path, most: int = ARRAY_BYTES) -> bytes:
    """A whole file, see `open_regular`."""
    with open_regular(path, most) as file:
        data = file.read(most + 1)
    if len(data) > most:  # it grew, or the system makes it up as it is read
        raise InputError(f"{path} has more than {most} bytes")
    return data


def read_text(path: str | Path, most: int = TEXT_BYTES) -> str:
    """A whole file of text in UTF-8, see `open_regular`; raises `UnicodeDecodeError` for another one."""
    return read_bytes(path, most).decode()


PATIENCE = 10.0
"""Seconds after which whoever waits is told so."""


def hold(file: IO[str], tell: Callable[[], None], patience: float = PATIENCE) -> None:
    """Wait until no other process holds the file, and hold it until it is closed; `tell` is called after `patience` s.

    A process that dies lets go; one that was stopped does not, so that somebody may wait for ever.
    """
    ends = time.monotonic() + patience
    while time.monotonic() < ends:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return
        except BlockingIOError:
            time.sleep(0.02)
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        tell()
        fcntl.flock(file, fcntl.LOCK_EX)


Arrays = Mapping[str, npt.NDArray[Any]]

UNREADABLE = (
    OSError,
    ValueError,
    KeyError,
    EOFError,
    SyntaxError,
    RuntimeError,
    MemoryError,
    OverflowError,
    zipfile.BadZipFile,
    zlib.error,
    struct.error,
)
"""What a damaged archive raises in NumPy and below: names, sizes and headers are read before any checksum is."""

CHECKSUM = "checksum"
"""The name under which it stands beside the arrays."""


def checksum(flat: Mapping[str, Tensor], about: Mapping[str, str]) -> str:
    """SHA-256 over names, types, shapes, values and strings."""
    import torch

    digest = hashlib.sha256(json.dumps(sorted(about.items())).encode())
    for name in sorted(flat):
        # A single number may have any stride, which `contiguous` leaves as it is and `view` refuses.
        part = flat[name].detach().cpu().clone(memory_format=torch.contiguous_format)
        digest.update(f"{name} {part.dtype} {list(part.shape)}".encode())
        digest.update(part.reshape(-1).view(torch.uint8).numpy().tobytes())
    return digest.hexdigest()


def save_tensors(flat: Mapping[str, Tensor], path: str | Path, about: Mapping[str, str] | None = None) -> None:
    """Write tensors by name as safetensors, with strings and a checksum over both.

    A file that was there stays until the new one is whole.
    """
    from safetensors import SafetensorError
    from safetensors.torch import save_file

    strings = dict(about or {})
    try:
        with replacing(path) as beside:
            save_file(dict(flat), str(beside), metadata=strings | {CHECKSUM: checksum(flat, strings)})
    except SafetensorError as error:
        # Which error of the system it was stands in the words alone.
        found = re.search(r"os error (\d+)", str(error))
        number = int(found[1]) if found else errno.EIO
        raise OSError(number, os.strerror(number), str(path)) from None


def read_tensors(path: str | Path, what: str) -> tuple[dict[str, Tensor], dict[str, str]]:
    """Tensors and strings that `save_tensors` wrote; `what` names the file in an `InputError`: "a saved state"."""
    from safetensors import SafetensorError, safe_open

    try:
        # Its reader maps the file and checks its header against its length: nothing larger is allocated.
        with open_regular(path, ARRAY_BYTES), safe_open(str(path), framework="pt") as file:
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
            about = dict(file.metadata() or {})
    except FileNotFoundError:
        raise InputError(f"{path} is missing") from None
    except (SafetensorError, OSError) as error:
        raise InputError(f"{path} is not {what}: {error}") from None
    except InputError:
        raise
    except (ValueError, OverflowError, RuntimeError, MemoryError) as error:
        raise InputError(f"{path} is damaged: {str(error).splitlines()[0]}") from None
    given = about.pop(CHECKSUM, None)
    if given is None:
        raise InputError(f"{path} has no checksum: it was not written by this version of ndtorch")
    if given != checksum(tensors, about):
        raise InputError(f"{path} is damaged: its checksum does not fit")
    return tensors, about


def save_arrays(path: str | Path, arrays: Arrays) -> None:
    """Write NumPy arrays by name as a compressed `.npz` that `numpy.load` reads too, with a checksum beside them."""
    named: dict[str, Any] = {**arrays, CHECKSUM: np.array(digest_of(arrays))}
    with replacing(path) as beside, beside.open("wb") as out:  # a name would be given another ending
        np.savez_compressed(out, **named)


def load_arrays(path: str | Path) -> dict[str, npt.NDArray[Any]]:
    """What `save_arrays` wrote."""
    try:
        with open_regular(path, ARRAY_BYTES) as opened:
            check_declared(path, opened)
            with np.load(opened, allow_pickle=False) as file:
                arrays = {name: file[name] for name in file.files}
    except FileNotFoundError:
        raise InputError(f"{path} is missing") from None
    except InputError:
        raise
    except UNREADABLE as error:
        raise InputError(f"{path} is no .npz file, or damaged ({type(error).__name__})") from None
    given = arrays.pop(CHECKSUM, None)
    if given is None:
        raise InputError(f"{path} has no checksum: it was not written by this version of ndtorch")
    if str(given) != digest_of(arrays):
        raise InputError(f"{path} is damaged: its checksum does not fit")
    return arrays


def check_declared(path: str | Path, opened: IO[bytes]) -> None:
    """Raise `InputError` where the arrays of a `.npz` file are too many or too large by their headers.

    A few bytes of a compressed file may stand for gigabytes, which would be allocated before any checksum is known.
    """
    total = 0
    with zipfile.ZipFile(opened) as archive:
        members = archive.infolist()
        for member in members[:MEMBERS]:
            with archive.open(member) as array:
                version = np.lib.format.read_magic(array)
                header = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
                shape, _, kind = header[version](array)
            total += math.prod(shape) * kind.itemsize
    if len(members) > MEMBERS or not 0 <= total <= DECLARED_BYTES:
        raise InputError(
            f"{path} declares {len(members)} arrays of {total} bytes; {MEMBERS} of {DECLARED_BYTES} are the most"
        )
    opened.seek(0)


def digest_of(arrays: Arrays) -> str:
    """SHA-256 over names, types, shapes and values."""
    digest = hashlib.sha256()
    for name in sorted(arrays):
        array = np.asarray(arrays[name])
        digest.update(f"{name} {array.dtype.str} {list(array.shape)}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
