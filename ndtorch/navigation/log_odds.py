"""The map as probabilities: Bayesian updating of a grid by log-odds."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor, nn

from ndtorch.errors import InputError
from ndtorch.navigation.certainty import BeamTable, beam_table, sample_certainty
from ndtorch.navigation.mapping import Grid, add_at, check_observations
from ndtorch.navigation.odometry import Pose, to_world
from ndtorch.navigation.ranging import Ranges
from ndtorch.navigation.rig import StereoRig


class LogOddsState(NamedTuple):
    """State of `LogOddsMap`: `log(p / (1 - p))`, `[..., rows + 2, columns + 2]`, the outermost a margin."""

    cells: Tensor


class LogOddsMap(nn.Module):
    """A grid of probabilities that a cell is occupied, the Bayesian way that [A §2.3] leaves open.

    Each observation adds log-odds where its feature is certain to be, and takes some away on the line of
    sight in front of it, because what is seen is not hidden. `state.cells` are log-odds; 0 is unknown.

    Called as `probability, state = module(ranges, pose, state)`. The cells are changed in place, as in
    `GridMap`. The probabilities of a whole grid take long to compute: `touch` updates without them.

    Shapes:
        ranges `[..., T, n]`, pose `[..., T]` -> `[..., rows, columns]` in 0..1. `state=None` starts unknown.

    Args:
        rig, grid, farthest: as `GridMap`.
        hit: log-odds that one observation adds in all, spread over its cells.
        miss: log-odds that it takes from each cell on the line of sight.
        clear: the line of sight counts as seen free up to this share of the range.
        limit: log-odds stay within this, so that the map can change its mind.

    Raises:
        InputError: numbers out of range, or ranges and poses that do not belong together.
    """

    tangent: Tensor
    weight: Tensor
    line: Tensor

    def __init__(
        self,
        rig: StereoRig,
        grid: Grid | None = None,
        *,
        hit: float = 2.0,
        miss: float = 0.1,
        clear: float = 0.85,
        limit: float = 6.0,
        farthest: float = 2.2,
    ) -> None:
        super().__init__()
        if not (hit > 0 and miss >= 0 and 0 < clear < 1 and limit > 0):
            raise InputError(
                f"expected hit > 0, miss >= 0, 0 < clear < 1 and limit > 0, "
                f"got hit={hit}, miss={miss}, clear={clear}, limit={limit}"
            )
        self.rig, self.grid = rig, grid or Grid()
        self.hit, self.miss, self.limit = hit, miss, limit
        table = beam_table(rig, farthest, self.grid.cell / 2)
        self.register_buffer("tangent", table.tangent, persistent=False)
        self.register_buffer("weight", table.weight, persistent=False)
        # One place a cell at the farthest range: nearer lines meet a cell more often than once, see `touch`.
        line = torch.linspace(0.0, clear, math.ceil(farthest / self.grid.cell))
        self.register_buffer("line", line, persistent=False)

    def forward(self, ranges: Ranges, pose: Pose, state: LogOddsState | None = None) -> tuple[Tensor, LogOddsState]:
        state = self.touch(ranges, pose, state)
        return self.grid.inner(state.cells).sigmoid(), state

    def touch(self, ranges: Ranges, pose: Pose, state: LogOddsState | None = None) -> LogOddsState:
        """Update the cells near the observations, in place, frame by frame."""
        batch = check_observations(ranges, pose)
        cells = self.grid.empty(batch, ranges.x) if state is None else state.cells
        if cells.shape != (*batch, self.grid.rows + 2, self.grid.columns + 2):
            raise InputError(f"cells of shape {tuple(cells.shape)} do not fit batch {batch} and {self.grid}")
        pose = Pose(*(part.unsqueeze(-1).unsqueeze(-1) for part in pose))
        x, y, weight = sample_certainty(ranges, self.rig, BeamTable(self.tangent, self.weight), math.inf)
        share = weight / weight.sum(-1, keepdim=True).clamp(min=torch.finfo(weight.dtype).tiny)
        occupied = self.grid.find(*to_world(pose, x, y))
        seen = ranges.valid.unsqueeze(-1).to(share.dtype)
        x, y = ranges.x.unsqueeze(-1), ranges.y.unsqueeze(-1)
        free = self.grid.find(*to_world(pose, self.rig.forward + (x - self.rig.forward) * self.line, y * self.line))
        # So many places of the line fall into one cell: together they take `miss`, not each.
        length = torch.hypot(x - self.rig.forward, y) * float(self.line[-1])
        crowding = (length / (len(self.line) * self.grid.cell)).clamp(max=1.0)
        number = torch.cat([occupied, free], -1)
        change = torch.cat([share * seen * self.hit, (-self.miss * crowding * seen).expand(free.shape)], -1)
        flat = cells.view(-1)
        for t in range(number.shape[-3]):
            now = slice(t, t + 1)
            touched = add_at(cells, number[..., now, :, :], change[..., now, :, :])
            flat[touched] = flat[touched].clamp(-self.limit, self.limit)
        return LogOddsState(cells)
