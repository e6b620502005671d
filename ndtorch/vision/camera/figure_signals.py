"""The ten signals of receptive fields that have the shape of what stands out."""

from __future__ import annotations

from typing import NamedTuple

import torch
import torch.nn.functional as F
from pydantic import Field
from torch import Tensor, nn

from ndtorch.config import Constants
from ndtorch.vision.motion import MotionState, correlate, motion_step
from ndtorch.vision.orientation import OrientedDoG
from ndtorch.vision.temporal import smoothing_factor


class SignalParams(Constants):
    """Constants of the ten signals."""

    most: int = Field(32, gt=0, description="receptive fields: objects at a time")
    tau_high: float = Field(0.5, ge=0, description="high-pass of the motion detectors")
    tau_low: float = Field(0.05, ge=0, description="delay filter of the motion detectors")
    center: tuple[float, float] = Field((2.85, 0.9), description="deviations of the orientation filters, small pixels:")
    surround: tuple[float, float] = Field((3.3, 1.35), description="those published for 500 pixels, brought to 56")


class FieldsState(NamedTuple):
    """State of the motion detectors."""

    motion: MotionState


class FigureSignals(nn.Module):
    """Ten signals of each silhouette: directed motion of what differs from the ground, orientation, color.

    Computed on an image of half the height and width, and averaged over the silhouette of every object: a receptive
    field that forms where something stands out. Opponent motion is taken after averaging.

    Args:
        size: height and width of the picture, multiples of 4.
        dt: seconds between pictures.
        params: constants.
    """

    def __init__(self, size: tuple[int, int], dt: float, params: SignalParams | None = None) -> None:
        super().__init__()
        self.params = p = params or SignalParams()
        self.size = (size[0] // 2, size[1] // 2)
        self.orientation = OrientedDoG(self.size, center=p.center, surround=p.surround, border="reflect", exact=True)
        self.a_high, self.a_low = smoothing_factor(p.tau_high, dt), smoothing_factor(p.tau_low, dt)

    def forward(
        self, difference: Tensor, picture: Tensor, silhouettes: Tensor, state: FieldsState | None
    ) -> tuple[Tensor, FieldsState]:
        """One step.

        Args:
            difference: from the ground, 0 where nothing stands out, `[3, h, w]`.
            picture: `[3, h, w]`.
            silhouettes: number of the track of every pixel plus one, 0 for none, `[h, w]`.
            state: of the step before.

        Returns:
            signals `[most, 10]`, that of track n in row n % most; state.
        """
        small = halved(torch.cat([difference, picture]))
        seen, colors = small[:3], small[3:]
        motion = MotionState(seen, torch.zeros_like(seen)) if state is None else state.motion
        high, delayed, motion = motion_step(seen, motion, self.a_high, self.a_low)
        across = F.pad(correlate(high, delayed, -1), (0, 1)).sum(-3)
        along = F.pad(correlate(high, delayed, -2), (0, 0, 0, 1)).sum(-3)
        images = self.orientation.images(seen.abs().amax(0)).abs()
        own = (colors - colors.mean(0)).clamp_min(0)
        stack = torch.cat([across[None], along[None], images, own]).flatten(1)
        names = silhouettes[::2, ::2].reshape(-1)
        slots = torch.where(names > 0, (names - 1) % self.params.most, self.params.most).long()
        sums = torch.zeros(self.params.most + 1, 8).index_add_(0, slots, stack.mT)
        counts = torch.zeros(self.params.most + 1).index_add_(0, slots, torch.ones(len(slots)))
        fields = (sums / counts.clamp_min(1)[:, None])[:-1]
        x, y = fields[:, 0], fields[:, 1]
        directed = torch.stack([-x, x, y, -y], 1).clamp_min(0)
        tilted = fields[:, 2:5] - fields[:, 2:5].amin(1, keepdim=True)
        return torch.cat([directed, tilted, fields[:, 5:]], 1).sqrt(), FieldsState(motion)


def halved(images: Tensor) -> Tensor:
    """Means of blocks of two by two pixels, `[..., H, W]` -> `[..., H / 2, W / 2]`."""
    rows = images[..., ::2, :] + images[..., 1::2, :]
    return (rows[..., ::2] + rows[..., 1::2]) / 4
