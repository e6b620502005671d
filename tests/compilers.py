"""Whether what compiles for us can compile anything at all here."""

from __future__ import annotations

from functools import cache

import torch


@cache
def inductor_fails() -> str:
    """Why `torch.compile` cannot compile `x.sin() + 1`; empty where it can.

    Under ATEN_CPU_CAPABILITY=default torch 2.13 writes C++ with `at::vec`, and does not declare it.
    """
    try:
        torch.compile(lambda x: x.sin() + 1, dynamic=False)(torch.rand(64))
    except Exception as error:  # whatever kind it is, nothing of ours was in it
        return f"torch.compile cannot compile x.sin() + 1 here: {type(error).__name__}"
    return ""
