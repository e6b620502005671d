"""Reading and writing files: whole or not at all, with checksums, and never more than a file may hold."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import secrets
import stat
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ndtorch.errors import InputError

if TYPE_CHECKING:
    from torch import Tensor

PART = "part-"
"""How the name of a file begins while it is written. It is not hidden: what a killed run leaves can be seen."""

TEXT_BYTES = 1 << 18
"""Most bytes of a configuration, a header, or another text that a person could have written."""
TABLE_BYTES = 1 << 26
"""Most bytes of a text that programs write: results, labels, worlds."""
ARRAY_BYTES = 1 << 30
"""Most bytes of a file of arrays or tensors."""
CHECKSUM = "checksum"
"""The name under which it stands beside the tensors."""

Arrays = Mapping[str, npt.NDArray[Any]]


@contextlib.contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """A name beside a file to write to; what is written there takes the file's place when the block ends.

    Until then the old file stays, and it stays when the block raises. Two writers do not touch each other: the one that
    ends last is kept whole.
    """
    path = Path(path)
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
        beside.write_text(text, encoding="utf-8", errors="backslashreplace")  # names of files are any bytes


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


def open_regular(path: str | Path, most: int) -> IO[bytes]:
    """Open a regular file of at most so many bytes for reading: pipes and devices are never waited for."""
    number = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOCTTY)
    state = os.fstat(number)
    if stat.S_ISREG(state.st_mode) and state.st_size <= most:
        return os.fdopen(number, "rb")
    os.close(number)
    size = f"has {state.st_size} bytes; {most} are the most"
    raise InputError(f"{path} {size if stat.S_ISREG(state.st_mode) else 'is no regular file'}")


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


def readable(name: str) -> str:
    """A file name as text: bytes that are no UTF-8 are replaced."""
    return os.fsencode(name).decode(errors="replace")


def tensor_digest(tensors: Mapping[str, Tensor], about: Mapping[str, str]) -> str:
    """SHA-256 over names, types, shapes and values of tensors, and over strings."""
    import torch

    digest = hashlib.sha256(json.dumps(sorted(about.items())).encode())
    for name in sorted(tensors):
        # A single number may have any stride, which `contiguous` leaves as it is and `view` refuses.
        part = tensors[name].detach().cpu().clone(memory_format=torch.contiguous_format)
        digest.update(f"{name} {part.dtype} {list(part.shape)}".encode())
        digest.update(part.reshape(-1).view(torch.uint8).numpy().tobytes())
    return digest.hexdigest()


def save_tensors(tensors: Mapping[str, Tensor], path: str | Path, about: Mapping[str, str] | None = None) -> None:
    """Write tensors by name as safetensors, with strings and a checksum over both.

    A file that was there stays until the new one is whole.
    """
    from safetensors.torch import save

    strings = dict(about or {})
    data = save(dict(tensors), metadata=strings | {CHECKSUM: tensor_digest(tensors, strings)})
    with replacing(path) as beside:
        beside.write_bytes(data)


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
    except InputError:
        raise
    except (SafetensorError, OSError, ValueError, OverflowError, RuntimeError, MemoryError) as error:
        raise InputError(f"{path} is not {what}: {str(error).splitlines()[0]}") from None
    kept = about.pop(CHECKSUM, None)
    if kept is None:
        raise InputError(f"{path} has no checksum: it was not written by this version of ndtorch")
    if kept != tensor_digest(tensors, about):
        raise InputError(f"{path} is damaged: its checksum does not fit")
    return tensors, about


def save_arrays(path: str | Path, arrays: Arrays) -> None:
    """Write NumPy arrays by name as a compressed `.npz`, which has a CRC-32 of each."""
    with replacing(path) as beside, beside.open("wb") as out:  # a name would be given another ending
        np.savez_compressed(out, **arrays)  # type: ignore[arg-type]


def load_arrays(path: str | Path) -> dict[str, npt.NDArray[Any]]:
    """What `save_arrays` wrote."""
    try:
        with open_regular(path, ARRAY_BYTES) as opened, np.load(opened, allow_pickle=False) as file:
            if sum(part.file_size for part in file.zip.infolist()) > ARRAY_BYTES:  # a small file may unpack to any size
                raise InputError(f"{path} holds more than {ARRAY_BYTES} bytes")
            return {name: file[name] for name in file.files}
    except FileNotFoundError:
        raise InputError(f"{path} is missing") from None
    except InputError:
        raise
    except Exception as error:  # of zip files, headers and compressed data
        raise InputError(f"{path} is no .npz file, or damaged ({type(error).__name__})") from None
