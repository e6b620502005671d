"""Where `torch.compile` itself is broken."""

from __future__ import annotations

import torch


def broken_compiler(error: BaseException) -> str:
    """Why an error of `torch.compile` says nothing about us; empty where it may.

    With ATEN_CPU_CAPABILITY=default torch 2.13 writes C++ with `at::vec`, which nothing declares then. All of that C++
    is written by torch.
    """
    if torch.backends.cpu.get_cpu_capability() == "DEFAULT" and "at::vec" in str(error):
        return "without vector instructions torch.compile writes C++ that does not compile: at::vec is not declared"
    return ""
