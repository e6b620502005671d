"""Where the objects are: windows that follow them over a grid of fields and bind what fluctuates there."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from ndtorch.arguments import check_batch, check_number, check_state, check_tensor, is_whole
from ndtorch.binding.tracking.params import WindowParams
from ndtorch.binding.tracking.window_step import WindowState, windows_step
from ndtorch.errors import InputError
from ndtorch.kernels.switch import kernels_wanted
from ndtorch.kernels.windows_update import windows_update
from ndtorch.vision.features import GROUPS
from ndtorch.vision.motion import Border, check_border

DIRECTIONS = ((0.0, -1.0), (0.0, 1.0), (1.0, 0.0), (-1.0, 0.0))
"""Rows and columns towards which the motion signals left, right, down and up point."""


class Windows(nn.Module):
    """Follows objects over retinotopic glomeruli, and learns of each which signals fluctuate together.

    Whole-field sums cannot tell apart bars of one color, bars that fluctuate in phase, or equal bars [C §5.5.2];
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
        signals `[..., T, R, C, 10]` -> number of objects at every step `[..., T]`, `WindowState`.

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
        params: WindowParams | None = None,
    ) -> None:
        super().__init__()
        check_border(border)
        sides = grid if isinstance(grid, tuple | list) else ()
        if len(sides) != 2 or not all(is_whole(side) and side >= 3 for side in sides):
            raise InputError(f"grid must be at least 3 x 3 fields, got {repr(grid)[:40]}")
        check_number("spacing", spacing, above=0, unit="pixels")
        check_number("dt", dt, above=0, unit="seconds")
        self.grid, self.spacing, self.dt, self.border = grid, spacing, dt, border
        self.params = params or WindowParams()
        self.every = max(1, round(self.params.period / dt))
        rows, columns = torch.meshgrid(torch.arange(float(grid[0])), torch.arange(float(grid[1])), indexing="ij")
        self.register_buffer("centers", torch.stack([rows, columns], -1).flatten(0, 1))
        self.register_buffer("directions", torch.tensor(DIRECTIONS))

    def start(self, first: Tensor) -> WindowState:
        """No window open, before the first sample `[..., R, C, 10]`."""
        batch, k = first.shape[:-3], self.params.most
        none = first.new_zeros(*batch, k)
        pairs, signals = first.new_zeros(*batch, k, 2), first.new_zeros(*batch, k, 10)
        return WindowState(
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

    def forward(self, signals: Tensor, state: WindowState | None = None) -> tuple[Tensor, WindowState]:
        check_state(state, WindowState)
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
                after = windows_step(low, state, self)
                state = WindowState(*(torch.where(due, new, old) for new, old in zip(after, state, strict=True)))
                number = self.confirmed(state).sum(-1)
            elif due:
                state = (by_kernel if fits(low, state) else windows_step)(low, state, self)
                number = self.confirmed(state).sum(-1)
            step = step + 1
            counts.append(number)
        return torch.stack(counts, -1), state._replace(low=low, steps=torch.zeros((), dtype=torch.int64) + step)

    def offset(self, difference: Tensor) -> Tensor:
        """Differences of places `[..., 2]`, the short way around where the scene is a torus."""
        if self.border != "wrap":
            return difference
        size = torch.tensor(self.grid, dtype=difference.dtype, device=difference.device)
        return torch.remainder(difference + size / 2, size) - size / 2

    def confirmed(self, state: WindowState) -> Tensor:
        """Windows that hold an object, `[..., K]` bool."""
        return state.open & (state.age >= self.params.confirm)

    def before_light(self, state: WindowState) -> Tensor:
        """Windows before a ground that is as bright as half of what they see, `[..., K]` bool.

        What gets darker than such a ground stands out again; before a dark one nothing can.
        """
        color = GROUPS["color"]
        ground = state.low[..., color].sum(-1).flatten(-2).median(-1).values
        light: Tensor = ground.unsqueeze(-1) > 0.5 * state.mean[..., color].sum(-1)
        return light

    def places(self, state: WindowState) -> tuple[Tensor, Tensor]:
        """Column and row in pixels, and velocity in pixels a second to the right and down, `[..., K, 2]` each."""
        place = (state.place + 0.5) * self.spacing
        if self.border == "wrap":
            place = torch.remainder(place, place.new_tensor(self.grid) * self.spacing)
        return place.flip(-1), (state.velocity * self.spacing).flip(-1)


def fits(low: Tensor, state: WindowState) -> bool:
    """Whether signals `[R, C, 10]` and a state can go to the kernel."""
    return (
        low.ndim == 3 and kernels_wanted(low, *state) and all(s.dtype == low.dtype for s in (state.peak, state.light))
    )


def by_kernel(low: Tensor, state: WindowState, windows: Windows) -> WindowState:
    """`windows_step` of one trial by a kernel."""
    from ndtorch.kernels.window_numbers import WindowNumbers

    changed = [part.clone() for part in state[1:-1]]
    p = windows.params
    numbers = WindowNumbers(
        windows.every * windows.dt, *(float(getattr(p, name)) for name in WindowNumbers._fields[1:])
    )
    arrays = [part.numpy() for part in changed]
    arrays[0] = arrays[0].reshape(1)
    windows_update(low.contiguous().numpy(), *arrays, numbers, windows.border == "wrap")
    return WindowState(low=state.low, **dict(zip(WindowState._fields[1:-1], changed, strict=True)), steps=state.steps)
