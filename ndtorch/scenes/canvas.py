"""Black frames to draw on, without asking the system for fresh memory every time."""

from __future__ import annotations

import math
import weakref
from typing import Any

import numpy as np
import torch
from torch import Tensor

KEPT = 2
"""Buffers kept for reuse: the one just handed back, and one more as the caller drops a chunk late."""


class CanvasPool:
    """Zeroed float32 tensors that are the caller's to keep; memory comes back once nothing refers to it.

    Memory new from the system costs a page fault every 4 KiB, which for 500x500 RGB frames can take five
    times as long as drawing two bars.
    """

    def __init__(self, device: torch.device) -> None:
        self.device = device
        self._free: list[np.ndarray[Any, np.dtype[np.float32]]] = []

    def zeros(self, *shape: int) -> Tensor:
        """A zeroed tensor of this shape whose memory nothing else uses."""
        count = math.prod(shape)
        if self.device.type != "cpu" or count == 0:
            return torch.zeros(shape, device=self.device)
        try:
            buffer = self._free.pop()
        except IndexError:
            buffer = np.empty(count, np.float32)
        if buffer.size != count:
            buffer = np.empty(count, np.float32)
        # The tensor's storage, which all its views share, owns `loan`: it dies with the last of them.
        loan = buffer.view()
        weakref.finalize(loan, self._take_back, self._free, buffer).atexit = False
        return torch.from_numpy(loan).zero_().view(shape)

    @staticmethod
    def _take_back(free: list[Any], buffer: np.ndarray[Any, np.dtype[np.float32]]) -> None:
        if len(free) < KEPT:
            free.append(buffer)
