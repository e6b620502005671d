"""Modules in a row, with and without state."""

from __future__ import annotations

import inspect
from typing import Any, NamedTuple

from torch import nn

from ndtorch.arguments import check_state
from ndtorch.errors import InputError


class SequentialState(NamedTuple):
    """State of `Sequential`: that of each module, None of those that have none."""

    parts: tuple[Any, ...]


class Sequential(nn.Sequential):
    """`torch.nn.Sequential` for modules with a state: each gets the output of the one before, and its own state.

    A module has a state where its `forward` takes an argument `state`; it returns the output and the state after it.
    All others are called with their input alone.

    Shapes:
        Those of the first module in, of the last one out. State: `SequentialState`; `None` starts every module.

    Raises:
        InputError: a state of another number of modules.

    >>> import torch
    >>> from ndtorch import HassensteinReichardt, Sequential
    >>> network = Sequential(HassensteinReichardt(), torch.nn.Conv2d(4, 8, 3), torch.nn.ReLU())
    >>> out, state = network(torch.rand(5, 1, 20, 20))
    >>> out, state = network(torch.rand(5, 1, 20, 20), state)  # the frames after them
    >>> out.shape
    torch.Size([5, 8, 18, 18])
    """

    def forward(self, x: Any, state: SequentialState | None = None) -> tuple[Any, SequentialState]:
        check_state(state, SequentialState)
        before = (None,) * len(self) if state is None else state.parts
        if len(before) != len(self):
            raise InputError(f"state must hold {len(self)} parts, one of each module, got {len(before)}")
        after = []
        for module, part in zip(self, before, strict=True):
            if "state" in inspect.signature(module.forward).parameters:
                x, part = module(x, part)
            else:
                x = module(x)
            after.append(part)
        return x, SequentialState(tuple(after))
