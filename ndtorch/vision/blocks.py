"""First-order filters over a stretch of signals at once, by a triangular matrix instead of a loop over time."""

from __future__ import annotations

import torch
from torch import Tensor

BLOCK = 50
BLOCK_SECONDS = 0.1
"""Running statistics are brought up to date this often."""


class BlockLowPass:
    """`l += a (x - l)` over up to `length` samples as `l_j = (1 - a)^(j + 1) l + a sum_i (1 - a)^(j - i) x_i`.

    The same numbers as the loop, but for rounding.

    Args:
        a: share of the new sample, see `smoothing_factor`.
        length: samples in the longest stretch.
    """

    def __init__(self, a: float, length: int) -> None:
        self.a, self.length = a, length
        steps = torch.arange(length, dtype=torch.float64)
        late = (steps[:, None] - steps).clamp_min(0)
        keep = 1 - a
        self.decay = keep ** (steps + 1)
        self.matrix = (a * keep**late).tril()
        self._cast: dict[tuple[torch.dtype, torch.device], tuple[Tensor, Tensor]] = {}

    def __call__(self, x: Tensor, low: Tensor) -> Tensor:
        """Low-passed `x` `[..., T, N]`, T <= length, from the state `low` `[..., N]` on."""
        decay, matrix = self.parts(x)
        steps = x.shape[-2]
        return matrix[:steps, :steps] @ x + decay[:steps, None] * low.unsqueeze(-2)

    def weights(self, x: Tensor) -> tuple[float, Tensor]:
        """What remains of the state after the samples of `x` `[..., T, N]`, and the weight of every sample, `[T]`."""
        steps = x.shape[-2]
        return (1 - self.a) ** steps, self.parts(x)[1][steps - 1, :steps]

    def parts(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Decay `[length]` and matrix `[length, length]` in the precision and on the device of `x`."""
        key = (x.dtype, x.device)
        if key not in self._cast:
            self._cast[key] = (self.decay.to(x.device, x.dtype), self.matrix.to(x.device, x.dtype))
        return self._cast[key]


def aligned(samples: Tensor, given: int, steps: int, length: int) -> list[Tensor]:
    """Whole blocks of `length` samples that end in a new sample, counted from the first sample of the run.

    Sums over blocks that do not depend on how a run is cut into chunks are the same to the last bit.

    Args:
        samples: `[..., length + T, N]`: the latest `length` samples before, and T new ones.
        given: T.
        steps: number of the first new sample.
        length: of a block.
    """
    first = length - steps % length
    return [samples[..., end : end + length, :].contiguous() for end in range(first, given + 1, length)]


def low_pass(filter: BlockLowPass, x: Tensor, low: Tensor) -> tuple[Tensor, Tensor]:
    """Low-passed `x` `[..., T, N]` of any length, and the filter's state after it."""
    lows = []
    for part in torch.split(x, filter.length, -2):
        out = filter(part, low)
        low = out[..., -1, :]
        lows.append(out)
    return (lows[0] if len(lows) == 1 else torch.cat(lows, -2)), low
