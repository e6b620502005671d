"""Visual attention: an image in which the object of the winning neuron stands out."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn

from ndtorch.arguments import check_tensor
from ndtorch.binding.normalise import divide
from ndtorch.binding.objects import ObjectTable
from ndtorch.errors import InputError
from ndtorch.vision.features import GROUPS
from ndtorch.vision.temporal import FilterState, LowPass


def feature_weights(outputs: Tensor, table: ObjectTable, scale: Tensor) -> tuple[Tensor, Tensor]:
    """Weight of every feature image, `f_j = |o_k| O[k, j] / n_j` for the winner k, the owner with the largest output.
    [C §4.2, eq. 11]

    Shapes: outputs and scale (the group maxima n) `[..., 10]` -> f `[..., 10]` and the winner `[...]`, -1 where there
    is none; f is zero there.
    """
    among = outputs.masked_fill(~table.owners, -torch.inf)
    k = torch.where(table.owners.any(-1), among.argmax(-1), -1)
    index = k.clamp_min(0).unsqueeze(-1)
    strength = outputs.gather(-1, index).abs()
    row = table.rows.gather(-2, index.unsqueeze(-1).expand(*index.shape, table.rows.shape[-1])).squeeze(-2)
    return divide(strength * row, scale) * (k >= 0).unsqueeze(-1), k


def attention_mask(weights: Tensor, images: Tensor, low: Tensor) -> Tensor:
    """Weighted sum of the magnitudes of high-passed feature images, normalised to a maximum of 1. [C fig. 5]

    Motion and orientation go into all three color planes, each color only into its own.

    Shapes: weights `[..., 10]`, images and their low-passed copies `[..., 10, H, W]` -> `[..., 3, H, W]`.
    """
    shared = images.new_zeros(*images.shape[:-3], *images.shape[-2:])
    planes: list[Tensor] = []
    for j in range(10):
        own = shared
        # Most weights are zero, and a pass over images costs more than a look at a number.
        if (weights[..., j] != 0).any():
            own = own + weights[..., j, None, None] * (images[..., j, :, :] - low[..., j, :, :]).abs_()
        if j < GROUPS["color"].start:
            shared = own
        else:
            planes.append(own)
    mask = torch.stack(planes, -3)
    largest = mask.amax((-1, -2, -3), keepdim=True)
    return mask / largest.clamp_min(torch.finfo(mask.dtype).tiny)


class Enhanced(NamedTuple):
    """Enhanced frames `[..., T, 3, H, W]` and the winning neuron of each, `[..., T]`, -1 for none."""

    frames: Tensor
    winner: Tensor


class Attention(nn.Module):
    """Enhance frames: what fluctuates with the winner's features stays bright, the rest is dimmed. [C §4.2]

    Args:
        dt: seconds between the frames it is given, which may be every n-th frame of the input.
        tau: time constant of the high-pass on the feature images, seconds.

    Shapes:
        frames `[..., T, 3, H, W]`, feature images `[..., T, 10, H, W]`, outputs and scale `[..., T, 10]`,
        the table of the objects, one a trial -> (enhanced frames `[..., T, 3, H, W]`, winner `[..., T]`), state.
        Enhanced frames are black where no neuron owns an object.
    """

    def __init__(self, dt: float, tau: float = 1.0) -> None:
        super().__init__()
        self.low_pass = LowPass(tau, dt)

    def forward(
        self,
        frames: Tensor,
        images: Tensor,
        outputs: Tensor,
        scale: Tensor,
        table: ObjectTable,
        state: FilterState | None = None,
    ) -> tuple[Enhanced, FilterState]:
        for name, value in {"frames": frames, "images": images, "outputs": outputs, "scale": scale}.items():
            check_tensor(name, value)
        if images.shape[-3] != 10 or images.shape[-2:] != frames.shape[-2:]:
            raise InputError(
                f"images must be [..., T, 10, H, W] for frames {tuple(frames.shape)}, got {tuple(images.shape)}"
            )
        low, state = self.low_pass.scan(images, state)
        # One table for all T frames.
        owners = table.owners.unsqueeze(-2).expand(*outputs.shape)
        rows = table.rows.unsqueeze(-3).expand(*outputs.shape, table.rows.shape[-1])
        table = ObjectTable(owners, rows)
        weight, k = feature_weights(outputs, table, scale)
        return Enhanced(frames * attention_mask(weight, images, low), k), state
