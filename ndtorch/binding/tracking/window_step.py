"""One update of the windows that follow objects: where they go, what they bind, which are closed and opened."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import torch
import torch.nn.functional as F
from torch import Tensor

from ndtorch.binding.covariance import sample_step
from ndtorch.binding.tracking.params import WindowParams
from ndtorch.vision.alpha_beta import corrected, predicted
from ndtorch.vision.features import GROUPS
from ndtorch.vision.motion import Border
from ndtorch.vision.roots import root


class Windows(Protocol):
    """What a step needs of `ndtorch.binding.tracking.windows.Windows`.

    Attributes:
        params: constants.
        dt, every: seconds of a sample, and samples of a step.
        grid: rows and columns of fields; border: what lies beyond them.
        centers: of the fields, `[F, 2]`; directions: towards which the motion signals point, `[4, 2]`.
    """

    params: WindowParams
    dt: float
    every: int
    grid: tuple[int, int]
    border: Border
    centers: Tensor
    directions: Tensor

    def offset(self, difference: Tensor) -> Tensor:
        """The shortest way of a difference of places."""


class WindowState(NamedTuple):
    """State of `Windows`: K windows a trial.

    Attributes:
        low: low-passed signals, `[..., R, C, 10]`.
        peak: largest motion of any field lately, `[...]`.
        place: row and column in fields, `[..., K, 2]`; 0, 0 is the center of the first field.
        velocity: fields a second, `[..., K, 2]`.
        open: windows in use, `[..., K]` bool.
        age, unseen: seconds since the window was opened, and since it last saw its object, `[..., K]`.
        mean: what the high-pass has taken for the mean of a window's signals, `[..., K, 10]`.
        covariance: running covariance of a window's signals, `[..., K, 10, 10]`.
        light_mean, light: the same of the windows' motion, `[..., K]` and `[..., K, K]`.
        steps: samples taken since the start, int64 scalar.
    """

    low: Tensor
    peak: Tensor
    place: Tensor
    velocity: Tensor
    open: Tensor
    age: Tensor
    unseen: Tensor
    mean: Tensor
    covariance: Tensor
    light_mean: Tensor
    light: Tensor
    steps: Tensor


def windows_step(low: Tensor, state: WindowState, windows: Windows) -> WindowState:
    """One update of all windows with the low-passed signals `[..., R, C, 10]`."""
    p, dt = windows.params, windows.every * windows.dt
    tiny = torch.finfo(low.dtype).tiny
    signals = low.flatten(-3, -2)  # [..., F, 10]
    motion = signals[..., GROUPS["motion"]].clamp_min(0)
    # The detectors multiply brightness with brightness; the root is proportional to it again.
    energy = root(motion.sum(-1))  # [..., F]
    peak = torch.maximum(state.peak * (1 - dt / p.tau_peak), energy.amax(-1))
    median = energy.median(-1).values  # objects fill few fields: what most show is noise

    # Follow: predict, then move towards the motion in the window's own direction.
    place = predicted(state.place, state.velocity, dt)
    away = windows.offset(windows.centers - place.unsqueeze(-2))  # [..., K, F, 2]
    window = torch.exp(-away.square().sum(-1) / (2 * p.window**2)) * state.open.unsqueeze(-1)
    shared = window * window / (window.sum(-2, keepdim=True) + p.crowd)
    own = root(own_direction(state, windows) @ motion.mT)  # [..., K, F]
    weight = shared * own
    seen = state.open & ((window * own).amax(-1) > torch.maximum(p.visible * peak, median).unsqueeze(-1))
    towards = (weight.unsqueeze(-1) * away).sum(-2) / weight.sum(-1, keepdim=True).clamp_min(tiny)
    towards = towards.clamp(-p.reach, p.reach) * seen.unsqueeze(-1)
    young = (state.age < p.young).unsqueeze(-1)
    alpha = torch.where(young, max(p.gain, p.young_gain), p.gain)
    beta = torch.where(young, max(p.drift, p.young_drift), p.drift)
    place, velocity = corrected(place, state.velocity, towards, alpha, beta, p.updates * dt)
    speed = velocity.norm(dim=-1, keepdim=True)
    velocity = velocity * (p.fastest / speed.clamp_min(p.fastest))
    age = state.age + dt * state.open
    unseen = torch.where(seen, 0.0, state.unseen + dt)

    # Bind: covariances of what the window sees, and of the windows' motion with each other.
    first = (state.age < dt / 2).unsqueeze(-1)
    total = window.sum(-1, keepdim=True).clamp_min(tiny)
    inside = (window @ signals) / total
    a_high, take = dt / (p.tau_high + dt), seen[..., None, None] * (dt / p.tau_bind)
    mean, covariance = sample_step(inside, state.mean, state.covariance, first, a_high, take)
    light = weight.sum(-1) / shared.sum(-1).clamp_min(tiny)
    pairs = torch.where(first | first.mT, 0.0, state.light)
    light_mean, pairs = sample_step(light, state.light_mean, pairs, first.squeeze(-1), a_high, dt / p.tau_light)

    now = state._replace(
        peak=peak,
        place=place,
        velocity=velocity,
        age=age,
        unseen=unseen,
        mean=mean,
        covariance=covariance,
        light_mean=light_mean,
        light=pairs,
    )
    closing, place = closed(now, windows)
    return opened(now._replace(open=state.open & ~closing, place=place), energy, median, windows)


def own_direction(state: WindowState, windows: Windows) -> Tensor:
    """How much each of the four motion signals counts for a window, `[..., K, 4]`: all alike while it is young."""
    p = windows.params
    speed = state.velocity.norm(dim=-1, keepdim=True)
    along = (state.velocity / speed.clamp_min(1e-6)) @ windows.directions.to(speed.dtype).mT
    sure = ((state.age.unsqueeze(-1) - p.aim) / p.aimed).clamp(0, 1) * (speed > p.slow * p.fastest)
    counts: Tensor = sure * along.clamp_min(0).square() + (1 - sure)
    return counts


def closed(state: WindowState, windows: Windows) -> tuple[Tensor, Tensor]:
    """Windows to be closed, `[..., K]`: lost, never confirmed, or following the object of an older one; and places.

    Two that fluctuate alike follow the ends of one long object: the older one goes on in the middle, from where it
    claims both.
    """
    p = windows.params
    lost = (state.unseen > p.lost) | ((state.age < p.confirm) & (state.unseen > p.blind))
    away = windows.offset(state.place.unsqueeze(-2) - state.place.unsqueeze(-3))
    apart = away.norm(dim=-1)
    drift = (state.velocity.unsqueeze(-2) - state.velocity.unsqueeze(-3)).norm(dim=-1)
    deviation = state.light.diagonal(dim1=-2, dim2=-1).clamp_min(torch.finfo(apart.dtype).tiny).sqrt()
    correlation = state.light / (deviation.unsqueeze(-1) * deviation.unsqueeze(-2))
    older = state.age.unsqueeze(-2) > state.age.unsqueeze(-1)
    number = torch.arange(p.most, device=apart.device)
    older = older | ((state.age.unsqueeze(-2) == state.age.unsqueeze(-1)) & (number < number.unsqueeze(-1)))
    both = state.open.unsqueeze(-2) & state.open.unsqueeze(-1)
    known = torch.minimum(state.age.unsqueeze(-2), state.age.unsqueeze(-1)) > p.known
    pairs = both & older & (drift < p.alike_speed)
    ends = pairs & (apart >= p.same) & (apart < p.near) & (correlation > p.alike) & known
    closing = lost | (pairs & (apart < p.same) | ends).any(-1)
    count = ends.sum(-2).unsqueeze(-1) + 1
    return closing, state.place + torch.where(ends.unsqueeze(-1), away, 0.0).sum(-3) / count


def opened(state: WindowState, energy: Tensor, median: Tensor, windows: Windows) -> WindowState:
    """Open one window where the largest motion is that no window claims; `energy` `[..., F]`, its `median` `[...]`."""
    p = windows.params
    away = windows.offset(windows.centers - state.place.unsqueeze(-2)).norm(dim=-1)
    claimed = ((away < p.claim) & state.open.unsqueeze(-1)).any(-2)
    grid = energy.reshape(*energy.shape[:-1], *windows.grid)
    summit = local_maximum(grid, windows.border).flatten(-2)
    free = torch.where(claimed | ~summit, 0.0, energy)
    height, where = free.max(-1)
    wanted = (height > p.birth * state.peak) & (height > p.contrast * median)
    wanted = wanted & ~state.open.all(-1) & (height > 0)
    slot = (~state.open).to(torch.uint8).argmax(-1)
    number = torch.arange(p.most, device=slot.device)
    new = (number == slot.unsqueeze(-1)) & wanted.unsqueeze(-1)
    place = windows.centers.to(energy.dtype)[where].unsqueeze(-2)
    return state._replace(
        place=torch.where(new.unsqueeze(-1), place, state.place),
        velocity=torch.where(new.unsqueeze(-1), 0.0, state.velocity),
        open=state.open | new,
        age=torch.where(new, 0.0, state.age),
        unseen=torch.where(new, 0.0, state.unseen),
        covariance=torch.where(new[..., None, None], 0.0, state.covariance),
    )


def local_maximum(energy: Tensor, border: Border) -> Tensor:
    """Fields that no neighbour exceeds, `[..., R, C]` bool."""
    flat = energy.reshape(-1, 1, *energy.shape[-2:])
    padded = F.pad(flat, (1, 1, 1, 1), mode="circular" if border == "wrap" else "replicate")
    return (F.max_pool2d(padded, 3, 1) == flat).reshape(energy.shape)
