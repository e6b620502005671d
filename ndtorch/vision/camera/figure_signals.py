"""The ten signals of receptive fields that have the shape of what stands out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import torch
import torch.nn.functional as F
from pydantic import Field
from torch import Tensor, nn

from ndtorch.config import Constants, Deviations
from ndtorch.kernels.field_signals import field_signals
from ndtorch.kernels.field_sums import field_sums
from ndtorch.kernels.switch import kernels_wanted
from ndtorch.vision.camera.ground import Floats, copied, room
from ndtorch.vision.motion import MotionState, correlate, motion_step
from ndtorch.vision.orientation import OrientedDoG
from ndtorch.vision.temporal import smoothing_factor

Names = npt.NDArray[np.int32]
Sums = npt.NDArray[np.float64]


class SignalParams(Constants):
    """Constants of the ten signals."""

    most: int = Field(32, gt=0, description="receptive fields: objects at a time")
    tau_high: float = Field(0.5, ge=0, description="high-pass of the motion detectors")
    tau_low: float = Field(0.05, ge=0, description="delay filter of the motion detectors")
    center: Deviations = Field((2.85, 0.9), description="deviations of the orientation filters, small pixels:")
    surround: Deviations = Field((3.3, 1.35), description="those published for 500 pixels, brought to 56")


class FieldsState(NamedTuple):
    """State of the motion detectors."""

    motion: MotionState


class Sensed(NamedTuple):
    """What stands out at a step: the largest difference from the ground among the colors, `[h / 2, w / 2]`, and pixels,
    motion across and along, and red, green and blue of each field, `[most, 6]` float64."""

    strongest: Floats
    sums: Sums


AT_ONCE = 2
"""Pictures that are transformed at once: each alone takes longer, and more of them leave the cache."""


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
        self, picture: Tensor, ground: Tensor, silhouettes: Tensor, state: FieldsState | None
    ) -> tuple[Tensor, FieldsState]:
        """One step.

        Args:
            picture, ground: `[3, h, w]`.
            silhouettes: number of the track of every pixel plus one, 0 for none, `[h, w]`.
            state: of the step before.

        Returns:
            signals `[most, 10]`, that of track n in row n % most; state.
        """
        filters = None if state is None else (copied(state.motion.slow), copied(state.motion.delayed))
        names: Names = silhouettes.numpy()
        sensed, (slow, delayed) = self.sense(picture.numpy(), ground.numpy(), names, filters)
        after = FieldsState(MotionState(torch.from_numpy(slow), torch.from_numpy(delayed)))
        return self.signals([sensed], [names])[0], after

    def sense(
        self, picture: Floats, ground: Floats, silhouettes: Names, filters: tuple[Floats, Floats] | None
    ) -> tuple[Sensed, tuple[Floats, Floats]]:
        """The first part of a step, that which goes on from the state before.

        Args:
            picture, ground, silhouettes: as of `forward`.
            filters: slow and delayed of `MotionState`; they are changed.

        Returns:
            what is sensed; the filters.
        """
        if filters is None:
            apart = torch.from_numpy((picture - ground) * (silhouettes > 0))
            filters = halved(apart).numpy(), torch.zeros(3, *self.size).numpy()
        slow, delayed = filters
        if kernels_wanted():
            strongest, sums = room(*self.size), np.empty((self.params.most, 6))
            rates = (self.a_high, self.a_low)
            field_sums(picture, ground, silhouettes, slow, delayed, *rates, strongest, sums)
            return Sensed(strongest, sums), filters
        here, behind, names = (torch.from_numpy(image) for image in (picture, ground, silhouettes))
        state = FieldsState(MotionState(torch.from_numpy(slow), torch.from_numpy(delayed)))
        shown, found, motion = self.sums(here, behind, names, state)
        return Sensed(shown.numpy(), found.numpy()), (motion.slow.numpy(), motion.delayed.numpy())

    def signals(self, sensed: Sequence[Sensed | None], silhouettes: Sequence[Names]) -> Tensor:
        """The second part of T steps, `[T, most, 10]`; where None is sensed they are zero."""
        signals = torch.zeros(len(sensed), self.params.most, 10)
        # Where nothing stands out, nothing is sensed.
        some = [n for n, one in enumerate(sensed) if one is not None and one.sums[:, 0].any()]
        for start in range(0, len(some), AT_ONCE):
            few = some[start : start + AT_ONCE]
            shown = np.stack([one.strongest for n in few if (one := sensed[n])])
            images = self.orientation.images(torch.from_numpy(shown))
            for n, image in zip(few, images, strict=True):
                if one := sensed[n]:
                    self._signals(image, silhouettes[n], one.sums, signals[n])
        return signals

    def _signals(self, images: Tensor, silhouettes: Names, found: Sums, signals: Tensor) -> None:
        """Signals `[most, 10]` from responses `[3, h / 2, w / 2]`."""
        if kernels_wanted(images):
            field_signals(images.numpy(), silhouettes, found, signals.numpy())
            return
        count, sums = self.params.most, torch.from_numpy(found)
        names = names_of(torch.from_numpy(silhouettes)).reshape(-1)
        slots = torch.where(names > 0, (names - 1) % count, count).long()
        sizes = images.abs().flatten(1).mT.double()
        tilted = torch.zeros(count + 1, 3, dtype=torch.float64).index_add_(0, slots, sizes)[:-1]
        pixels = sums[:, :1].clamp_min(1)  # float64: roots are taken of what is left of motion both ways
        x, y = sums[:, 1:3].div(pixels).unbind(1)
        tilted = tilted / pixels
        tilted = tilted - tilted.amin(1, keepdim=True)
        directed = torch.stack([-x, x, y, -y], 1).clamp_min(0)
        signals.copy_(torch.cat([directed, tilted, sums[:, 3:] / pixels], 1).sqrt())

    def sums(
        self, picture: Tensor, ground: Tensor, silhouettes: Tensor, state: FieldsState
    ) -> tuple[Tensor, Tensor, MotionState]:
        """The largest difference from the ground among the colors `[h / 2, w / 2]`; pixels, motion across and along,
        and red, green and blue of each field `[most, 6]`; and the filters' state."""
        seen, colors = halved((picture - ground) * (silhouettes > 0)), halved(picture)
        high, delayed, motion = motion_step(seen, state.motion, self.a_high, self.a_low)
        # What two neighbours make of a motion belongs to both by half.
        right, down = (correlate(high.double(), delayed.double(), dim).sum(-3) / 2 for dim in (-1, -2))
        across = F.pad(right, (0, 1)) + F.pad(right, (1, 0))
        along = F.pad(down, (0, 0, 0, 1)) + F.pad(down, (0, 0, 1, 0))
        own = (colors - colors.mean(0)).clamp_min(0)
        stack = torch.cat([torch.ones_like(across[None]), across[None], along[None], own.double()]).flatten(1)
        names, count = names_of(silhouettes).reshape(-1), self.params.most
        slots = torch.where(names > 0, (names - 1) % count, count).long()
        total = torch.zeros(count + 1, 6, dtype=torch.float64).index_add_(0, slots, stack.mT)[:-1]
        return seen.abs().amax(0), total, motion


def halved(images: Tensor) -> Tensor:
    """Means of blocks of two by two pixels, `[..., H, W]` -> `[..., H / 2, W / 2]`."""
    pairs = images[..., ::2] + images[..., 1::2]
    return (pairs[..., ::2, :] + pairs[..., 1::2, :]) / 4


def names_of(silhouettes: Tensor) -> Tensor:
    """Of blocks of two by two pixels the largest number, `[h, w]` -> `[h / 2, w / 2]`: the same in a mirror image."""
    rows = torch.maximum(silhouettes[::2], silhouettes[1::2])
    return torch.maximum(rows[:, ::2], rows[:, 1::2])
