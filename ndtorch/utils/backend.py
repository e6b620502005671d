"""Which implementation computes: the compiled kernels of Numba, or torch."""

from __future__ import annotations

import os
from functools import cache
from typing import Literal, get_args

import torch
from torch import Tensor, nn

from ndtorch.arguments import has_values
from ndtorch.errors import InputError

Backend = Literal["auto", "numba", "torch"]
"""`auto` takes kernels wherever they can do the work; `numba` refuses what they cannot do; `torch` takes none."""

SWITCH = "NDTORCH_KERNELS"
"""Environment variable: with 0, `auto` means torch."""


def check_backend(backend: str) -> Backend:
    """The backend of this name. Raises `InputError`: there is none."""
    if backend not in get_args(Backend):
        raise InputError(f"backend must be one of {', '.join(get_args(Backend))}, got {backend!r}")
    return backend  # type: ignore[return-value]


def set_backend(module: nn.Module, backend: str) -> None:
    """Set the backend of a module and of everything in it that has a choice."""
    chosen = check_backend(backend)
    if chosen == "torch" and getattr(module, "kernels_only", False):
        raise InputError(f"{getattr(module, 'name', 'this module')} has compiled kernels only; leave backend out")
    for part in module.modules():
        if hasattr(part, "backend"):
            part.backend = chosen  # type: ignore[assignment]


def kernels_wanted(*tensors: Tensor, backend: Backend = "auto") -> bool:
    """Whether kernels are to be used for these tensors: on the CPU, without gradients, and holding numbers (see
    `has_values`).
    """
    if backend == "torch" or torch.compiler.is_compiling():
        return False
    if backend == "auto" and not switched_on():
        return False
    possible, gradients = True, torch.is_grad_enabled()
    for tensor in tensors:
        possible &= tensor.is_cpu and not (tensor.requires_grad and gradients) and has_values(tensor)
    if backend == "numba" and not possible:
        raise InputError("backend='numba' needs tensors on the CPU that need no gradient")
    return possible


@cache
def switched_on() -> bool:
    """What the environment says; it is read once."""
    return os.environ.get(SWITCH, "1") != "0"
