"""The ranging controller by kernels: its own step, and as the kernel of a whole step has it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ndtorch.kernels.add_ranges import add_ranges
from ndtorch.kernels.decision import NUMBERS
from ndtorch.kernels.ranging_control import ranging_control
from ndtorch.kernels.ranging_step import ranging_step
from ndtorch.kernels.trail import POSES
from ndtorch.navigation.controllers.contract import STOPPED, Command
from ndtorch.navigation.controllers.quick import QuickControl
from ndtorch.navigation.controllers.ranging.arcs import ArcTable
from ndtorch.navigation.controllers.ranging.caution import FULL, LEAST, SETTLED
from ndtorch.navigation.controllers.ranging.decision import Constants, RangingState
from ndtorch.navigation.controllers.ranging.floor import FloorConstants, FloorState
from ndtorch.navigation.controllers.ranging.floor_motion import LIMITS, FloorMotion
from ndtorch.navigation.controllers.ranging.floor_view import EVERY
from ndtorch.navigation.controllers.ranging.overhangs import beam_numbers, line_of_sight
from ndtorch.navigation.controllers.ranging.params import RangingParams
from ndtorch.navigation.controllers.ranging.patch import Patch
from ndtorch.navigation.controllers.ranging.trail import Trail
from ndtorch.navigation.odometry import Pose
from ndtorch.navigation.ranging import Ranges
from ndtorch.navigation.rig import StereoRig


class QuickRanging(QuickControl):
    """The step of `RangingControl` with these numbers, for one car.

    Args:
        look: its eyes.
        params, constants, floor: the numbers.
        arcs: the table of arcs.
        places: body frame, `[2, K]`: the cells that are seen, what is under the car, and those of the arcs.
        under: evidence under the car.
        full_flow: of `known_share`.
        rig: the camera pair.
    """

    kernel, count = ranging_step, 10

    def __init__(
        self,
        look: FloorMotion,
        params: RangingParams,
        constants: Constants,
        floor: FloorConstants,
        arcs: ArcTable,
        places: Tensor,
        under: Tensor,
        full_flow: Tensor,
        rig: StereoRig,
    ) -> None:
        rect, p = look.view.cells[0], params.patch
        self.shape = (2, rect.bottom - rect.top, (rect.right - rect.left) // EVERY)
        self.a = look.nd_min.a
        self.side = p.size if params.overhangs else 0
        self.sizes = (params.floor.bands, p.size**2, 2 * p.size, self.side**2, 3 * POSES)
        self.cells = (EVERY, params.floor.bands, params.floor.blocks)
        keep, fade, stopped = (float(c) for c in (constants.keep, constants.fade, constants.stopped))
        worth = tuple(constants.evidence.tolist())
        patch = (keep, fade, stopped, p.reach, p.cell, -p.least, p.most, *constants.limits.tolist())
        ways = (arcs.leading, arcs.steps, len(arcs.curvature), arcs.step)
        numbers = tuple(float(getattr(constants, name)) for name in NUMBERS)
        moves = torch.stack((constants.speeds, constants.bends)).double().numpy()
        choice = (constants.comparison.double().numpy(), constants.table.numpy(), moves)
        rest = tuple(float(part) for part in floor if part.ndim == 0)
        self.rest, self.choice = (rest, worth, patch, ways, choice, numbers, beam_numbers(rig, params)), choice
        lines, shift, first, wide, tall, alike, least = look.match()
        self.inward = (EVERY * first[0], EVERY * first[1])
        columns = (look.fields[0].right - look.fields[0].left) // EVERY
        self.whole = (p.size, arcs.leading, arcs.steps, len(arcs.curvature), *first, wide, tall, columns, self.side)
        self.lines = (lines, shift)
        self.numbers = (*rest[:14], *worth, *patch, *numbers, arcs.step, params.least_noise, LEAST, FULL, STOPPED)
        self.numbers += (alike, least, *LIMITS, *self.rest[-1], SETTLED)
        self.tensors = (floor.flow, floor.profile, places, under, line_of_sight(places))
        self.full = -torch.expm1(full_flow * floor.saturation)
        self.tables: dict[Any, Any] = {}
        self.nowhere = np.zeros(0, np.int32)

    def fixed(self, kind: Any) -> tuple[Any, ...]:
        """The tables and numbers of this precision, a NumPy dtype, in the order of `ranging_control`."""
        if kind not in self.tables:
            self.tables[kind] = tuple(part.numpy().astype(kind) for part in (*self.tensors, self.full))
        return (self.tables[kind][:5], *self.rest)

    def take(self, state: RangingState) -> tuple[Sequence[Tensor], Sequence[Tensor]]:
        """What was learned and remembered, and the rest."""
        (level, noise, age), patch, *machine, trail = state
        return (level, patch.evidence, patch.tag, patch.upright, trail.places), (noise, age, *machine, trail.number)

    def give(self, arrays: Sequence[Tensor], numbers: Sequence[Tensor]) -> RangingState:
        """The reverse of `take`."""
        level, evidence, tag, upright, driven = arrays
        noise, age, *machine, count = numbers
        patch = Patch(evidence, tag.view(*tag.shape[:-1], 2, -1), upright)
        mode, begun, side, swing, gone, bold, difference = machine
        trail = Trail(driven.reshape(*driven.shape[:-1], -1, 3), count)
        floor = FloorState(level, noise, age)
        return RangingState(floor, patch, mode, begun, side, swing, gone, bold, difference, trail)

    def mode(self, numbers: Any) -> int:
        """The first number after what the floor has."""
        return int(numbers[7])

    def arrays(self, kind: Any) -> tuple[Any, ...]:
        """Tables, shares of the level that floor shows at full speed, and what both eyes compare."""
        self.fixed(kind)
        *tables, full = self.tables[kind]
        return (*tables, *self.choice, full, *self.lines)

    def memory(self, arrays: Sequence[Any]) -> tuple[Any, Any, Any, Any, Any]:
        """The arrays in their shapes."""
        level, evidence, tag, upright, trail = arrays
        square = evidence.reshape(-1, tag.size // 2)
        return level, square, tag.reshape(2, -1), upright.reshape(self.side, self.side), trail.reshape(-1, 3)

    def __call__(
        self, seen: Tensor, ranges: Ranges, pose: Pose, driven: Command, state: RangingState
    ) -> tuple[Command, RangingState]:
        """The step of the controller alone."""
        arrays, control = self.take(state)
        numbers = torch.stack((*driven, *pose, *control)).numpy()
        new = [torch.empty_like(part) for part in arrays]
        after = np.empty_like(numbers)
        ranging_control(
            seen.contiguous().numpy(),
            (ranges.x.contiguous().numpy(), ranges.y.contiguous().numpy(), ranges.valid.numpy()),
            numbers,
            self.memory([part.numpy() for part in arrays]),
            self.memory([part.numpy() for part in new]),
            after,
            *self.fixed(after.dtype),
        )
        speed, curvature, _, _, _, *machine = torch.from_numpy(after).unbind()
        return Command(speed, curvature), self.give([part.flatten() for part in new], machine)

    def with_ranges(self, upright: Tensor, ranges: Ranges, pose: Pose, weight: float) -> Tensor:
        """`remember_ranges` of one car that has no new places below it, each range of this weight."""
        after, p = upright.clone(), self.rest[2]
        _, _, _, reach, cell, *bounds = p[:7]
        standing = after.numpy().reshape(self.side, self.side)
        add_ranges(
            standing,
            (float(pose.x), float(pose.y), float(pose.heading)),
            (ranges.x.numpy(), ranges.y.numpy(), ranges.valid.numpy()),
            (reach, weight),
            self.fixed(standing.dtype)[0][4],
            self.nowhere,
            self.rest[-1],
            cell,
            (bounds[0], bounds[1]),
        )
        return after
