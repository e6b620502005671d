"""Object files: windows that follow objects over a grid of fields and learn which signals fluctuate together there."""

from __future__ import annotations

from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from ndtorch.arguments import check_batch, check_number, check_state, check_tensor, is_whole
from ndtorch.config import Constants, constant
from ndtorch.errors import InputError
from ndtorch.utils.tensors import safe_state
from ndtorch.vision.features import GROUPS
from ndtorch.vision.motion import Border, check_border
from ndtorch.vision.temporal import safe_sqrt

DIRECTIONS = ((0.0, -1.0), (0.0, 1.0), (1.0, 0.0), (-1.0, 0.0))
"""Rows and columns towards which the motion signals left, right, down and up point."""


# What nobody tunes: lengths in fields (spacings of the grid), times in seconds.
TAU_LOW = 0.05  # low-pass of the signals
CROWD = 0.05  # added to the sum of all windows, so that far ends decide nothing
CONTRAST = 3.0  # unclaimed motion has to exceed the median over all fields this many times
CLAIM = 1.66  # a window claims all motion within this radius
TAU_PEAK = 10.0  # memory of the largest motion
YOUNG, YOUNG_GAIN, YOUNG_DRIFT = 1.0, 0.6, 0.3  # until this age a window follows with at least this alpha and beta
UPDATES = 4.0  # a residual comes about over this many updates
REACH = 0.8  # largest residual
AIM, AIMED = 0.3, 0.5  # age at which a window begins to prefer its own direction, and time until it does so fully
SLOW = 0.0625  # below this ratio of the speed limit a window has no direction
BLIND = 0.15  # a window that is not confirmed is closed after this time without motion
SAME = 0.7  # windows nearer than this that move alike are one
KNOWN = 0.7  # fluctuations are compared once both windows have this age
ALIKE, ALIKE_SPEED = 0.8, 0.8  # correlation and difference of velocities (fields a second) of windows that are alike
TAU_HIGH, TAU_LIGHT = 1.0, 1.0  # high-pass of a window's signals, memory of covariances between windows


class ObjectFileParams(Constants):
    """Constants of `ObjectFiles`; lengths in fields (spacings of the grid), times in seconds."""

    most: int = constant(8, "Largest number of objects at a time.", gt=0, le=1000)
    period: float = constant(0.05, "Time between updates of the windows, seconds.", gt=0)
    window: float = constant(0.96, "Standard deviation of a window, fields.", gt=0)
    visible: float = constant(0.03, "Motion of a visible object over the largest lately.", gt=0)
    birth: float = constant(0.06, "Unclaimed motion over the largest lately that opens a window.", gt=0)
    gain: float = constant(0.5, "Alpha of the filter that follows an object.", gt=0)
    drift: float = constant(0.15, "Beta of the filter that follows an object.", gt=0)
    fastest: float = constant(8.0, "Largest speed of a window, fields a second.", gt=0)
    confirm: float = constant(0.8, "Age from which a window counts as an object, seconds.", gt=0)
    lost: float = constant(2.0, "Time without motion after which a window is closed, seconds.", gt=0)
    near: float = constant(2.6, "Distance below which windows that fluctuate alike are one, fields.", gt=0)
    tau_bind: float = constant(3.0, "Memory of a window's covariances, seconds.", gt=0)


@safe_state
class ObjectFileState(NamedTuple):
    """State of `ObjectFiles`: K windows a trial.

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


class ObjectFiles(nn.Module):
    """Follows objects over retinotopic glomeruli, and learns of each which signals fluctuate together.

    Whole-field sums cannot separate bars of one color, bars that fluctuate in phase, or equal bars [C §5.5.2];
    sums over small fields can. Lateral competition picks the fields that move most; a *window* is opened there, a
    receptive field of its own that then goes with the object: it is predicted from the velocity, and
    drawn to the motion in the object's own direction, which windows share where their windows overlap. What the
    window sees is the object alone most of the time, and its fluctuations are the object's own.

    What each of these is, is read from its covariances (`ndtorch.binding.models.retinotopic`). Two windows side by
    side that fluctuate together are one object.

    Args:
        grid: rows and columns of fields.
        spacing: pixels from field to field.
        dt: time step, s.
        border: "wrap" where the scene is a torus.
        params: constants.

    Shapes:
        signals `[..., T, R, C, 10]` -> number of objects at every step `[..., T]`, `ObjectFileState`.

    Raises:
        InputError: signals of another shape, or parameters out of range.
    """

    centers: Tensor
    directions: Tensor

    def __init__(
        self,
        grid: tuple[int, int],
        spacing: float,
        dt: float = 0.01,
        border: Border = "wrap",
        params: ObjectFileParams | None = None,
    ) -> None:
        super().__init__()
        check_border(border)
        sides = grid if isinstance(grid, tuple | list) else ()
        if len(sides) != 2 or not all(is_whole(side) and side >= 3 for side in sides):
            raise InputError(f"grid must be at least 3 x 3 fields, got {repr(grid)[:40]}")
        check_number("spacing", spacing, above=0, unit="pixels")
        check_number("dt", dt, above=0, unit="seconds")
        self.grid, self.spacing, self.dt, self.border = grid, spacing, dt, border
        self.params = params or ObjectFileParams()
        self.every = max(1, round(self.params.period / dt))
        rows, columns = torch.meshgrid(torch.arange(float(grid[0])), torch.arange(float(grid[1])), indexing="ij")
        self.register_buffer("centers", torch.stack([rows, columns], -1).flatten(0, 1))
        self.register_buffer("directions", torch.tensor(DIRECTIONS))

    def start(self, first: Tensor) -> ObjectFileState:
        """No window open, before the first sample `[..., R, C, 10]`."""
        batch, k = first.shape[:-3], self.params.most
        none = first.new_zeros(*batch, k)
        pairs, signals = first.new_zeros(*batch, k, 2), first.new_zeros(*batch, k, 10)
        return ObjectFileState(
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

    def forward(self, signals: Tensor, state: ObjectFileState | None = None) -> tuple[Tensor, ObjectFileState]:
        check_state(state, ObjectFileState)
        check_tensor("signals", signals, half=False)
        if signals.ndim < 4 or tuple(signals.shape[-3:]) != (*self.grid, 10):
            raise InputError(
                f"signals must be [..., T, {self.grid[0]}, {self.grid[1]}, 10], got {tuple(signals.shape)}"
            )
        check_batch(state, signals.shape[:-4], "low", "place")
        state = self.start(signals[..., 0, :, :, :]) if state is None else state
        a = self.dt / (TAU_LOW + self.dt)
        counts, low = [], state.low
        step: int | Tensor = state.steps if torch.compiler.is_compiling() else int(state.steps)
        number = self.confirmed(state).sum(-1)
        for sample in signals.unbind(-4):
            low = torch.lerp(low, sample, a)
            due = step % self.every == 0
            if isinstance(due, Tensor):
                # An exported program cannot skip an update: it keeps what was before.
                after = object_file_step(low, state, self)
                state = ObjectFileState(*(torch.where(due, new, old) for new, old in zip(after, state, strict=True)))
                number = self.confirmed(state).sum(-1)
            elif due:
                state = object_file_step(low, state, self)
                number = self.confirmed(state).sum(-1)
            step = step + 1
            counts.append(number)
        return torch.stack(counts, -1), state._replace(low=low, steps=torch.zeros((), dtype=torch.int64) + step)

    def offset(self, difference: Tensor) -> Tensor:
        """Differences of places `[..., 2]`, the shorter distance around where the scene is a torus."""
        if self.border != "wrap":
            return difference
        size = torch.tensor(self.grid, dtype=difference.dtype, device=difference.device)
        return torch.remainder(difference + size / 2, size) - size / 2

    def confirmed(self, state: ObjectFileState) -> Tensor:
        """Windows that hold an object, `[..., K]` bool."""
        return state.open & (state.age >= self.params.confirm)

    def places(self, state: ObjectFileState) -> tuple[Tensor, Tensor]:
        """Column and row in pixels, and velocity in pixels a second to the right and down, `[..., K, 2]` each."""
        place = (state.place + 0.5) * self.spacing
        if self.border == "wrap":
            place = torch.remainder(place, place.new_tensor(self.grid) * self.spacing)
        return place.flip(-1), (state.velocity * self.spacing).flip(-1)


def object_file_step(low: Tensor, state: ObjectFileState, windows: ObjectFiles) -> ObjectFileState:
    """One update of all windows with the low-passed signals `[..., R, C, 10]`."""
    p, dt = windows.params, windows.every * windows.dt
    tiny = torch.finfo(low.dtype).tiny
    signals = low.flatten(-3, -2)  # [..., F, 10]
    motion = signals[..., GROUPS["motion"]].clamp_min(0)
    # The detectors multiply brightness with brightness; the root is proportional to it again.
    energy = safe_sqrt(motion.sum(-1))  # [..., F]
    peak = torch.maximum(state.peak * (1 - dt / TAU_PEAK), energy.amax(-1))
    median = energy.median(-1).values  # objects fill few fields: what most show is noise

    # Follow: predict, then move towards the motion in the window's own direction.
    place = state.place + state.velocity * dt
    away = windows.offset(windows.centers - place.unsqueeze(-2))  # [..., K, F, 2]
    window = torch.exp(-away.square().sum(-1) / (2 * p.window**2)) * state.open.unsqueeze(-1)
    shared = window * window / (window.sum(-2, keepdim=True) + CROWD)
    # How much each of the four motion signals counts: all alike while a window is young.
    speed = state.velocity.norm(dim=-1, keepdim=True)
    along = (state.velocity / speed.clamp_min(1e-6)) @ windows.directions.to(speed.dtype).mT
    sure = ((state.age.unsqueeze(-1) - AIM) / AIMED).clamp(0, 1) * (speed > SLOW * p.fastest)
    own = safe_sqrt((sure * along.clamp_min(0).square() + (1 - sure)) @ motion.mT)  # [..., K, F]
    weight = shared * own
    seen = state.open & ((window * own).amax(-1) > torch.maximum(p.visible * peak, median).unsqueeze(-1))
    towards = (weight.unsqueeze(-1) * away).sum(-2) / weight.sum(-1, keepdim=True).clamp_min(tiny)
    towards = towards.clamp(-REACH, REACH) * seen.unsqueeze(-1)
    young = (state.age < YOUNG).unsqueeze(-1)
    alpha = torch.where(young, max(p.gain, YOUNG_GAIN), p.gain)
    beta = torch.where(young, max(p.drift, YOUNG_DRIFT), p.drift)
    place, velocity = place + alpha * towards, state.velocity + beta * towards / (UPDATES * dt)
    speed = velocity.norm(dim=-1, keepdim=True)
    velocity = velocity * (p.fastest / speed.clamp_min(p.fastest))
    age = state.age + dt * state.open
    unseen = torch.where(seen, 0.0, state.unseen + dt)

    # Bind: covariances of what the window sees, and of the windows' motion with each other.
    first = (state.age < dt / 2).unsqueeze(-1)
    total = window.sum(-1, keepdim=True).clamp_min(tiny)
    inside = (window @ signals) / total
    a_high, take = dt / (TAU_HIGH + dt), seen[..., None, None] * (dt / p.tau_bind)
    mean, covariance = sample_step(inside, state.mean, state.covariance, first, a_high, take)
    light = weight.sum(-1) / shared.sum(-1).clamp_min(tiny)
    pairs = torch.where(first | first.mT, 0.0, state.light)
    light_mean, pairs = sample_step(light, state.light_mean, pairs, first.squeeze(-1), a_high, dt / TAU_LIGHT)

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


def closed(state: ObjectFileState, windows: ObjectFiles) -> tuple[Tensor, Tensor]:
    """ObjectFiles to be closed, `[..., K]`: lost, never confirmed, or following the object of an older one; and places.

    Two that fluctuate alike follow the ends of one long object: the older one goes on in the middle, from where it
    claims both.
    """
    p = windows.params
    lost = (state.unseen > p.lost) | ((state.age < p.confirm) & (state.unseen > BLIND))
    away = windows.offset(state.place.unsqueeze(-2) - state.place.unsqueeze(-3))
    apart = away.norm(dim=-1)
    drift = (state.velocity.unsqueeze(-2) - state.velocity.unsqueeze(-3)).norm(dim=-1)
    deviation = state.light.diagonal(dim1=-2, dim2=-1).clamp_min(torch.finfo(apart.dtype).tiny).sqrt()
    correlation = state.light / (deviation.unsqueeze(-1) * deviation.unsqueeze(-2))
    older = state.age.unsqueeze(-2) > state.age.unsqueeze(-1)
    number = torch.arange(p.most, device=apart.device)
    older = older | ((state.age.unsqueeze(-2) == state.age.unsqueeze(-1)) & (number < number.unsqueeze(-1)))
    both = state.open.unsqueeze(-2) & state.open.unsqueeze(-1)
    known = torch.minimum(state.age.unsqueeze(-2), state.age.unsqueeze(-1)) > KNOWN
    pairs = both & older & (drift < ALIKE_SPEED)
    ends = pairs & (apart >= SAME) & (apart < p.near) & (correlation > ALIKE) & known
    closing = lost | (pairs & (apart < SAME) | ends).any(-1)
    count = ends.sum(-2).unsqueeze(-1) + 1
    return closing, state.place + torch.where(ends.unsqueeze(-1), away, 0.0).sum(-3) / count


def opened(state: ObjectFileState, energy: Tensor, median: Tensor, windows: ObjectFiles) -> ObjectFileState:
    """Open one window where the largest motion is that no window claims; `energy` `[..., F]`, its `median` `[...]`."""
    p = windows.params
    away = windows.offset(windows.centers - state.place.unsqueeze(-2)).norm(dim=-1)
    claimed = ((away < CLAIM) & state.open.unsqueeze(-1)).any(-2)
    grid = energy.reshape(-1, 1, *windows.grid)
    padded = F.pad(grid, (1, 1, 1, 1), mode="circular" if windows.border == "wrap" else "replicate")
    summit = (F.max_pool2d(padded, 3, 1) == grid).reshape(energy.shape)  # no neighbor exceeds it
    free = torch.where(claimed | ~summit, 0.0, energy)
    height, where = free.max(-1)
    wanted = (height > p.birth * state.peak) & (height > CONTRAST * median)
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


def sample_step(
    sample: Tensor, mean: Tensor, covariance: Tensor, fresh: Tensor, a_high: float, share: float | Tensor
) -> tuple[Tensor, Tensor]:
    """Mean `[..., N]` and covariance `[..., N, N]` after one more sample, of which they take in the shares `a_high` and
    `share`; where `fresh`, the mean begins at the sample.
    """
    mean = torch.where(fresh, sample, torch.lerp(mean, sample, a_high))
    high = sample - mean
    return mean, covariance + share * (high.unsqueeze(-1) * high.unsqueeze(-2) - covariance)
