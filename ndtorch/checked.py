"""Files of arrays with a checksum over names, types, shapes and values: a damaged one is refused."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import re
import struct
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from ndtorch.errors import InputError
from ndtorch.files import replacing

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

    Raises:
        OSError: it cannot be written.
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
    """Tensors and strings that `save_tensors` wrote.

    Args:
        what: the file is, for the message: "a saved state".

    Raises:
        InputError: missing file, not safetensors, without a checksum, or damaged.
    """
    from safetensors import SafetensorError, safe_open

    try:
        with safe_open(str(path), framework="pt") as file:
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
            about = dict(file.metadata() or {})
    except FileNotFoundError:
        raise InputError(f"{path} is missing") from None
    except (SafetensorError, OSError) as error:
        raise InputError(f"{path} is not {what}: {error}") from None
    except (ValueError, OverflowError, RuntimeError, MemoryError) as error:
        raise InputError(f"{path} is damaged: {str(error).splitlines()[0]}") from None
    given = about.pop(CHECKSUM, None)
    if given is None:
        raise InputError(f"{path} has no checksum: it was not written by this version of ndtorch")
    if given != checksum(tensors, about):
        raise InputError(f"{path} is damaged: its checksum does not fit")
    return tensors, about


def save_arrays(path: str | Path, arrays: Arrays) -> None:
    """Write NumPy arrays by name as a compressed `.npz` that `numpy.load` reads too, with a checksum beside them.

    Raises:
        OSError: it cannot be written; a file that was there stays.
    """
    named: dict[str, Any] = {**arrays, CHECKSUM: np.array(digest_of(arrays))}
    with replacing(path) as beside, beside.open("wb") as out:  # a name would be given another ending
        np.savez_compressed(out, **named)


def load_arrays(path: str | Path) -> dict[str, npt.NDArray[Any]]:
    """What `save_arrays` wrote.

    Raises:
        InputError: missing file, no `.npz` file, without a checksum, or damaged.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
    except FileNotFoundError:
        raise InputError(f"{path} is missing") from None
    except UNREADABLE as error:
        raise InputError(f"{path} is no .npz file, or damaged ({type(error).__name__})") from None
    given = arrays.pop(CHECKSUM, None)
    if given is None:
        raise InputError(f"{path} has no checksum: it was not written by this version of ndtorch")
    if str(given) != digest_of(arrays):
        raise InputError(f"{path} is damaged: its checksum does not fit")
    return arrays


def digest_of(arrays: Arrays) -> str:
    """SHA-256 over names, types, shapes and values."""
    digest = hashlib.sha256()
    for name in sorted(arrays):
        array = np.asarray(arrays[name])
        digest.update(f"{name} {array.dtype.str} {list(array.shape)}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
