"""Motion in every direction and at every pace, in overlapping fields: correlators with long bases."""

from __future__ import annotations

from typing import NamedTuple

import torch
from pydantic import Field
from torch import Tensor, nn
from torch.nn import functional

from ndtorch.config import Constants
from ndtorch.errors import InputError
from ndtorch.vision.fields import field_weights, pool
from ndtorch.vision.frames import as_float, check_frames, grey
from ndtorch.vision.temporal import low_pass_step, smoothing_factor


class CoherentParams(Constants):
    """Constants of `CoherentMotion`."""

    around: int = Field(9, gt=0, description="side of the window whose mean is taken off, pixels, odd")
    tau_high: float = Field(0.5, ge=0, description="high-pass of every pixel, seconds")
    delay: float = Field(0.16, gt=0, description="between the two moments that are compared, seconds")
    fastest: float = Field(45.0, gt=0, description="fastest motion that is looked for, pixels a second")
    field: float = Field(12.0, gt=0, description="distance of neighbouring fields, pixels")
    tau: float = Field(0.4, ge=0, description="memory of the correlations, seconds")
    every: float = Field(0.08, gt=0, description="time between comparisons, seconds")
    kept: float = Field(1.0, gt=0, description="time for which frames are kept for a closer look, seconds")


class CoherentState(NamedTuple):
    """State of `CoherentMotion`.

    Attributes:
        slow: what the high-pass has taken for the mean, `[..., H, W]`.
        past: the latest high-passed frames, oldest first, `[..., B, H, W]`.
        correlations: running means of products with the past, `[..., D, R, C]`.
        power: running means of squares, `[..., R, C]`.
        steps: frames taken, int64 scalar.
    """

    slow: Tensor
    past: Tensor
    correlations: Tensor
    power: Tensor
    steps: Tensor


class CoherentMotion(nn.Module):
    """How much of what is in a field has moved by each displacement within `delay`.

    A Hassenstein-Reichardt detector multiplies what is at a place with what was at its neighbor a moment ago. Here the
    product is taken over every displacement up to `fastest`, and averaged over a field and a memory: each field holds
    a map of directions and paces. Random dots that move each its own way fill a ring of the map, dots that move
    together make a peak. Contrast of both signs counts, light alone does not.

    Args:
        size: height and width of the frames.
        dt: seconds between frames.
        params: constants.

    Shapes:
        frames `[..., T, C, H, W]` -> `[..., T, D, R, C']`, D displacements, R x C' fields; 1 is a field in which
        everything has moved so. State: `CoherentState`; `None` settles on the first frame.

    Raises:
        InputError: frames that cannot be used, or fewer than one field.
    """

    rows: Tensor
    columns: Tensor
    displacements: Tensor

    def __init__(self, size: tuple[int, int], dt: float = 0.04, params: CoherentParams | None = None) -> None:
        super().__init__()
        c = self.params = params or CoherentParams()
        self.size, self.dt = size, dt
        self.lag = max(1, round(c.delay / dt))
        self.kept = max(self.lag + 1, round(c.kept / dt))
        self.every = max(1, round(c.every / dt))
        self.reach = max(1, round(c.fastest * self.lag * dt))
        self.a_high, self.a = smoothing_factor(c.tau_high, dt), smoothing_factor(c.tau, self.every * dt)
        grid = tuple(round(side / c.field) for side in size)
        if min(grid) < 1:
            raise InputError(f"frames of {size[0]}x{size[1]} pixels have no field of {c.field:g} pixels")
        for name, length, count in zip(("rows", "columns"), size, grid, strict=True):
            self.register_buffer(name, field_weights(torch.arange(length) + 0.5, length, count, "reflect"))
        one = torch.arange(-self.reach, self.reach + 1)
        # Column and row by which each displacement goes.
        self.register_buffer("displacements", torch.stack(torch.meshgrid(one, one, indexing="xy"), -1).reshape(-1, 2))

    @property
    def velocities(self) -> Tensor:
        """Columns and rows a second of every displacement, `[D, 2]`."""
        return self.displacements / (self.lag * self.dt)

    def start(self, image: Tensor) -> CoherentState:
        """State settled on one grey image `[..., H, W]`."""
        batch, fields = image.shape[:-2], (self.rows.shape[0], self.columns.shape[0])
        return CoherentState(
            image,
            image.new_zeros(*batch, self.kept, *self.size),
            image.new_zeros(*batch, len(self.displacements), *fields),
            image.new_zeros(*batch, *fields),
            torch.zeros((), dtype=torch.int64),
        )

    def forward(self, frames: Tensor, state: CoherentState | None = None) -> tuple[Tensor, CoherentState]:
        images = grey(as_float(check_frames(frames, self.size))).unbind(-3)
        state = self.start(images[0]) if state is None else state
        maps = []
        for image in images:
            state = self.step(image, state)
            maps.append(self.maps(state))
        return torch.stack(maps, -4), state

    def advance(self, frames: Tensor, state: CoherentState | None = None) -> CoherentState:
        """The state after frames `[..., T, C, H, W]`, for those who do not need the maps of every frame."""
        for image in grey(as_float(check_frames(frames, self.size))).unbind(-3):
            state = self.step(image, self.start(image) if state is None else state)
        assert state is not None
        return state

    def step(self, image: Tensor, state: CoherentState) -> CoherentState:
        """The state after one more grey image `[..., H, W]`."""
        slow = low_pass_step(image, state.slow, self.a_high)
        high = without_mean(image - slow, self.params.around)
        past = torch.cat([state.past[..., 1:, :, :], high.unsqueeze(-3)], -3)
        steps = state.steps + 1
        if int(steps) % self.every:
            return state._replace(slow=slow, past=past, steps=steps)
        before = past[..., -1 - self.lag, :, :]
        rows, columns = self.rows.to(high.dtype), self.columns.to(high.dtype)
        wide = functional.pad(before, (self.reach,) * 4)
        height, width = self.size
        count = 2 * self.reach + 1
        parts = []
        for down in range(count):
            # What moved by (x, y) was at (-x, -y) before.
            line = wide[..., 2 * self.reach - down : 2 * self.reach - down + height, :]
            shifted = line.unfold(-1, width, 1).movedim(-2, -3).flip(-3)
            parts.append(pool(shifted * high.unsqueeze(-3), rows, columns))
        products = torch.cat(parts, -3)
        power = pool((high.square() + before.square()) / 2, rows, columns)
        return CoherentState(
            slow,
            past,
            torch.lerp(state.correlations, products, self.a),
            torch.lerp(state.power, power, self.a),
            steps,
        )

    def maps(self, state: CoherentState) -> Tensor:
        """Correlations over the power of their field, `[..., D, R, C']`; 0 where nothing is."""
        level = state.power.amax((-1, -2), keepdim=True)
        power = torch.maximum(state.power, 0.05 * level).clamp_min(torch.finfo(level.dtype).tiny).unsqueeze(-3)
        return state.correlations / power


def without_mean(image: Tensor, side: int) -> Tensor:
    """An image `[..., H, W]` less the mean of the `side` x `side` pixels around each."""
    flat = image.reshape(-1, 1, *image.shape[-2:])
    mean = functional.avg_pool2d(flat, side, 1, side // 2, count_include_pad=False)
    return image - mean.reshape(image.shape)
