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
