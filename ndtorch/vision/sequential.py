"""Modules in a row, with and without state."""

from __future__ import annotations

import inspect
from typing import Any, NamedTuple

from torch import Tensor, nn

from ndtorch.arguments import check_state
from ndtorch.errors import InputError
from ndtorch.utils.tensors import safe_state


@safe_state
class SequentialState(NamedTuple):
    """State of `Sequential`: that of each module, None of those that have none."""

    parts: tuple[Any, ...]


class Sequential(nn.Sequential):
    """`torch.nn.Sequential` for modules with a state: each gets the output of the one before, and its own state.

    A module has a state where its `forward` takes an argument `state`; it returns the output and the state after it.
    So have `nn.RNN`, `nn.LSTM` and `nn.GRU`, whose `hx` it is. All others are called with their input alone and see one
    frame at a time: of a batch, trials and time are one dimension to them.

    Inside `torch.nn.Sequential`, which hands on the pair of output and state as it is, a module with a state can only
    come last. Use this class there, too, and call the whole with the state.

    Shapes:
        Frames `[T, C, H, W]` or, as a DataLoader gives them, `[B, T, C, H, W]`; signals `[T, N]` or `[B, T, N]`. Out:
        those of the last module. State: `SequentialState`; `None` starts every module.

    Raises:
        InputError: a state of another number of modules.

    >>> import torch
    >>> from ndtorch import HassensteinReichardt, Sequential
    >>> from torch.nn import GRU, Conv2d, Flatten
    >>> network = Sequential(HassensteinReichardt(), Conv2d(4, 8, 3), Flatten(), GRU(2592, 6))
    >>> out, state = network(torch.rand(2, 5, 1, 20, 20))
    >>> out, state = network(torch.rand(2, 5, 1, 20, 20), state)  # the frames after them
    >>> out.shape
    torch.Size([2, 5, 6])
    """

    def forward(self, x: Any, state: SequentialState | None = None) -> tuple[Any, SequentialState]:
        check_state(state, SequentialState)
        before = (None,) * len(self) if state is None else state.parts
        if len(before) != len(self):
            raise InputError(f"state must hold {len(self)} parts, one of each module, got {len(before)}")
        after = []
        for module, part in zip(self, before, strict=True):
            batch = isinstance(x, Tensor) and x.ndim in (3, 5)
            if isinstance(module, nn.RNNBase):
                turned = batch and not module.batch_first
                x, part = module(x.transpose(0, 1) if turned else x, part)
                x = x.transpose(0, 1) if turned else x
            elif "state" in inspect.signature(module.forward).parameters:
                x, part = module(x, part)
            else:
                x = module(x.flatten(0, 1)).unflatten(0, x.shape[:2]) if batch else module(x)
            after.append(part)
        return x, SequentialState(tuple(after))
