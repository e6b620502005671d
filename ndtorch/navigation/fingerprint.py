"""Short names for values and code: the same for what is the same, another for anything else."""

from __future__ import annotations

import hashlib
import inspect
import platform
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn


def fingerprint(value: Any) -> str:
    """Hash of a value: numbers, texts, tensors, modules, dataclasses, tuples, lists and mappings of those."""
    digest = hashlib.sha256()
    for word in words(value):
        digest.update(word + b"\0")
    return digest.hexdigest()


def words(value: Any) -> list[bytes]:
    """What tells a value from others, in order."""
    name = type(value).__name__.encode()
    if isinstance(value, Tensor):
        data = value.detach().cpu().contiguous()
        content = data.reshape(-1).view(torch.uint8).numpy().tobytes()
        return [name, str((data.dtype, tuple(data.shape))).encode(), content]
    if isinstance(value, nn.Module):
        own = {key: part for key, part in vars(value).items() if not key.endswith("_hooks") and "hooks_" not in key}
        return [name, *words(own)]
    if is_dataclass(value) and not isinstance(value, type):
        return [name, *words({item.name: getattr(value, item.name) for item in fields(value)})]
    if isinstance(value, Mapping):
        return [name, *(word for key in value for word in (str(key).encode(), *words(value[key])))]
    if isinstance(value, tuple | list | set | frozenset):
        return [name, str(len(value)).encode(), *(word for item in value for word in words(item))]
    return [name, repr(value).encode()]


@cache
def code_fingerprint(controller: type | None = None) -> str:
    """Of the package's own code, of the file of a controller that may come from elsewhere, and of PyTorch's version."""
    root = Path(__file__).resolve().parents[1]
    own = inspect.getsourcefile(controller) if controller is not None else None
    files = sorted([*(root / "navigation").rglob("*.py"), *(root / "vision").rglob("*.py")])
    code = [(file.relative_to(root).as_posix(), file.read_bytes()) for file in files]
    return fingerprint([torch.__version__, code, Path(own).read_bytes() if own else None])


@cache
def machine_fingerprint() -> str:
    """Of the processor that code is compiled for."""
    info = Path("/proc/cpuinfo")
    features = ""
    if info.exists():
        lines = info.read_text().splitlines()
        features = next((line for line in lines if line.lower().startswith(("flags", "features"))), "")
    return fingerprint((platform.machine(), torch.backends.cpu.get_cpu_capability(), features))
