"""Front end for video of a camera: ten signals of every field of a coarse grid, made to survive a real camera."""

from __future__ import annotations

import math
from typing import NamedTuple, TypeVar

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor, nn

from ndtorch.arguments import check_dense, check_size, check_state, is_finite
from ndtorch.errors import InputError
from ndtorch.kernels.block_means import block_means
from ndtorch.kernels.switch import kernels_wanted
from ndtorch.tree import leaves, mapped
from ndtorch.vision.camera.background import BackgroundState, background_start, background_step, core, quick_step
from ndtorch.vision.camera.colors import balanced, hues_and_shades
from ndtorch.vision.camera.exposure import exposure_gain
from ndtorch.vision.camera.params import CameraParams
from ndtorch.vision.camera.quick_signals import Weights, quick_signals
from ndtorch.vision.camera.sampling import every_other
from ndtorch.vision.camera.scales import LEVELS, ScaleState, scale_start, scale_step
from ndtorch.vision.fields import field_weights, means, pool
from ndtorch.vision.frames import as_float, check_frames
from ndtorch.vision.one_pass import pixels
from ndtorch.vision.orientation import OrientedDoG
from ndtorch.vision.roots import root
from ndtorch.vision.temporal import smoothing_factor

Row = tuple[Tensor, ...]
"""Of one time step what `FieldSignals` has of many, but for the time."""

State = TypeVar("State", BackgroundState, ScaleState)


def replaced(where: Tensor, new: State, old: State) -> State:
    """The new state where a single number says so, the old one otherwise."""
    fresh = leaves(new)
    return mapped(old, lambda name, part: torch.where(where.view(()), fresh[name], part))


class FieldSignals(NamedTuple):
    """What the front end makes of T' time steps.

    Attributes:
        signals: the ten features in every field, `[T', R, C, 10]`.
        motion: opponent motion to the right and downward, in squared units of contrast, `[T', R, C, 2]`.
        presence: share of every field in which something stands out, `[T', R, C]`.
        noise: the threshold that a pixel's difference had to pass, median over the picture, `[T']`.
        level: level of the pyramid that motion was taken from, `[T']` int64.
        time: seconds since the first frame, `[T']` float64.
        cut: whether a new scene begins, `[T']` bool: nothing of it is known yet, and nothing stands out.
        shades: what is white, grey and black of what stands out, and what has a hue, in every field, `[T', R, C, 4]`.
    """

    signals: Tensor
    motion: Tensor
    presence: Tensor
    noise: Tensor
    level: Tensor
    time: Tensor
    cut: Tensor
    shades: Tensor


class CameraState(NamedTuple):
    """State of `CameraFrontEnd`: background, detectors, and the frames waiting to be averaged.

    Attributes:
        background, scales: None before the first step.
        waiting: sum of the frames of an unfinished group, `[3, h, w]`.
        frames: frames seen, int64 scalar.
    """

    background: BackgroundState | None
    scales: ScaleState | None
    waiting: Tensor
    frames: Tensor


class CameraFrontEnd(nn.Module):
    """Frames of a camera's video -> ten signals of overlapping fields.

    In this order, all of it causal: the frame is shrunk to 56 rows, and averaged over so many frames that at most
    30 a second remain; its exposure is corrected against a slow background (`exposure_gain`); what differs from that
    background by more than the measured noise is kept (`background_step`, `core`); from it come motion, by detectors
    at an image scale chosen by the measured displacement (`scale_step`), and orientation, less what all three
    filters share; colors are those of the frame where something stands out, inhibiting one another at every pixel,
    or shades of grey where that leaves nothing (`hues_and_shades`).
    All are averaged over the fields of a coarse grid and compressed. Motion is opponent after averaging, so that
    flicker, which goes nowhere, has none.

    Args:
        size: height and width of the frames, pixels.
        fps: frames a second.
        parts: what is on, and the constants.

    Shapes:
        frames `[T, C, H, W]` (uint8 or 0..1) -> `FieldSignals` with T' rows, T' about T below 30 frames a second.
        State `CameraState`; `None` starts on the first frame. Chunks of any length give the same result.

    Raises:
        InputError: frames of another shape or type; a rate, size, grid or scale out of range.
    """

    def __init__(self, size: tuple[int, int], fps: float, parts: CameraParams | None = None) -> None:
        super().__init__()
        self.parts = p = parts or CameraParams()
        if not (is_finite(fps) and fps > 0):
            raise InputError(f"fps must be a positive number of frames a second, got {repr(fps)[:40]}")
        check_size("size", size, 16)
        if p.scale != "auto" and p.scale not in range(LEVELS):
            raise InputError(f"scale must be a level from 0 to {LEVELS - 1}, got {p.scale}")
        self.size, self.fps = (int(size[0]), int(size[1])), fps
        self.group = max(1, math.ceil(fps / p.fastest))
        self.dt = self.group / fps
        self.small = small_size(self.size, p.height)
        self.orientation = OrientedDoG(self.small, center=p.center, surround=p.surround, border="reflect", exact=True)
        for level in range(LEVELS):
            # On a coarser level a field's weights are those of its blocks of pixels.
            for side, n, fields in zip(("rows", "columns"), self.small, p.grid, strict=True):
                tents = means(field_weights(torch.arange(n) + 0.5, n, fields, "open", "tent"))
                weights = tents.reshape(fields, -1, 2**level).sum(-1)
                self.register_buffer(f"{side}_{level}", weights)
        self.a_exposure = smoothing_factor(p.tau_exposure, self.dt)
        self.a_background = smoothing_factor(p.tau_background, self.dt)
        self.a_deviation = smoothing_factor(p.tau_deviation, self.dt)
        self.a_high, self.a_low = smoothing_factor(p.tau_high, self.dt), smoothing_factor(p.tau_low, self.dt)

    def forward(self, frames: Tensor, state: CameraState | None = None) -> tuple[FieldSignals, CameraState]:
        check_state(state, CameraState)
        check_dense("frames", frames)
        if frames.ndim != 4:
            raise InputError(f"frames must have shape [T, C, H, W], got {tuple(frames.shape)}")
        frames = check_frames(frames, self.size)
        if state is None:
            waiting = torch.zeros(3, *self.small, device=frames.device)
            state = CameraState(None, None, waiting, torch.zeros((), dtype=torch.int64))
        background, scales, waiting = state.background, state.scales, state.waiting
        rows: list[Row] = []
        last: list[int] = []
        # Frames that wait are counted only where there can be some: a number cannot be read where this is exported.
        counted = int(state.frames) if self.group > 1 else 0
        for k, frame in enumerate(shrink(frames, self.small)):
            waiting = waiting + frame
            if (counted + k + 1) % self.group == 0:
                if not torch.compiler.is_compiling() and not torch.isfinite(waiting.sum()):
                    raise InputError("frames must be finite, got NaN or infinite values")
                row, background, scales = self._step(waiting / self.group, background, scales)
                rows.append(row)
                last.append(k)
                waiting = torch.zeros_like(waiting)
        end = CameraState(background, scales, waiting, state.frames + len(frames))
        r, c = self.parts.grid
        if not rows:
            none = waiting.new_zeros(0)
            empty = FieldSignals(
                none.view(0, r, c, 10),
                none.view(0, r, c, 2),
                none.view(0, r, c),
                none,
                none.long(),
                none.to(torch.float64),
                none.bool(),
                none.view(0, r, c, 4),
            )
            return empty, end
        out = FieldSignals(
            torch.stack([row[0] for row in rows]),
            torch.stack([row[1] for row in rows]),
            torch.stack([row[2] for row in rows]),
            torch.stack([row[3] for row in rows]),
            torch.stack([row[4] for row in rows]),
            (state.frames + torch.tensor(last)).double() / self.fps,
            torch.stack([row[5] for row in rows]),
            torch.stack([row[6] for row in rows]),
        )
        return out, end

    def _step(
        self, frame: Tensor, background: BackgroundState | None, scales: ScaleState | None
    ) -> tuple[Row, BackgroundState, ScaleState]:
        """Signals, motion, presence, noise, level, cut and shades of one averaged small frame `[3, h, w]`."""
        p, given = self.parts, frame
        start = background_start(frame, p.first_deviation)
        background = start if background is None else background
        shares = (self.a_background, self.a_deviation, self.a_exposure)
        quick = quick_step(frame, background, shares, p)
        if quick is not None:
            frame, seen, shown, noise, after = quick
            row, scales = self._signals(frame, background.mean, seen, shown, scales)
            return (*row[:3], noise, row[3], torch.tensor(False), row[4]), after, scales
        gain, other = frame.new_ones(3, 1, 1), torch.zeros(1, 1, 1, dtype=torch.bool, device=frame.device)
        if p.exposure:
            gain, other = exposure_gain(frame, background.mean, p.gain_limit, p.darkest, p.lit)
            frame = frame / gain
        difference, threshold, cut, after = background_step(frame, background, self.a_background, self.a_deviation, p)
        cut = cut | other
        after = after._replace(mean=after.mean * gain**self.a_exposure)
        if torch.compiler.is_compiling() or cut:
            # A new scene starts as a film does, but for the clock.
            difference, frame = torch.where(cut, 0.0, difference), torch.where(cut, given, frame)
            after = replaced(cut, start, after)
            background = replaced(cut, start, background)
            if scales is not None:
                scales = replaced(cut, scale_start(torch.zeros_like(frame) if p.background else frame), scales)
        shown = ((difference.abs() / threshold).amax(0, keepdim=True) - 1).clamp(0, 1)
        noise = every_other(threshold).median()
        seen = core(difference, threshold) if p.noise_floor else difference
        if not p.background:
            seen = frame
        row, scales = self._signals(frame, background.mean, seen, shown, scales)
        return (*row[:3], noise, row[3], cut.view(()), row[4]), after, scales

    def _signals(
        self, frame: Tensor, ground: Tensor, seen: Tensor, shown: Tensor, scales: ScaleState | None
    ) -> tuple[tuple[Tensor, ...], ScaleState]:
        """Signals, motion, presence, level and shades, from the frame, its background and what differs."""
        p = self.parts
        scales = scale_start(torch.zeros_like(seen) if p.background else seen) if scales is None else scales
        filters, weights = (self.dt, self.a_high, self.a_low), self._weights()
        quick = quick_signals((frame, ground, seen, shown), scales, filters, weights, self.orientation, p)
        if quick is not None:
            return quick
        moved, level, scales = scale_step(seen, scales, self.dt, self.a_high, self.a_low, p)
        hue, shade = hues_and_shades(frame, ground, p)
        if not p.color_inhibition:
            hue = balanced(frame, ground, p)
        if p.background:
            hue = hue * shown
        fine = [self.orientation.images(seen.abs().amax(0)).abs(), hue, shown, shade * shown]
        fields = self._pool(torch.cat(fine), 0)
        parts = [self._pool(images, k) for k, images in moved.items()]
        motion = parts[0] if len(parts) == 1 else torch.stack(parts).index_select(0, level.view(1)).squeeze(0)
        x, y = motion
        directed = torch.stack([-x, x, y, -y]).clamp_min(0)
        # What all orientations share says that something is there, not how it stands: it would own every object.
        tilted = fields[:3] - fields[:3].amin(0)
        signals = torch.cat([directed, tilted, fields[3:6]])
        # Beside a hue, a shade is a shadow or an edge.
        shades = fields[7:]
        share = (shades[:-1].sum(0) / fields[6].clamp_min(p.palest)).clamp_max(1)
        white = p.shade * share
        shades = shades * torch.stack([white, white, white, 1 - share]).square()
        if p.compression:
            signals, shades = root(signals), root(shades)
        planes = (part.movedim(0, -1) for part in (signals, motion))
        return (*planes, fields[6], level, shades.movedim(0, -1)), scales

    def _pool(self, images: Tensor, level: int) -> Tensor:
        """Means over the fields of images on one level of the pyramid."""
        return pool(images, *self._weights()[level])

    def _weights(self) -> Weights:
        """Of the fields' rows and columns on each level."""
        return [(self.get_buffer(f"rows_{level}"), self.get_buffer(f"columns_{level}")) for level in range(LEVELS)]


def small_size(size: tuple[int, int], most: int = 56) -> tuple[int, int]:
    """Height and width of the small image: about `most` rows, both multiples of 4, never more than there are."""
    height, width = size
    rows = min(most, height) // 4 * 4
    columns = min(round(rows * width / height / 4) * 4, width // 4 * 4)
    return rows, max(4, columns)


def shrink(frames: Tensor, size: tuple[int, int]) -> Tensor:
    """Frames `[T, 3, H, W]` averaged over blocks to `[T, 3, *size]` float."""
    if frames.dtype in (torch.uint8, torch.float32) and kernels_wanted(frames):
        return torch.stack([by_kernel(frame, size) for frame in frames])
    factors = (frames.shape[-2] // size[0], frames.shape[-1] // size[1])
    if frames.shape[-2:] == (size[0] * factors[0], size[1] * factors[1]):
        return F.avg_pool2d(as_float(frames), factors)
    return F.adaptive_avg_pool2d(as_float(frames), size)


def by_kernel(frame: Tensor, size: tuple[int, int]) -> Tensor:
    """`shrink` of one frame `[3, H, W]` by a kernel."""
    given, beside = pixels(frame)
    lines = given.reshape(1, given.shape[0], -1) if beside else given
    means, whole = torch.empty(3, *size), frame.dtype == torch.uint8
    sums = np.empty((4, lines.shape[-1]), np.int32 if whole else np.float32)
    block_means(lines, 3 if beside else 1, 1 / 255 if whole else 1.0, sums, means.numpy())
    return means
