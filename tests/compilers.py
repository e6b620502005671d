"""Where `torch.compile` itself is broken."""

from __future__ import annotations

import pytest
import torch

VERSION = tuple(int(part) for part in torch.__version__.split(".")[:2])

exports = pytest.mark.skipif(VERSION < (2, 9), reason="torch.export before 2.9 does not follow `_replace` of a state")
"""For what exports a network."""

compiles = pytest.mark.skipif(
    VERSION < (2, 13), reason="torch.compile of 2.9 and before fails on a navigator as a whole"
)
"""For what compiles a whole navigator."""


def broken_compiler(error: BaseException) -> str:
    """Why an error of `torch.compile` says nothing about us; empty where it may.

    With ATEN_CPU_CAPABILITY=default torch 2.13 writes C++ with `at::vec`, which nothing declares then. All of that C++
    is written by torch.
    """
    if torch.backends.cpu.get_cpu_capability() == "DEFAULT" and "at::vec" in str(error):
        return "without vector instructions torch.compile writes C++ that does not compile: at::vec is not declared"
    return ""
