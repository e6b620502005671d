"""The ranging controller's step of one car by kernels: the numbers of `RangingControl.step`."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from ndtorch.kernels.decision import Machine, Tables, decision
from ndtorch.kernels.load import kernel
from ndtorch.navigation.controllers.contract import Command
from ndtorch.navigation.controllers.ranging.arcs import ArcTable
from ndtorch.navigation.controllers.ranging.decision import Constants, RangingState
from ndtorch.navigation.controllers.ranging.floor import FloorConstants, FloorState
from ndtorch.navigation.controllers.ranging.params import RangingParams
from ndtorch.navigation.controllers.ranging.patch import Patch
from ndtorch.navigation.odometry import Pose
from ndtorch.navigation.ranging import Ranges


def plain(constants: Constants) -> Tables:
    """The constants as plain numbers."""
    found = {name: getattr(constants, name).tolist() for name in Tables._fields}
    return Tables(**found | {name: int(found[name]) for name in ("facts", "reverse", "turn", "cruise")})


def rest_of(constants: FloorConstants) -> tuple[float, ...]:
    """The numbers among the constants, in order."""
    return tuple(float(part) for part in constants if part.ndim == 0)


class QuickStep:
    """The step of `RangingControl` with these numbers, for one car.

    Args:
        params, constants, floor: the numbers.
        arcs: the table of arcs.
        places: body frame, `[2, K]`: the cells that are seen, what is under the car, and those of the arcs.
        under: evidence under the car.
    """

    def __init__(
        self,
        params: RangingParams,
        constants: Constants,
        floor: FloorConstants,
        arcs: ArcTable,
        places: Tensor,
        under: Tensor,
    ) -> None:
        self.params, self.tables, self.arcs = params, plain(constants), arcs
        self.rest = rest_of(floor)
        self.keep, self.fade, self.stopped = (float(c) for c in (constants.keep, constants.fade, constants.stopped))
        self.limits: tuple[float, ...] = tuple(constants.limits.tolist())
        # What a cell at the end of the floor is worth, one of floor, and a range.
        hidden, floor_worth, ranged = constants.evidence.tolist()
        self.evidence: tuple[float, float, float] = (hidden, floor_worth, ranged)
        self.tensors = (floor.flow, floor.profile, places, under)
        self.arrays: dict[torch.dtype, Any] = {}

    def fixed(self, kind: torch.dtype) -> Any:
        """The tables of this precision."""
        if kind not in self.arrays:
            self.arrays[kind] = tuple(part.to(kind).numpy() for part in self.tensors)
        return self.arrays[kind]

    def __call__(
        self, seen: Tensor, ranges: Ranges, pose: Pose, driven: Command, state: RangingState
    ) -> tuple[Command, RangingState]:
        drove, machine = (float(driven.speed), float(driven.curvature)), Machine(*map(float, state[2:]))
        age = float(state.floor.age) + 1
        level, marks, noise = self.see(seen, drove, age, state.floor)
        patch, ways = self.remember(
            marks, ranges, pose, self.fade if machine.mode == self.stopped else self.keep, state
        )
        speed, bend, after = decision(ways, drove[0], (age, self.rest[5], self.rest[6]), machine, self.tables)
        found = torch.tensor((speed, bend, noise, age, *after), dtype=seen.dtype).unbind(0)
        return Command(found[0], found[1]), RangingState(FloorState(level, found[2], found[3]), patch, *found[4:])

    def see(self, seen: Tensor, drove: tuple[float, float], age: float, state: FloorState) -> tuple[Tensor, Any, float]:
        """The level of floor after, evidence of every cell and under the car, and the noise after."""
        cells, level = seen.contiguous().numpy(), torch.empty_like(state.level)
        flow, profile, _, under = self.fixed(seen.dtype)
        marks = np.concatenate((cells.ravel(), under))
        noise = kernel("floor_cells", cells.dtype).run(
            cells,
            drove,
            state.level.numpy(),
            float(state.noise),
            age,
            flow,
            profile,
            self.rest,
            level.numpy(),
            self.evidence[:2],
            marks[: cells.size].reshape(cells.shape),
        )
        return level, marks, noise

    def remember(
        self, marks: Any, ranges: Ranges, pose: Pose, keep: float, state: RangingState
    ) -> tuple[Patch, list[list[float]]]:
        """The patch after, and how far the car can go along the arcs."""
        p, size = self.params.patch, self.params.patch.size
        evidence, tag = torch.empty_like(state.patch.evidence), torch.empty_like(state.patch.tag)
        lengths = np.empty((2, len(self.arcs.curvature)), marks.dtype)
        kernel("patch_arcs", marks.dtype).run(
            state.patch.evidence.numpy().reshape(size, size),
            state.patch.tag.numpy(),
            tuple(map(float, pose)),
            keep,
            (ranges.x.numpy(), ranges.y.numpy(), ranges.valid.numpy()),
            p.reach,
            self.evidence[2],
            self.fixed(evidence.dtype)[2],
            marks,
            p.cell,
            (-p.least, p.most),
            self.limits,
            self.arcs.leading,
            self.arcs.steps,
            self.arcs.step,
            evidence.numpy().reshape(size, size),
            tag.numpy(),
            lengths,
        )
        return Patch(evidence, tag), lengths.tolist()
