"""Numbers, and ways to cut a run into chunks, shared by the tests."""

from __future__ import annotations

from typing import Any

import torch
from hypothesis import strategies as st
from torch import Tensor, nn


def noise(*shape: int, seed: int = 0) -> Tensor:
    """Numbers in 0..1, float64, the same every time."""
    return torch.rand(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


@st.composite
def chunkings(draw: st.DrawFn, total: int) -> list[int]:
    """Lengths of chunks, 1 or more each, that add up to `total`."""
    cuts = sorted(draw(st.sets(st.integers(1, total - 1), max_size=total - 1)))
    return [b - a for a, b in zip([0, *cuts], [*cuts, total], strict=True)]


def in_chunks(
    module: nn.Module, x: Tensor, lengths: list[int] | int, dim: int, out_dim: int | None = None
) -> tuple[Tensor, Any]:
    """Joined outputs of `out, state = module(chunk, state)` over chunks of `x` along `dim`, and the last state.

    `out_dim` is where the outputs have their time steps, `dim` unless given.
    """
    state = None
    outs = []
    for chunk in x.split(lengths, dim):
        out, state = module(chunk, state)
        outs.append(out)
    return torch.cat(outs, dim if out_dim is None else out_dim), state
