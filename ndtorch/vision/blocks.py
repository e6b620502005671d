"""First-order filters over a stretch of signals at once, by a triangular matrix instead of a loop over time."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor, nn

BLOCK = 50


class BlockLowPass(nn.Module):
    """`l += a (x - l)` over up to `length` samples as `l_j = (1 - a)^(j + 1) l + a sum_i (1 - a)^(j - i) x_i`.

    The same numbers as the loop, but for rounding.

    Args:
        a: share of the new sample, see `smoothing_factor`.
        length: samples in the longest stretch.
    """

    decay: Tensor
    matrix: Tensor

    def __init__(self, a: float, length: int) -> None:
        super().__init__()
        self.a, self.length = a, length
        steps = torch.arange(length, dtype=torch.float64)
        late = (steps[:, None] - steps).clamp_min(0)
        keep = 1 - a
        # In double precision, and rounded where they are used: signals of either precision get all that they can hold.
        self.register_buffer("decay", keep ** (steps + 1))
        self.register_buffer("matrix", (a * keep**late).tril())

    def forward(self, x: Tensor, low: Tensor) -> Tensor:
        """Low-passed `x` `[..., T, N]`, T <= length, from the state `low` `[..., N]` on."""
        if self.length == 1:
            return torch.lerp(low.unsqueeze(-2), x, self.a)
        steps = x.shape[-2]
        decay, matrix = self.decay[:steps, None].to(x.dtype), self.matrix[:steps, :steps].to(x.dtype)
        return matrix @ x + decay * low.unsqueeze(-2)

    def weights(self, x: Tensor) -> tuple[float, Tensor]:
        """What remains of the state after the samples of `x` `[..., T, N]`, and the weight of every sample, `[T]`."""
        steps = x.shape[-2]
        return (1 - self.a) ** steps, self.matrix[steps - 1, :steps].to(x.dtype)


class Stretch:
    """New samples of a run in whole blocks of `length`, counted from the first sample of the run, and the rest of them.

    An exported program does not know where in a block its samples begin. There, blocks are gathered by computed places,
    as many as can be whole, and `whole` says which are.

    Args:
        recent: the latest `length - 1` samples before, along `dim`.
        new: T new samples.
        steps: samples before the new ones, int64 scalar.
        length: samples of a block.
        dim: the time dimension.

    Attributes:
        blocks: blocks that end in a new sample.
        whole: for each, whether it is whole, bool scalar; None where that is known.
        first: samples of the run up to the end of the first block.
        recent: the latest `length - 1` samples after.
    """

    def __init__(self, recent: Tensor, new: Tensor, steps: Tensor, length: int, dim: int) -> None:
        given = new.shape[dim]
        samples = torch.cat([recent, new], dim) if length > 1 else new
        self.recent = samples.narrow(dim, given, length - 1)
        self._given, self._dim = given, dim
        self.first: int | Tensor
        self.whole: list[Tensor | None]
        if torch.compiler.is_compiling():
            count = -(-given // length)
            phase = (steps % length).to(new.device)
            self.first = steps - steps % length + length
            self.whole = [None if given % length == 0 else k * length <= phase + given for k in range(1, count + 1)]
            places = torch.arange((count + 1) * length, device=new.device) + (length - 1 - phase)
            shifted = samples.index_select(dim, places.clamp_max(samples.shape[dim] - 1))
            *self.blocks, self._rest = torch.split(shifted, length, dim)
            self._places: Tensor | None = torch.arange(given, device=new.device) + phase
            return
        begun = int(steps) % length
        firsts = range(length - 1 - begun, given, length)
        self.blocks = [samples.narrow(dim, first, length).contiguous() for first in firsts]
        self.first = int(steps) - begun + length
        self.whole = [None] * len(self.blocks)
        done = length * len(self.blocks) - begun if self.blocks else 0
        self._rest, self._places, self._begun = new.narrow(dim, done, given - done), None, begun

    def joined(self, outs: list[Tensor], tail: Callable[[Tensor], Tensor]) -> Tensor:
        """What belongs to the new samples, in order: `outs` of the blocks, and of the rest `tail` of it."""
        if self._places is not None:
            return torch.cat([*outs, tail(self._rest)], self._dim).index_select(self._dim, self._places)
        if outs and self._begun:
            outs = [outs[0].narrow(self._dim, self._begun, outs[0].shape[self._dim] - self._begun), *outs[1:]]
        if self._rest.shape[self._dim]:
            outs = [*outs, tail(self._rest)]
        return torch.cat(outs, self._dim)
