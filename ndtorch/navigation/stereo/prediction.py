"""Features that are followed: each looked for where its last two places point to."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn

from ndtorch.errors import InputError
from ndtorch.navigation.stereo.features import FeatureParams, Features, describe, exclude, searchable


class PredictionState(NamedTuple):
    """State of `PredictedFeatures`: the last and the last but one column of each feature, `[..., n]`."""

    last: Tensor
    before: Tensor


def predict_step(
    motion: Tensor, state: PredictionState, params: FeatureParams, reach: int
) -> tuple[Tensor, Tensor, PredictionState]:
    """Columns and magnitudes of the features in the next row, and the new state. [§2.1.4]

    Each feature is looked for within `reach` pixels of `2 last - before`, in the order of the slots; one
    whose largest |ND-min| there is below `min_motion` is lost. Lost slots are then refilled with the
    strongest outputs of the whole row.

    Args:
        motion: ND-min outputs `[..., W]`.
    """
    magnitude = searchable(motion)
    spacing = torch.arange(-params.spacing_px, params.spacing_px + 1, device=motion.device)
    window = torch.arange(-reach, reach + 1, device=motion.device)
    width = motion.shape[-1]
    expected = 2 * state.last - state.before
    columns, strengths, lost = [], [], []
    for k in range(params.count):
        places = (expected[..., k : k + 1] + window).clamp(0, width - 1)
        strength, index = magnitude.gather(-1, places).max(-1, keepdim=True)
        column = places.gather(-1, index)
        found = strength >= params.min_motion
        # A lost feature must not keep others away: it excludes only the border, which is excluded anyway.
        exclude(magnitude, torch.where(found, column + spacing, 0))
        columns.append(column)
        strengths.append(strength)
        lost.append(~found)
    before = state.last.clone()
    for k in range(params.count):
        strength, column = magnitude.max(-1, keepdim=True)
        columns[k] = torch.where(lost[k], column, columns[k])
        strengths[k] = torch.where(lost[k], strength, strengths[k])
        exclude(magnitude, torch.where(lost[k], column + spacing, 0))
        # A new feature has no past: it is expected to stay.
        before[..., k : k + 1] = torch.where(lost[k], column, before[..., k : k + 1])
    column = torch.cat(columns, -1)
    return column, torch.cat(strengths, -1), PredictionState(column, before)


class PredictedFeatures(nn.Module):
    """Features of a row that prefer the object they were on, in place of `find_features`. [§2.1.4]

    It searches a few pixels instead of the row, and maps less densely, because features hop less.

    Shapes:
        row, motion `[..., T, W]` -> `Features` of `[..., T, n]`, in the order of the slots, not of strength.
        `state=None` starts with the strongest outputs of the first row.

    Args:
        params: as for `find_features`.
        reach: how far from the expected column a feature is looked for, pixels.

    Raises:
        InputError: row and motion of different shapes or without time, or a negative reach.
    """

    def __init__(self, params: FeatureParams | None = None, reach: int = 3) -> None:
        super().__init__()
        if reach < 0:
            raise InputError(f"reach must be >= 0 pixels, got {reach}")
        self.params, self.reach = params or FeatureParams(), reach

    def forward(
        self, row: Tensor, motion: Tensor, state: PredictionState | None = None
    ) -> tuple[Features, PredictionState]:
        if row.shape != motion.shape or row.ndim < 2 or row.shape[-1] < 3 or row.shape[-2] < 1:
            raise InputError(
                f"expected row and motion of one shape [..., T, W >= 3], "
                f"got {tuple(row.shape)} and {tuple(motion.shape)}"
            )
        if state is None:
            # Nothing is expected anywhere: every slot is lost and refilled from the whole row.
            nowhere = torch.zeros(*row.shape[:-2], self.params.count, dtype=torch.int64, device=row.device)
            nowhere -= self.reach
            state = PredictionState(nowhere, nowhere)
        columns, strengths = [], []
        for sample in motion.unbind(-2):
            column, strength, state = predict_step(sample, state, self.params, self.reach)
            columns.append(column)
            strengths.append(strength)
        return describe(row, torch.stack(columns, -2), torch.stack(strengths, -2), self.params), state
