"""A slow background, the noise around it, and what stands out from both."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from ndtorch.kernels.apart import apart
from ndtorch.kernels.switch import kernels_wanted
from ndtorch.vision.camera.params import CameraParams
from ndtorch.vision.camera.sampling import every_other

# Mean magnitude of a normal variable against its standard deviation, and median of its magnitude likewise.
MEAN_SIZE, MEDIAN_SIZE = 0.798, 0.6745


class BackgroundState(NamedTuple):
    """What changes: the background and the mean deviation from it, each `[..., C, H, W]`, and frames seen `[]`."""

    mean: Tensor
    deviation: Tensor
    frames: Tensor


def background_start(frame: Tensor, deviation: float) -> BackgroundState:
    """State settled on one frame `[..., C, H, W]`."""
    return BackgroundState(frame, torch.full_like(frame, deviation), torch.zeros((), dtype=torch.int64))


def measured_noise(difference: Tensor) -> Tensor:
    """Standard deviation of a sensor's noise and a codec's, from a difference `[..., C, H, W]` -> `[..., C, 1, 1]`.

    The median of the magnitude over space: what moves covers less than half of the picture and does not count.
    """
    return middle(difference.abs()) / MEDIAN_SIZE


def middle(image: Tensor) -> Tensor:
    """Median over space, `[..., C, H, W]` -> `[..., C, 1, 1]`."""
    # Every fourth pixel tells as much, and a median is the dearest thing done here.
    return every_other(image).flatten(-2).median(-1).values[..., None, None]


def background_step(
    frame: Tensor, state: BackgroundState, a: float, a_deviation: float, params: CameraParams
) -> tuple[Tensor, Tensor, Tensor, BackgroundState]:
    """One step: the difference from the background, the threshold it has to pass, a new scene or not, the new state.

    The background follows with share `a` of the difference, but at least with 1 / (frames seen), which makes it the
    mean of the first frames; where something stands out it follows `hold` times as fast. The threshold is `spread`
    standard deviations of the noise: of the picture (see `measured_noise`), or of the pixel itself where that is
    larger, as leaves, screens and water flicker.

    The noise of a picture may be `growth` times the median over its pixels of what is known of theirs, and no more.
    Otherwise a cut would pass for noise, and for as long as the noise is remembered nothing would stand out from it.
    As it is, a cut stands out nearly everywhere, and by that it is told.

    Args:
        frame: `[..., C, H, W]`, its exposure corrected.
        a, a_deviation: smoothing factors of background and deviation.
        params: the share `hold` of `a` where something stands out, the `spread` that counts as standing out, the share
            of the picture that makes a `cut`, and what is taken for granted at first.

    Returns:
        difference `[..., C, H, W]`, threshold `[..., C, H, W]`, whether this is a new scene `[..., 1, 1, 1]`, state.
    """
    p = params
    difference = frame - state.mean
    known = state.deviation / MEAN_SIZE
    noise = torch.minimum(measured_noise(difference), p.growth * middle(known)).clamp_min(p.quietest)
    threshold = p.spread * torch.maximum(noise, known)
    out = ((difference.abs() > threshold).any(-3, keepdim=True)).to(frame.dtype)
    seen = state.frames + 1
    # In double precision: as numbers, whether this is run or exported.
    pace = (1 / (seen + 1).double()).clamp_min(a)
    mean = state.mean + (pace * (1 - (1 - p.hold) * out)) * difference
    # What passes by is no noise: its deviation counts as little more than what is known already.
    size = torch.minimum(difference.abs(), p.outlier * torch.maximum(noise, state.deviation))
    pace = (1 / (seen + p.first_frames).double()).clamp_min(a_deviation)
    deviation = state.deviation + pace * (size - state.deviation)
    cut = out.mean((-1, -2), keepdim=True) > p.cut
    return difference, threshold, cut, BackgroundState(mean, deviation, seen)


def core(difference: Tensor, threshold: Tensor) -> Tensor:
    """Soft threshold: nothing of a difference below the threshold, and what is beyond it above."""
    return difference - torch.minimum(torch.maximum(difference, -threshold), threshold)


def quick_step(
    frame: Tensor, state: BackgroundState, shares: tuple[float, float, float], params: CameraParams
) -> tuple[Tensor, Tensor, Tensor, Tensor, BackgroundState] | None:
    """`exposure_gain`, `background_step` and `core` by a kernel; None where they are to be done by torch.

    Args:
        frame: `[3, h, w]`.
        state: before.
        shares: smoothing factors of background, deviation, and the background's exposure.
        params: as of `background_step`.

    Returns:
        the frame without its gain and what of the difference counts `[3, h, w]`, by how much it is beyond the threshold
        `[1, h, w]`, median of the threshold `[]`, and the state; None also where a new scene begins.
    """
    parts = (frame, state.mean, state.deviation)
    if not params.background or any(part.dtype != torch.float32 for part in parts) or not kernels_wanted(*parts):
        return None
    from ndtorch.kernels.apart import ApartNumbers

    names = ApartNumbers._fields[ApartNumbers._fields.index("gain_limit") :]
    numbers = (getattr(params, name) for name in names)
    constants = ApartNumbers(params.exposure, params.noise_floor, *shares, MEAN_SIZE, MEDIAN_SIZE, *map(float, numbers))
    corrected, seen, mean, deviation = (torch.empty_like(frame) for _ in range(4))
    shown = torch.empty(1, *frame.shape[1:])
    given = (part.contiguous().numpy() for part in parts)
    results = (corrected.numpy(), seen.numpy(), shown[0].numpy(), mean.numpy(), deviation.numpy())
    noise, cut = apart(*given, int(state.frames), constants, *results)
    if cut:
        return None
    after = BackgroundState(mean, deviation, state.frames + 1)
    return corrected, seen, shown, frame.new_tensor(noise), after
