"""Object files: windows that follow objects over a grid of fields and learn which signals fluctuate together there."""

from __future__ import annotations

from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from ndtorch.arguments import check_batch, check_number, check_state, check_tensor, is_whole
from ndtorch.binding.covariance import sample_step
from ndtorch.config import Constants, constant
from ndtorch.errors import InputError
from ndtorch.vision.features import GROUPS
from ndtorch.vision.motion import Border, check_border
from ndtorch.vision.temporal import corrected, predicted, safe_sqrt

DIRECTIONS = ((0.0, -1.0), (0.0, 1.0), (1.0, 0.0), (-1.0, 0.0))
"""Rows and columns towards which the motion signals left, right, down and up point."""


class ObjectFileParams(Constants):
    """Constants of `ObjectFiles`; lengths in fields (spacings of the grid), times in seconds."""

    most: int = constant(8, "There are at most this many objects at a time.", gt=0, le=1000)
    period: float = constant(0.05, "Windows are updated once in this many seconds.", gt=0)
    tau_low: float = constant(0.05, "The signals are low-passed with this time constant in seconds.", gt=0)
    window: float = constant(0.96, "A window's receptive field has this standard deviation in fields.", gt=0)
    crowd: float = constant(
        0.05, "This much is added to the sum of all windows, so that far ends decide no share.", gt=0
    )
    visible: float = constant(0.03, "An object is visible above this share of the recent largest motion.", gt=0)
    birth: float = constant(0.06, "Unclaimed motion above this share of the recent largest opens a window.", gt=0)
    contrast: float = constant(3.0, "Unclaimed motion has to exceed the median over all fields this many times.", gt=0)
    claim: float = constant(1.66, "A window claims all motion within this radius in fields.", gt=0)
    tau_peak: float = constant(10.0, "The largest motion is remembered with this time constant in seconds.", gt=0)
    gain: float = constant(0.5, "The alpha-beta filter that follows an object has this alpha.", gt=0)
    drift: float = constant(0.15, "The alpha-beta filter that follows an object has this beta.", gt=0)
    young: float = constant(1.0, "A window follows faster until it has this age in seconds.", gt=0)
    young_gain: float = constant(0.6, "A young window has at least this alpha.", gt=0)
    young_drift: float = constant(0.3, "A young window has at least this beta.", gt=0)
    updates: float = constant(4.0, "A residual comes about over this many updates.", gt=0)
    reach: float = constant(0.8, "A residual is at most this many fields.", gt=0)
    fastest: float = constant(8.0, "A window moves at most this many fields a second.", gt=0)
    aim: float = constant(0.3, "A window begins to prefer motion in its own direction at this age in seconds.", gt=0)
    aimed: float = constant(0.5, "The preference is complete after this many more seconds.", gt=0)
    slow: float = constant(0.0625, "A window has no direction below this share of the speed limit.", gt=0)
    confirm: float = constant(0.8, "A window counts as an object from this age in seconds on.", gt=0)
    blind: float = constant(0.15, "A younger window is closed after this many seconds without motion.", gt=0)
    lost: float = constant(2.0, "Any window is closed after this many seconds without motion.", gt=0)
    same: float = constant(0.7, "Windows nearer than this many fields that move alike are one.", gt=0)
    near: float = constant(2.6, "Windows nearer than this many fields that fluctuate alike are one.", gt=0)
    known: float = constant(0.7, "Fluctuations are compared once both windows have this age in seconds.", gt=0)
    alike: float = constant(0.8, "Fluctuations are alike above this correlation.", gt=0)
    alike_speed: float = constant(
        0.8, "Velocities are alike if they differ by less than this many fields a second.", gt=0
    )
    tau_high: float = constant(1.0, "A window's signals are high-passed with this time constant in seconds.", gt=0)
    tau_bind: float = constant(3.0, "A window's covariances are remembered with this time constant in seconds.", gt=0)
    tau_light: float = constant(
        1.0, "Covariances between windows are remembered with this time constant in seconds.", gt=0
    )


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

    What each of these is, is read from its covariances (`ndtorch.binding.readout.covariances`). Two windows side by
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
        a = self.dt / (self.params.tau_low + self.dt)
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

    def before_light(self, state: ObjectFileState) -> Tensor:
        """ObjectFiles before a ground that is as bright as half of what they see, `[..., K]` bool.

        What gets darker than such a ground is visible again; before a dark one nothing can be.
        """
        color = GROUPS["color"]
        ground = state.low[..., color].sum(-1).flatten(-2).median(-1).values
        light: Tensor = ground.unsqueeze(-1) > 0.5 * state.mean[..., color].sum(-1)
        return light

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
    peak = torch.maximum(state.peak * (1 - dt / p.tau_peak), energy.amax(-1))
    median = energy.median(-1).values  # objects fill few fields: what most show is noise

    # Follow: predict, then move towards the motion in the window's own direction.
    place = predicted(state.place, state.velocity, dt)
    away = windows.offset(windows.centers - place.unsqueeze(-2))  # [..., K, F, 2]
    window = torch.exp(-away.square().sum(-1) / (2 * p.window**2)) * state.open.unsqueeze(-1)
    shared = window * window / (window.sum(-2, keepdim=True) + p.crowd)
    own = safe_sqrt(own_direction(state, windows) @ motion.mT)  # [..., K, F]
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


def own_direction(state: ObjectFileState, windows: ObjectFiles) -> Tensor:
    """How much each of the four motion signals counts for a window, `[..., K, 4]`: all alike while it is young."""
    p = windows.params
    speed = state.velocity.norm(dim=-1, keepdim=True)
    along = (state.velocity / speed.clamp_min(1e-6)) @ windows.directions.to(speed.dtype).mT
    sure = ((state.age.unsqueeze(-1) - p.aim) / p.aimed).clamp(0, 1) * (speed > p.slow * p.fastest)
    counts: Tensor = sure * along.clamp_min(0).square() + (1 - sure)
    return counts


def closed(state: ObjectFileState, windows: ObjectFiles) -> tuple[Tensor, Tensor]:
    """ObjectFiles to be closed, `[..., K]`: lost, never confirmed, or following the object of an older one; and places.

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


def opened(state: ObjectFileState, energy: Tensor, median: Tensor, windows: ObjectFiles) -> ObjectFileState:
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
