"""Motion in every direction and at every pace: space-time energy at a grid of velocities, in overlapping fields."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from ndtorch.arguments import check_batch, check_finite, check_fits, check_number, check_size, check_state, rows_in
from ndtorch.config import Constants, constant
from ndtorch.errors import InputError
from ndtorch.vision.frames import as_float, check_frames, grey
from ndtorch.vision.receptive_fields import pool
from ndtorch.vision.temporal import low_pass_step, smoothing_factor

LEAST = 0.6
"""Power of a field, against the mean of the frame, under which a share of it would be of a dot or two."""


MOST_VELOCITIES = 100
"""Velocities that are looked for on one side of 0, along rows and along columns."""


class CoherentParams(Constants):
    """Constants of `CoherentMotion`."""

    around: int = constant(9, "side of the window whose mean is taken off, pixels, odd", gt=0)
    tau_high: float = constant(0.5, "high-pass of every pixel, seconds", ge=0)
    every: float = constant(0.08, "time between frames that are kept, seconds", gt=0)
    kept: float = constant(2.0, "time for which they are kept, seconds", gt=0)
    last: float = constant(0.4, "delay beyond which frames are not compared, shorter ones the more, seconds", gt=0)
    fastest: float = constant(45.0, "fastest motion that is looked for, pixels a second", gt=0)
    step: float = constant(9.0, "distance of neighbouring velocities, pixels a second", gt=0)
    coarse: float = constant(2.0, "pixels of a frame that are one, a side, where all are looked for", ge=1)
    field: float = constant(8.0, "distance of neighbouring fields, pixels", ge=1)
    window: float = constant(16.0, "deviation of a field, pixels", gt=0)


class CoherentState(NamedTuple):
    """State of `CoherentMotion`.

    Attributes:
        slow: what the high-pass has taken for the mean, `[..., H, W]`.
        past: high-passed frames, `every` apart, oldest first, `[..., B, H, W]`.
        steps: frames taken, int64 scalar.
    """

    slow: Tensor
    past: Tensor
    steps: Tensor


class CoherentMotion(nn.Module):
    """How much of what is in a field moves at each velocity of a grid.

    A Hassenstein-Reichardt detector multiplies what is at a place with what was at its neighbor a moment ago. Here all
    frames of `kept` seconds are moved on to where they would be now at a velocity, and multiplied at every delay up to
    `last`: correlators with many bases that agree, whose memory moves along. Random dots that move independently
    fill a ring of velocities, dots that move together make a peak. Contrast of both signs counts, light alone does
    not. All velocities are tried at a coarse resolution; `energies` looks closer at one.

    Args:
        size: height and width of the frames.
        dt: seconds between frames.
        params: constants.

    Shapes:
        frames `[..., T, C, H, W]` -> `[..., T, D, R, C']`, D velocities, R x C' fields; 1 is a field in which
        everything moves so. State: `CoherentState`; `None` settles on the first frame. The maps of one frame take as
        long as many frames without: `advance` and `maps` are for those who want few.

    Raises:
        InputError: frames that cannot be used, or fewer than one field.
    """

    rows: Tensor
    columns: Tensor
    velocities: Tensor
    band: Tensor
    seen: Tensor

    def __init__(self, size: tuple[int, int], dt: float = 0.04, params: CoherentParams | None = None) -> None:
        super().__init__()
        c = self.params = params or CoherentParams()
        check_size("size", size, 1)
        check_number("dt", dt, above=0, unit="seconds")
        self.size, self.dt = size, dt
        self.every = max(1, round(c.every / dt))
        self.apart = self.every * dt
        """Seconds between kept frames."""
        self.kept = rows_in("kept", c.kept, self.apart, least=2)
        self.a_high = smoothing_factor(c.tau_high, dt)
        self.grid = (round(size[0] / c.coarse), round(size[1] / c.coarse))
        if min(round(side / c.field) for side in size) < 1:
            raise InputError(f"size must hold a field: {size[0]}x{size[1]} pixels have no field of {c.field:g} pixels")
        for name, length, count in zip(("rows", "columns"), size, self.grid, strict=True):
            self.register_buffer(name, windows(length, count, max(1, round(length / c.field)), c.window))
        reach = math.floor(c.fastest / c.step)
        if not reach <= MOST_VELOCITIES:
            raise InputError(f"fastest must be {MOST_VELOCITIES} steps of {c.step:g} at most, got {c.fastest:g}")
        one = c.step * torch.arange(-reach, reach + 1)
        every = torch.stack(torch.meshgrid(one, one, indexing="xy"), -1).reshape(-1, 2)
        # Columns and rows a second.
        self.register_buffer("velocities", every[every.norm(dim=-1) <= c.fastest * (1 + 1e-6)])
        self.register_buffer("band", delays(self.kept, c.last / self.apart))
        # How much of each field was in the frame all the time, at each velocity, `[D, R, C']`.
        self.register_buffer("seen", self.pooled(torch.ones(self.kept, *self.grid)))

    def start(self, image: Tensor) -> CoherentState:
        """State settled on one grey image `[..., H, W]`."""
        past = image.new_zeros(*image.shape[:-2], self.kept, *self.size)
        return CoherentState(image, past, torch.zeros((), dtype=torch.int64))

    def forward(self, frames: Tensor, state: CoherentState | None = None) -> tuple[Tensor, CoherentState]:
        check_state(state, CoherentState)
        images = grey(as_float(check_frames(frames, self.size))).unbind(-3)
        state = self.start(images[0]) if state is None else self.known(state, images[0])
        maps = []
        for image in images:
            state = self.step(image, state)
            maps.append(self.maps(state))
        return torch.stack(maps, -4), state

    def advance(self, frames: Tensor, state: CoherentState | None = None) -> CoherentState:
        """The state after frames `[..., T, C, H, W]`, for those who do not need the maps of every frame."""
        check_state(state, CoherentState)
        images = grey(as_float(check_frames(frames, self.size))).unbind(-3)
        state = self.start(images[0]) if state is None else self.known(state, images[0])
        for image in images:
            state = self.step(image, state)
        return state

    def known(self, state: CoherentState, image: Tensor) -> CoherentState:
        """A state that goes with images like this one.

        Raises:
            InputError: its own images are others, or not finite: what is kept would stay so for seconds.
        """
        check_batch(state, image.shape[:-2], "slow", "past")
        check_finite("state.slow", state.slow)
        check_finite("state.past", state.past)
        return state

    def step(self, image: Tensor, state: CoherentState) -> CoherentState:
        """The state after one more grey image `[..., H, W]`."""
        check_fits("state.slow", state.slow, image)
        slow, steps = low_pass_step(image, state.slow, self.a_high), state.steps + 1
        if int(steps) % self.every:
            return state._replace(slow=slow, steps=steps)
        high = without_mean(image - slow, self.params.around)
        return CoherentState(slow, torch.cat([state.past[..., 1:, :, :], high.unsqueeze(-3)], -3), steps)

    @property
    def inside(self) -> Tensor:
        """How much of each field is within the frame, `[R, C']`."""
        return self.rows.sum(1)[:, None] * self.columns.sum(1)

    def since(self, state: CoherentState) -> float:
        """Seconds since the latest frame that was kept."""
        return float(int(state.steps) % self.every) * self.dt

    def maps(self, state: CoherentState) -> Tensor:
        """What moves at each velocity over the power of its field, `[..., D, R, C']`; 0 where nothing is."""
        batch = state.past.shape[:-2]
        past = functional.adaptive_avg_pool2d(state.past.reshape(-1, 1, *self.size), self.grid)
        past = past.reshape(*batch, *self.grid)
        power = pool(past.square().mean(-3), self.rows.to(past.dtype), self.columns.to(past.dtype))
        level = past.square().mean((-1, -2, -3))[..., None, None] * self.inside.to(past.dtype)
        power = torch.maximum(power, LEAST * level)
        return self.pooled(past) / power.clamp_min(torch.finfo(power.dtype).tiny).unsqueeze(-3)

    def pooled(self, past: Tensor) -> Tensor:
        """Energy of coarse frames `[..., B, H', W']` at every velocity in every field, `[..., D, R, C']`."""
        scale = torch.tensor([g / side for g, side in zip(self.grid[::-1], self.size[::-1], strict=True)])
        pace = (self.apart * scale * self.velocities.cpu()).tolist()
        rows, columns = self.rows.to(past.dtype), self.columns.to(past.dtype)
        return torch.stack([pool(self.energy(moved_on(past, one)), rows, columns) for one in pace], -3)

    def energy(self, moved: Tensor) -> Tensor:
        """Products of frames that were moved on `[..., B, H, W]` at all delays, their mean, `[..., H, W]`."""
        flat = moved.flatten(-2)
        return ((self.band.to(flat.dtype) @ flat) * flat).sum(-2).reshape(*moved.shape[:-3], *moved.shape[-2:])


def windows(length: int, points: int, count: int, deviation: float) -> Tensor:
    """Gaussian windows over a line of `points`, `[count, points]`; what lies beyond the line is taken for nothing."""
    places = (torch.arange(points) + 0.5) * (length / points)
    centers = (torch.arange(count) + 0.5) * (length / count)
    weights = torch.exp(-0.5 * ((places - centers[:, None]) / deviation) ** 2)
    return weights * (length / points / (deviation * math.sqrt(2 * math.pi)))


def delays(count: int, last: float) -> Tensor:
    """Weights of products of `count` frames, `[B, B]`: less with delay, none from `last` steps on; they add up to 1.

    That is how many dots are still there after a delay, where they live for `last` steps.
    """
    share = torch.tensor([max(1.0 - lag / last, 0.0) for lag in range(count)])
    share[1] = max(float(share[1]), 1e-3)
    share = share / share[1:].sum()
    weights = torch.zeros(count, count)
    for lag in range(1, count):
        weights += share[lag] * torch.ones(count - lag).diag(-lag) / (count - lag)
    return weights


def moved_on(past: Tensor, pace: tuple[float, float] | list[float]) -> Tensor:
    """Images `[..., B, H, W]`, the latest last, each moved to where it would be now by whole pixels, `pace` columns and
    rows from one to the next; 0 comes in.
    """
    count, height, width = past.shape[-3:]
    out = torch.zeros_like(past)
    for n in range(count):
        x, y = (round(part * (count - 1 - n)) for part in pace)
        if abs(x) < width and abs(y) < height:
            new = out[..., n, max(0, y) : height + min(0, y), max(0, x) : width + min(0, x)]
            new.copy_(past[..., n, max(0, -y) : height + min(0, -y), max(0, -x) : width + min(0, -x)])
    return out


def without_mean(image: Tensor, side: int) -> Tensor:
    """An image `[..., H, W]` less the mean of the `side` x `side` pixels around each."""
    flat = image.reshape(-1, 1, *image.shape[-2:])
    mean = functional.avg_pool2d(flat, side, 1, side // 2, count_include_pad=False)
    return image - mean.reshape(image.shape)
