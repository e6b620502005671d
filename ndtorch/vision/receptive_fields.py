"""The ten features in a grid of receptive fields."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ndtorch.arguments import FullPrecision, check_number, check_state, has_values, without_autocast
from ndtorch.errors import InputError
from ndtorch.vision.features import VisualFeatures
from ndtorch.vision.frames import as_float, check_frames, grey
from ndtorch.vision.motion import Border, MotionState, check_border


def field_weights(points: Tensor, length: float, fields: int, border: Border = "wrap") -> Tensor:
    """How much each point of a line belongs to each of `fields` overlapping fields, `[fields, points]`.

    Fields are two spacings wide and centered on `(f + 1/2) length / fields`, so that a small object that moves along
    leaves one as it enters the next. Between the first and the last center they add up to one, beyond them with
    "wrap" and "reflect". A single field weighs all points alike: the whole field of the papers.

    Args:
        points: positions `[points]`; pixel n covers n to n + 1.
        length: of the line, in the same unit.
        fields: how many.
        border: "wrap" for a line that is closed, "reflect" where the first and the last field keep what lies beyond
            their centers.

    Raises:
        InputError: another border, no field, or more fields than pixels.

    >>> weights = field_weights(torch.arange(100.0), 100.0, 5)
    >>> weights.shape, bool((weights.sum(0) - weights.sum(0).mean()).abs().max() < 1e-5)
    (torch.Size([5, 100]), True)
    """
    check_border(border)
    if not 1 <= fields <= length:
        raise InputError(f"fields must be between 1 and the {length} pixels of a side, got {fields}")
    if fields == 1:
        return torch.ones_like(points).unsqueeze(0)
    spacing = length / fields
    centers = (torch.arange(fields, dtype=points.dtype) + 0.5) * spacing
    offset = (points - centers[:, None]) / spacing
    if border == "wrap":
        offset = (offset + fields / 2) % fields - fields / 2
    else:
        offset[0].clamp_(min=0)
        offset[-1].clamp_(max=0)
    return torch.where(offset.abs() < 1, 0.5 + 0.5 * torch.cos(math.pi * offset), 0.0)


class LocalFeatures(FullPrecision):
    """The ten signals of `VisualFeatures`, summed over a coarse grid of overlapping receptive fields.

    Glomeruli with a retinotopic place each, as [B discussion] proposes. The fields' windows add up to one
    everywhere, so the sum over all fields is the wide-field signal.

    Args:
        features: detectors, with the size and border of the frames.
        fields: fields along the shorter side; the longer one gets as many as make them about square.

    Shapes:
        frames `[..., T, C, H, W]` -> `[..., T, R, C', 10]`: rows and columns of fields, then the signals in the
        order of `FEATURES`. State: that of the detectors; `None` settles on the first frame.

    Raises:
        InputError: fewer than 3 fields, more fields than pixels, or frames that cannot be used.

    >>> from ndtorch.vision import VisualFeatures
    >>> signals, state = LocalFeatures(VisualFeatures(size=(60, 80)), fields=5)(torch.rand(2, 3, 60, 80))
    >>> signals.shape
    torch.Size([2, 5, 7, 10])
    """

    rows: Tensor
    columns: Tensor
    rows_between: Tensor
    columns_between: Tensor
    dog_rows: Tensor
    dog_columns: Tensor

    def __init__(self, features: VisualFeatures, fields: int = 16) -> None:
        super().__init__()
        height, width = features.size
        check_number("fields", fields, whole=True)
        if not 3 <= fields <= min(height, width):
            raise InputError(f"fields must lie between 3 and the {min(height, width)} pixels of a side, got {fields}")
        self.features = features
        self.spacing = min(height, width) / fields
        self.grid = (round(height / self.spacing), round(width / self.spacing))
        self.border = features.motion.border
        for name, length, count in zip(("rows", "columns"), features.size, self.grid, strict=True):
            # A pixel lies at n + 1/2, and what two neighbours make of a motion between them.
            self.register_buffer(name, field_weights(torch.arange(length) + 0.5, length, count, self.border))
            weights = field_weights(torch.arange(length) + 1.0, length, count, self.border)
            self.register_buffer(f"{name}_between", weights)
        # Where the coarse responses of the orientation filters lie, and how much of each counts.
        filters, mirrored = features.orientation, self.border == "reflect"
        shares = filters.row_weights, filters.column_weights
        lines = zip(filters.places(), shares, features.size, self.grid, strict=True)
        for name, (places, inside, length, count) in zip(("dog_rows", "dog_columns"), lines, strict=True):
            kept = places.clamp(0, length) if mirrored else places
            weights = torch.stack([field_weights(p, length, count, self.border) for p in kept])
            if mirrored:  # on a torus nothing lies outside
                weights = weights * inside.unsqueeze(-2).to(weights)
            self.register_buffer(name, weights)

    @without_autocast
    def forward(self, frames: Tensor, state: MotionState | None = None) -> tuple[Tensor, MotionState]:
        check_state(state, MotionState)
        frames = check_frames(frames, self.features.size, device=self.features.orientation.fixed_spectrum.device)
        signals = []
        for frame in frames.unbind(-4):
            frame = as_float(frame)
            image = grey(frame)
            high, delayed, state = self.features.motion.scan(image.unsqueeze(-3), state)
            motion = self.features.motion.images(high.squeeze(-3), delayed.squeeze(-3))
            sides, ends = self._pool(motion[..., :2, :, :], -1), self._pool(motion[..., 2:, :, :], -2)
            filters = self.features.orientation
            size = filters.magnitudes_of_thinned(filters.thinned(image))  # [..., grids, 3, h, w]
            rows, columns = self.dog_rows.to(size.dtype), self.dog_columns.to(size.dtype)
            orientation = (rows.unsqueeze(1) @ size @ columns.unsqueeze(1).mT).sum(-4)
            signals.append(torch.cat([sides, ends, orientation, self._pool(frame)], -3))
        assert state is not None
        out = torch.stack(signals, -4).movedim(-3, -1)
        if has_values(out) and not torch.isfinite(out).all():
            raise InputError("frames must be finite, got NaN or infinite values")
        return out, state

    def _pool(self, images: Tensor, between: int = 0) -> Tensor:
        """Sums over every field, `[..., H, W]` -> `[..., R, C']`, of pixels or of what lies between two of them."""
        rows = self.rows_between if between == -2 else self.rows
        columns = self.columns_between if between == -1 else self.columns
        return rows.to(images.dtype) @ (images @ columns.to(images.dtype).T)
