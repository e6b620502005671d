"""The ten signals of many overlapping receptive fields, instead of one field as wide as the image."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from ndtorch.errors import InputError
from ndtorch.vision.features import VisualFeatures
from ndtorch.vision.fields import field_weights
from ndtorch.vision.frames import as_float, check_frames, grey
from ndtorch.vision.motion import MotionState, correlate
from ndtorch.vision.one_pass import field_pass, fresh, one_pass_fits


class LocalFeatures(nn.Module):
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
        if not 3 <= fields <= min(height, width):
            raise InputError(f"fields must lie between 3 and the {min(height, width)} pixels of a side, got {fields}")
        self.features = features
        self.spacing = min(height, width) / fields
        self.grid = (round(height / self.spacing), round(width / self.spacing))
        self.border = features.motion.border
        self._made: dict[torch.dtype, tuple[Tensor, Tensor, Tensor]] = {}
        for name, length, count in zip(("rows", "columns"), features.size, self.grid, strict=True):
            # A pixel lies at n + 1/2, and what two neighbours make of a motion between them.
            self.register_buffer(name, field_weights(torch.arange(length) + 0.5, length, count, self.border))
            weights = field_weights(torch.arange(length) + 1.0, length, count, self.border)
            self.register_buffer(f"{name}_between", weights)
        # Where the coarse responses of the orientation filters lie, and how much of each counts.
        for name, length, count, places, inside in zip(
            ("dog_rows", "dog_columns"),
            features.size,
            self.grid,
            features.orientation.places(),
            (features.orientation.row_weights, features.orientation.column_weights),
            strict=True,
        ):
            mirrored = self.border == "reflect"
            kept = places.clamp(0, length) if mirrored else places
            weights = torch.stack([field_weights(p, length, count, self.border) for p in kept])
            if mirrored:  # on a torus nothing lies outside
                weights = weights * inside.unsqueeze(-2).to(weights)
            self.register_buffer(name, weights)

    def forward(self, frames: Tensor, state: MotionState | None = None) -> tuple[Tensor, MotionState]:
        frames = check_frames(frames, self.features.size)
        if self.features.orientation.paired and one_pass_fits(frames, state):
            return self._together(*self._one_pass(frames, state))
        signals = []
        for frame in frames.unbind(-4):
            frame = as_float(frame)
            image = grey(frame)
            high, delayed, state = self.features.motion.scan(image.unsqueeze(-3), state)
            motion = self._motion(high.squeeze(-3), delayed.squeeze(-3))
            signals.append(torch.cat([motion, self._orientation(image), self._pool(frame)], -3))
        assert state is not None
        return self._together(torch.stack(signals, -4), state)

    def _together(self, signals: Tensor, state: MotionState) -> tuple[Tensor, MotionState]:
        """Signals `[..., T, 10, R, C']` as they are given, if all are numbers."""
        out = signals.movedim(-3, -1)
        if not torch.compiler.is_compiling() and not torch.isfinite(out).all():
            raise InputError("frames must be finite, got NaN or infinite values")
        return out, state

    def _one_pass(self, frames: Tensor, state: MotionState | None) -> tuple[Tensor, MotionState]:
        """Frames `[T, 3, H, W]` by kernels."""
        orientation = self.features.orientation
        into, out = fresh(frames), []
        for frame in frames.unbind(0):
            sums = torch.empty(7, *self.grid, dtype=torch.float64)
            tables = [table.numpy() for table in self._tables(into.slow.dtype)]
            rows = field_pass(frame, state, self.features.motion, orientation.thinning, into, tables, sums.numpy())
            size = orientation.magnitudes_of_rows(rows)
            pooled = (self.dog_rows.to(size).unsqueeze(1) @ size @ self.dog_columns.to(size).unsqueeze(1).mT).sum(0)
            out.append(torch.cat([sums[:4].to(size), pooled, sums[4:].to(size)]))
            state = into
        return torch.stack(out), into

    def _tables(self, kind: torch.dtype) -> tuple[Tensor, Tensor, Tensor]:
        """Weights of fields as the kernel takes them: `columns`, `places`, `shares`."""
        if kind not in self._made:
            columns = torch.stack([self.columns, self.columns_between]).to(kind)
            rows = torch.stack([self.rows, self.rows_between]).to(kind)
            shares, places = rows.topk(2, 1)
            self._made[kind] = (columns, places.mT.contiguous(), shares.mT.contiguous())
        return self._made[kind]

    def _pool(self, images: Tensor, between: int = 0) -> Tensor:
        """Sums over every field, `[..., H, W]` -> `[..., R, C']`, of pixels or of what lies between two of them."""
        rows = self.rows_between if between == -2 else self.rows
        columns = self.columns_between if between == -1 else self.columns
        return rows.to(images.dtype) @ (images @ columns.to(images.dtype).T)

    def _motion(self, high: Tensor, delayed: Tensor) -> Tensor:
        """Left, right, down and up in every field, `[..., 4, R, C']`."""
        pooled = []
        for dim in (-1, -2):
            inner = correlate(high, delayed, dim)
            if self.border == "wrap":
                edge = high.select(dim, 0) * delayed.select(dim, -1) - high.select(dim, -1) * delayed.select(dim, 0)
            else:
                edge = torch.zeros_like(high.select(dim, 0))
            signed = torch.cat([inner, edge.unsqueeze(dim)], dim)
            total, size = self._pool(signed, dim), self._pool(signed.abs_(), dim)
            # The positive part of a signed image is half of magnitude plus value.
            pooled += [(size - total) / 2, (size + total) / 2]
        left, right, up, down = pooled
        return torch.stack([left, right, down, up], -3).clamp_min(0)

    def _orientation(self, image: Tensor) -> Tensor:
        """The three orientations in every field, `[..., 3, R, C']`."""
        size = self.features.orientation.magnitudes(image)  # [..., grids, 3, h, w]
        rows, columns = self.dog_rows.to(size.dtype), self.dog_columns.to(size.dtype)
        return (rows.unsqueeze(1) @ size @ columns.unsqueeze(1).mT).sum(-4)
