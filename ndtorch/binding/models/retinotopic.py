"""Where the objects are: files that follow them over a grid of receptive fields and bind what fluctuates there."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from ndtorch.binding.feedback import settled
from ndtorch.binding.readout.owners import features_by_group
from ndtorch.errors import InputError
from ndtorch.vision.features import FEATURES, GROUPS
from ndtorch.vision.motion import Border, check_border

DIRECTIONS = ((0.0, -1.0), (0.0, 1.0), (1.0, 0.0), (-1.0, 0.0))
"""Rows and columns towards which the motion signals left, right, down and up point."""


@dataclass(frozen=True)
class RetinotopicParams:
    """Constants of `RetinotopicBinding`; lengths in fields (spacings of the grid), times in seconds.

    Args:
        files: most objects at a time, K.
        period: time between updates.
        tau_low: low-pass on the signals.
        window: standard deviation of a file's receptive field.
        visible: a file sees its object where its motion is above this share of the recent largest.
        birth: a file is opened where unclaimed motion is above this share.
        contrast: and this many times the median over all fields.
        claim: radius within which a file claims all motion.
        tau_peak: memory of the recent largest.
        gain, drift: of the alpha-beta filter that follows the object; larger while a file is young.
        fastest: speed limit, fields a second.
        confirm: age at which a file counts as an object; before that it is closed as soon as it sees nothing.
        lost: time without sight after which a file is closed.
        same: files nearer than this that move alike are one.
        near, alike: files nearer than `near` that move alike and fluctuate with a correlation above `alike` are one.
        alike_speed: difference of velocities up to which two files move alike, fields a second.
        tau_high: high-pass on a file's signals.
        tau_bind: memory of a file's covariances.
        tau_light: memory of the covariances between files.
    """

    files: int = 8
    period: float = 0.05
    tau_low: float = 0.05
    window: float = 0.96
    visible: float = 0.12
    birth: float = 0.22
    contrast: float = 2.5
    claim: float = 1.66
    tau_peak: float = 10.0
    gain: float = 0.5
    drift: float = 0.15
    fastest: float = 4.0
    confirm: float = 0.8
    lost: float = 2.0
    same: float = 0.7
    near: float = 2.1
    alike: float = 0.8
    alike_speed: float = 0.8
    tau_high: float = 1.0
    tau_bind: float = 3.0
    tau_light: float = 2.0

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if not (math.isfinite(value) and value > 0):
                raise InputError(f"{item.name} must be a positive number, got {value}")


class RetinotopicState(NamedTuple):
    """State of `RetinotopicBinding`: K files a trial.

    Attributes:
        low: low-passed signals, `[..., R, C, 10]`.
        peak: largest motion of any field lately, `[...]`.
        place: row and column in fields, `[..., K, 2]`; 0, 0 is the centre of the first field.
        velocity: fields a second, `[..., K, 2]`.
        open: files in use, `[..., K]` bool.
        age, unseen: seconds since the file was opened, and since it last saw its object, `[..., K]`.
        mean: what the high-pass has taken for the mean of a file's signals, `[..., K, 10]`.
        covariance: running covariance of a file's signals, `[..., K, 10, 10]`.
        light_mean, light: the same of the files' motion, `[..., K]` and `[..., K, K]`.
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


class LocatedObject(NamedTuple):
    """An object with its place.

    Attributes:
        file: number of the file that follows it.
        features: strength of every feature, each group over its largest; at least a third.
        place: column and row in pixels, x to the right and y down.
        velocity: pixels a second, x to the right and y down.
        age: seconds since it was first seen.
    """

    file: int
    features: dict[str, float]
    place: tuple[float, float]
    velocity: tuple[float, float]
    age: float


class RetinotopicBinding(nn.Module):
    """Follows objects over retinotopic glomeruli, and learns of each which signals fluctuate together.

    Whole-field sums cannot tell apart bars of one colour, bars that fluctuate in phase, or equal bars [C §5.5.2];
    sums over small fields can. Lateral competition picks the fields that move most; a *file* is opened there. Its
    receptive field, a window over the grid, then goes with the object: it is predicted from the velocity, and
    drawn to the motion in the object's own direction, which files share where their windows overlap. What the
    window sees is the object alone most of the time, and its fluctuations are the object's own.

    Binding is what the competitive rule converges to where one object dominates: the strongest neuron k owns the file,
    its column of weights is `<h_n h_k> / <h_k^2>` (h: high-passed signals through the settled first stage). Two files
    side by side that fluctuate together are one object.

    Args:
        grid: rows and columns of fields.
        spacing: pixels from field to field.
        dt: time step, s.
        border: "wrap" where the scene is a torus.
        first_stage: weights of the first stage, `[10, 10]`; None for none.
        params: constants.

    Shapes:
        signals `[..., T, R, C, 10]` -> number of objects at every step `[..., T]`, `RetinotopicState`.

    Raises:
        InputError: signals of another shape, or parameters out of range.
    """

    centres: Tensor
    passage: Tensor
    directions: Tensor

    def __init__(
        self,
        grid: tuple[int, int],
        spacing: float,
        dt: float = 0.01,
        border: Border = "wrap",
        first_stage: Tensor | None = None,
        params: RetinotopicParams | None = None,
    ) -> None:
        super().__init__()
        check_border(border)
        if min(grid) < 3 or not spacing > 0 or not dt > 0:
            raise InputError(f"expected at least 3 x 3 fields, spacing > 0 and dt > 0, got {grid}, {spacing}, {dt}")
        self.grid, self.spacing, self.dt, self.border = grid, spacing, dt, border
        self.params = params or RetinotopicParams()
        self.every = max(1, round(self.params.period / dt))
        rows, columns = torch.meshgrid(torch.arange(float(grid[0])), torch.arange(float(grid[1])), indexing="ij")
        weights = torch.zeros(10, 10) if first_stage is None else first_stage
        self.register_buffer("centres", torch.stack([rows, columns], -1).flatten(0, 1), persistent=False)
        self.register_buffer("passage", settled(weights), persistent=False)
        self.register_buffer("directions", torch.tensor(DIRECTIONS), persistent=False)

    def start(self, first: Tensor) -> RetinotopicState:
        """No file open, before the first sample `[..., R, C, 10]`."""
        batch, k = first.shape[:-3], self.params.files
        none = first.new_zeros(*batch, k)
        pairs, signals = first.new_zeros(*batch, k, 2), first.new_zeros(*batch, k, 10)
        return RetinotopicState(
            low=first,
            peak=first.new_zeros(batch),
            place=pairs,
            velocity=pairs,
            open=torch.zeros(*batch, k, dtype=torch.bool, device=first.device),
            age=none,
            unseen=none,
            mean=signals,
            covariance=signals.unsqueeze(-1) * signals.unsqueeze(-2),
            light_mean=none,
            light=none.unsqueeze(-1) * none.unsqueeze(-2),
            steps=torch.zeros((), dtype=torch.int64),
        )

    def forward(self, signals: Tensor, state: RetinotopicState | None = None) -> tuple[Tensor, RetinotopicState]:
        if signals.ndim < 4 or tuple(signals.shape[-3:]) != (*self.grid, 10):
            raise InputError(
                f"signals must be [..., T, {self.grid[0]}, {self.grid[1]}, 10], got {tuple(signals.shape)}"
            )
        state = self.start(signals[..., 0, :, :, :]) if state is None else state
        a = self.dt / (self.params.tau_low + self.dt)
        counts, low, step = [], state.low, int(state.steps)
        for sample in signals.unbind(-4):
            low = torch.lerp(low, sample, a)
            if step % self.every == 0:
                state = files_step(low, state, self)
            step += 1
            counts.append(self.confirmed(state).sum(-1))
        return torch.stack(counts, -1), state._replace(low=low, steps=torch.tensor(step, dtype=torch.int64))

    def offset(self, difference: Tensor) -> Tensor:
        """Differences of places `[..., 2]`, the short way around where the scene is a torus."""
        if self.border != "wrap":
            return difference
        size = torch.tensor(self.grid, dtype=difference.dtype, device=difference.device)
        return torch.remainder(difference + size / 2, size) - size / 2

    def confirmed(self, state: RetinotopicState) -> Tensor:
        """Files that hold an object, `[..., K]` bool."""
        return state.open & (state.age >= self.params.confirm)

    def features(self, state: RetinotopicState) -> Tensor:
        """Features of every file, each group over its largest, small ones zero, `[..., K, 10]`."""
        covariance = state.covariance
        deviation = covariance.diagonal(dim1=-2, dim2=-1).clamp_min(0).sqrt()
        # Motion is in other units than colour: each group counts by its largest fluctuation.
        scale = torch.cat([group_scale(deviation[..., g]) for g in GROUPS.values()], -1)
        passage = self.passage.to(covariance.dtype)
        shared = passage @ (covariance / (scale.unsqueeze(-1) * scale.unsqueeze(-2))) @ passage.mT
        owner = shared.diagonal(dim1=-2, dim2=-1).argmax(-1)
        column = shared.gather(-1, owner[..., None, None].expand(*shared.shape[:-1], 1)).squeeze(-1)
        return torch.where(self.confirmed(state).unsqueeze(-1), features_by_group(column), 0.0)

    def objects(self, state: RetinotopicState) -> list[LocatedObject]:
        """The objects of one trial, oldest first."""
        if state.open.ndim != 1:
            raise InputError(f"objects are read out of one trial at a time, got a batch {list(state.open.shape[:-1])}")
        found = []
        for k, values in enumerate(self.features(state)):
            if not self.confirmed(state)[k]:
                continue
            row, column = ((state.place[k] + 0.5) * self.spacing).tolist()
            down, right = (state.velocity[k] * self.spacing).tolist()
            if self.border == "wrap":
                row, column = row % (self.grid[0] * self.spacing), column % (self.grid[1] * self.spacing)
            kept = {name: float(v) for name, v in zip(FEATURES, values, strict=True) if v > 0}
            found.append(LocatedObject(k, kept, (column, row), (right, down), float(state.age[k])))
        return sorted(found, key=lambda thing: -thing.age)


def group_scale(deviation: Tensor) -> Tensor:
    """The largest of a group, for every member of it, `[..., n]`."""
    largest = deviation.amax(-1, keepdim=True).clamp_min(torch.finfo(deviation.dtype).tiny)
    return largest.expand_as(deviation)


def files_step(low: Tensor, state: RetinotopicState, files: RetinotopicBinding) -> RetinotopicState:
    """One update of all files with the low-passed signals `[..., R, C, 10]`."""
    p, dt = files.params, files.every * files.dt
    tiny = torch.finfo(low.dtype).tiny
    signals = low.flatten(-3, -2)  # [..., F, 10]
    motion = signals[..., :4].clamp_min(0)
    # The detectors multiply brightness with brightness; the root is proportional to it again.
    energy = motion.sum(-1).sqrt()  # [..., F]
    peak = torch.maximum(state.peak * (1 - dt / p.tau_peak), energy.amax(-1))

    # Follow: predict, then move towards the motion in the file's own direction.
    place = state.place + state.velocity * dt
    away = files.offset(files.centres - place.unsqueeze(-2))  # [..., K, F, 2]
    window = torch.exp(-away.square().sum(-1) / (2 * p.window**2)) * state.open.unsqueeze(-1)
    shared = window * window / (window.sum(-2, keepdim=True) + 0.05)
    own = (own_direction(state, files) @ motion.mT).sqrt()  # [..., K, F]
    weight = shared * own
    seen = state.open & ((window * own).amax(-1) > p.visible * peak.unsqueeze(-1))
    towards = (weight.unsqueeze(-1) * away).sum(-2) / weight.sum(-1, keepdim=True).clamp_min(tiny)
    towards = towards.clamp(-0.8, 0.8) * seen.unsqueeze(-1)
    young = (state.age < 1).unsqueeze(-1)
    place = place + torch.where(young, max(p.gain, 0.6), p.gain) * towards
    # Beta over four updates: files are updated more often than a window is crossed.
    velocity = state.velocity + torch.where(young, max(p.drift, 0.3), p.drift) * towards / (4 * dt)
    speed = velocity.norm(dim=-1, keepdim=True)
    velocity = velocity * (p.fastest / speed.clamp_min(p.fastest))
    age = state.age + dt * state.open
    unseen = torch.where(seen, 0.0, state.unseen + dt)

    # Bind: covariances of what the window sees, and of the files' motion with each other.
    first = (state.age < dt / 2).unsqueeze(-1)
    total = window.sum(-1, keepdim=True).clamp_min(tiny)
    inside = (window @ signals) / total
    mean = torch.where(first, inside, torch.lerp(state.mean, inside, dt / (p.tau_high + dt)))
    high = inside - mean
    products = high.unsqueeze(-1) * high.unsqueeze(-2)
    take = seen[..., None, None] * (dt / p.tau_bind)
    covariance = state.covariance + take * (products - state.covariance)
    light = weight.sum(-1) / shared.sum(-1).clamp_min(tiny)
    light_mean = torch.where(first.squeeze(-1), light, torch.lerp(state.light_mean, light, dt / (p.tau_high + dt)))
    flicker = light - light_mean
    fresh = first | first.mT
    pairs = torch.where(fresh, 0.0, state.light)
    pairs = pairs + dt / p.tau_light * (flicker.unsqueeze(-1) * flicker.unsqueeze(-2) - pairs)

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
    still = state.open & ~closed(now, files)
    return opened(now._replace(open=still), energy, files)


def own_direction(state: RetinotopicState, files: RetinotopicBinding) -> Tensor:
    """How much each of the four motion signals counts for a file, `[..., K, 4]`: all alike while it is young."""
    speed = state.velocity.norm(dim=-1, keepdim=True)
    along = (state.velocity / speed.clamp_min(1e-6)) @ files.directions.to(speed.dtype).mT
    sure = ((state.age.unsqueeze(-1) - 0.3) / 0.5).clamp(0, 1) * (speed > files.params.fastest / 8)
    counts: Tensor = sure * along.clamp_min(0).square() + (1 - sure)
    return counts


def closed(state: RetinotopicState, files: RetinotopicBinding) -> Tensor:
    """Files to be closed, `[..., K]`: lost, never confirmed, or following the object of an older one."""
    p = files.params
    lost = (state.unseen > p.lost) | ((state.age < p.confirm) & (state.unseen > 0.15))
    apart = files.offset(state.place.unsqueeze(-2) - state.place.unsqueeze(-3)).norm(dim=-1)
    drift = (state.velocity.unsqueeze(-2) - state.velocity.unsqueeze(-3)).norm(dim=-1)
    deviation = state.light.diagonal(dim1=-2, dim2=-1).clamp_min(torch.finfo(apart.dtype).tiny).sqrt()
    correlation = state.light / (deviation.unsqueeze(-1) * deviation.unsqueeze(-2))
    older = state.age.unsqueeze(-2) > state.age.unsqueeze(-1)
    number = torch.arange(p.files, device=apart.device)
    older = older | ((state.age.unsqueeze(-2) == state.age.unsqueeze(-1)) & (number < number.unsqueeze(-1)))
    both = state.open.unsqueeze(-2) & state.open.unsqueeze(-1)
    known = torch.minimum(state.age.unsqueeze(-2), state.age.unsqueeze(-1)) > 0.7
    copies = (apart < p.same) | ((apart < p.near) & (correlation > p.alike) & known)
    closing: Tensor = lost | (both & older & copies & (drift < p.alike_speed)).any(-1)
    return closing


def opened(state: RetinotopicState, energy: Tensor, files: RetinotopicBinding) -> RetinotopicState:
    """Open one file where the largest motion is that no file claims; `energy` `[..., F]`."""
    p = files.params
    away = files.offset(files.centres - state.place.unsqueeze(-2)).norm(dim=-1)
    claimed = ((away < p.claim) & state.open.unsqueeze(-1)).any(-2)
    grid = energy.reshape(*energy.shape[:-1], *files.grid)
    summit = local_maximum(grid, files.border).flatten(-2)
    free = torch.where(claimed | ~summit, 0.0, energy)
    height, where = free.max(-1)
    wanted = (height > p.birth * state.peak) & (height > p.contrast * energy.median(-1).values)
    wanted = wanted & ~state.open.all(-1) & (height > 0)
    slot = (~state.open).to(torch.uint8).argmax(-1)
    number = torch.arange(p.files, device=slot.device)
    new = (number == slot.unsqueeze(-1)) & wanted.unsqueeze(-1)
    place = files.centres.to(energy.dtype)[where].unsqueeze(-2)
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
