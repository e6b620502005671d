"""When kernels take the place of operations in torch."""

from __future__ import annotations

import os
from functools import cache

import torch
from torch import Tensor

SWITCH = "NDTORCH_KERNELS"
"""Environment variable: 0 leaves everything to torch."""


def kernels_wanted(*tensors: Tensor) -> bool:
    """Whether kernels are to be used: under `torch.inference_mode()`, on the CPU.

    Gradients, other devices, and programs that are traced or compiled keep torch. So does `NDTORCH_KERNELS=0`.
    """
    # In this order: what is traced may not ask for the mode.
    if torch.compiler.is_compiling() or not torch.is_inference_mode_enabled():
        return False
    return switched_on() and not any(map(elsewhere, tensors))


def elsewhere(tensor: Tensor) -> bool:
    """Whether a tensor is not on the CPU."""
    return not tensor.is_cpu


@cache
def switched_on() -> bool:
    """What the environment says; it is asked once."""
    return os.environ.get(SWITCH, "1") != "0"
