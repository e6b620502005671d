"""The controller that goes beyond the paper: it drives where it has seen floor."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import torch
from torch import Tensor

from ndtorch.errors import InputError
from ndtorch.kernels.switch import kernels_wanted
from ndtorch.navigation.controllers.contract import (
    CRUISE,
    REVERSE,
    STOPPED,
    SUPPRESSED,
    TURN,
    Command,
    Controller,
    Glance,
    Task,
    Trace,
)
from ndtorch.navigation.controllers.ranging.arcs import arc_table, free_travel
from ndtorch.navigation.controllers.ranging.caution import (
    FULL,
    known_share,
    remember_near,
    settling,
    speed_share,
    woken,
)
from ndtorch.navigation.controllers.ranging.decision import RangingState, decide, ranging_constants
from ndtorch.navigation.controllers.ranging.floor import FloorState, floor_constants, floor_step
from ndtorch.navigation.controllers.ranging.floor_motion import FloorMotion
from ndtorch.navigation.controllers.ranging.overhangs import in_the_way, remember_ranges, remember_things
from ndtorch.navigation.controllers.ranging.params import RangingParams
from ndtorch.navigation.controllers.ranging.patch import Patch, add_evidence, cell_numbers, empty_patch, move_patch
from ndtorch.navigation.controllers.ranging.quick import QuickRanging
from ndtorch.navigation.controllers.ranging.trail import empty_trail
from ndtorch.navigation.controllers.registry import register
from ndtorch.navigation.odometry import Pose
from ndtorch.navigation.proximity.stereo_match import Obstacles
from ndtorch.navigation.ranging import Ranges
from ndtorch.navigation.rig import StereoRig

START_GOES_ON = 0.65
"""A car that has begun to learn its floor goes on with this share of `start_needs`: it drives 0.2 m meanwhile."""


@register
class RangingControl(Controller):
    """Drives where floor was seen, and away from where it ends or a range says that something is.

    What is seen are the cells of `FloorMotion`, `[..., T, 4, bands, blocks]`. The state starts at the first pose,
    standing.

    Args:
        rig, dt, params: as `Controller`.

    Raises:
        InputError: numbers out of range, or inputs that do not belong together.
    """

    name, Params, modes = "ranging", RangingParams, (CRUISE, TURN, SUPPRESSED, STOPPED, REVERSE)
    looks_near = True

    def __init__(self, rig: StereoRig, dt: float, params: RangingParams | None = None) -> None:
        super().__init__(rig, dt, params)
        if not 0 < dt < math.inf:
            raise InputError(f"dt must be a positive number of seconds, got {dt}")
        p: RangingParams = self.params
        self.rig = rig
        self.look = FloorMotion(rig, dt, p.floor)
        view = self.look.view
        self.floor = floor_constants(rig, p.floor, view, dt)
        wide, tight = 1 / p.turn_radius, 1 / p.tight_radius
        arcs = [(0.0, 1), (wide, 1), (tight, 1), (-wide, 1), (-tight, 1), (-tight, -1), (0.0, -1), (tight, -1)]
        longest = math.floor(min(1.6, p.patch.reach - 0.5) / p.patch.cell) * p.patch.cell
        self.arcs = arc_table(arcs, p.body, longest, p.patch.cell, lag=0.05)
        body = torch.meshgrid(
            torch.linspace(-0.8, 0.8, 6) * p.body.length, torch.linspace(-0.8, 0.8, 5) * p.body.width, indexing="ij"
        )
        self.marked = view.x.numel() + body[0].numel()
        x = torch.cat((view.x.flatten(), body[0].flatten(), self.arcs.x))
        y = torch.cat((view.y.flatten(), body[1].flatten(), self.arcs.y))
        self.places = torch.stack((x, y))
        self.under = torch.full((body[0].numel(),), -2.0)
        self.numbers = torch.arange(p.patch.size, dtype=torch.get_default_dtype())
        self.constants = ranging_constants(p, dt)
        self.every, self.searched = max(1, round(p.glance_time / dt)), replace(p, range_weight=p.glance_weight)
        self.nowhere = torch.zeros(2, 0)
        self.full_flow = view.sweep * (dt * p.speed)
        self.quick: QuickRanging = QuickRanging(
            self.look, p, self.constants, self.floor, self.arcs, self.places, self.under, self.full_flow, rig
        )

    @classmethod
    def params_for(cls, task: Task) -> RangingParams:
        """As `Controller.params_for`; tight turns and reversing are never faster than the rest."""
        params: RangingParams = super().params_for(task)
        tight = min(params.tight_speed, 0.8 * task.cruise)
        back = min(params.reverse_speed, task.cruise)
        return replace(params, tight_speed=tight, reverse_speed=back)

    @property
    def trace(self) -> Trace:
        """How the free ways to both sides compare."""
        return Trace("free way on arcs to the left - to the right", unit="m")

    def sides(self, seen: Tensor) -> Tensor:
        """The largest cell of each image."""
        return seen[..., :2, :, :].flatten(-2).amax(-1)

    def forward(
        self, seen: Tensor, ranges: Ranges, pose: Pose, driven: Command, state: RangingState | None = None
    ) -> tuple[Command, Any]:
        p: RangingParams = self.params
        if seen.shape[-3:] not in ((4, p.floor.bands, p.floor.blocks), (2, p.floor.bands, p.floor.blocks)):
            raise InputError(f"expected cells [..., T, 4, {p.floor.bands}, {p.floor.blocks}], got {tuple(seen.shape)}")
        return super().forward(seen, ranges, pose, driven, state)

    def start(self, seen: Tensor, pose: Pose) -> RangingState:
        """The state of a car that stands at a pose and knows nothing."""
        blank = torch.zeros_like(pose.x)
        level = blank.new_zeros(*blank.shape, self.params.floor.bands)
        floor = FloorState(level, blank, blank)
        patch = empty_patch(pose, self.params.patch, self.params.overhangs)
        return RangingState(
            floor, patch, blank + SUPPRESSED, blank, blank + 1, blank, blank, blank, blank, empty_trail(pose)
        )

    def step(
        self, seen: Tensor, ranges: Ranges, pose: Pose, driven: Command, state: RangingState
    ) -> tuple[Command, RangingState]:
        """Remember what is seen, measure the free arcs, decide.

        Args:
            seen: cells `[..., 4, bands, blocks]`.
            ranges, pose, driven, state: as `Controller.step`.
        """
        return self.caution(*self.steer(seen, ranges, pose, driven, self.woken(state)), pose, state.floor.noise)

    def woken(self, state: RangingState) -> RangingState:
        """As `Controller.woken`: a car that could not begin tries again."""
        if not state.mode.ndim and kernels_wanted(state.mode) and int(state.mode) != STOPPED:
            return state
        return state._replace(mode=woken(state.mode, state.floor, self.floor))

    def steer(
        self, seen: Tensor, ranges: Ranges, pose: Pose, driven: Command, state: RangingState
    ) -> tuple[Command, RangingState]:
        """`step` without caution."""
        if (
            not pose.x.ndim
            and seen.dtype == state.floor.level.dtype == ranges.x.dtype
            and kernels_wanted(seen, *ranges)
        ):
            return self.quick(seen, ranges, pose, driven, state)
        lengths, floor, patch = self.sense(seen, ranges, pose, driven, state)
        return decide(lengths, driven, floor, patch, state, self.constants, self.floor, pose)

    def caution(
        self, command: Command, state: RangingState, pose: Pose, noise: Tensor | None = None
    ) -> tuple[Command, RangingState]:
        """Stand where the way ahead is not long enough to begin, and go only as fast as floor is told from noise.

        Args:
            noise: of the state before the step; with it a car stands on until its noise has settled.
        """
        share = speed_share(known_share(state.floor, self.full_flow, self.params.least_noise, self.floor))
        slow, learning = share < 1.0, state.floor.age <= self.floor.learning
        if not bool((slow | learning).any()):
            return command, state
        floor, stands = state.floor, share <= 0.0
        if noise is not None:
            stands = stands | (slow & settling(floor.noise, noise))
        if bool(learning.any()):
            # Who has begun comes nearer to what is ahead while it learns: it shall not stand there again, and for good.
            needs = torch.where(floor.age > self.floor.standing + 1, START_GOES_ON, 1.0) * self.params.start_needs
            held = learning & (self.straight(state.patch, pose) < needs)
            floor = FloorState(
                torch.where(held.unsqueeze(-1), 0.0, floor.level),
                floor.noise,
                torch.where(held, torch.minimum(floor.age, self.floor.standing), floor.age),
            )
            stands = stands | held
        speed = torch.where(command.speed > 0, command.speed * share, command.speed)
        mode = torch.where(stands, torch.full_like(state.mode, STOPPED), state.mode)
        still = torch.zeros_like(speed)
        command = Command(torch.where(stands, still, speed), torch.where(stands, still, command.curvature))
        return command, state._replace(floor=floor, mode=mode)

    def straight(self, patch: Patch, pose: Pose) -> Tensor:
        """How far nothing is known to be in the way straight ahead, m."""
        places = self.places[:, self.marked :].to(pose.x).expand(*pose.x.shape, 2, -1)
        number = cell_numbers(places, pose, self.params.patch)
        evidence = in_the_way(patch, self.params.blocked)
        return free_travel(evidence.gather(-1, number), self.arcs, self.constants.limits)[..., 0, 0]

    def told_near(
        self, state: RangingState, pose: Pose, things: Obstacles, across: Obstacles, floor_seen: bool
    ) -> RangingState:
        """As `Controller.told_near`."""
        p = self.params
        return state._replace(patch=remember_near(state.patch, pose, things, across, floor_seen, p.blocked, p.patch))

    def glances(self, state: RangingState) -> Glance:
        """As `Controller.glances`: every `glance_time`; a turn may lead to what was too near to be ranged.

        No frame has both, as long as there is one between: the longest step counts.
        """
        if not self.params.overhangs:
            return Glance()
        since = int(state.age) % self.every
        return Glance(since == 0, since == self.every // 2 and int(state.mode) == TURN)

    def told_more(
        self, state: RangingState, pose: Pose, ranges: Ranges | None, things: Obstacles | None
    ) -> RangingState:
        """As `Controller.told_more`."""
        patch, p = state.patch, self.params
        if ranges is not None:
            one, kinds = not pose.x.ndim, (patch.upright.dtype, ranges.x.dtype, ranges.y.dtype)
            if one and kinds == (pose.x.dtype,) * 3 and kernels_wanted(patch.upright, *ranges):
                upright = self.quick.with_ranges(patch.upright, ranges, pose, p.glance_weight)
                patch = patch._replace(upright=upright)
            else:
                patch = remember_ranges(patch, ranges, pose, self.nowhere, self.rig, self.searched)
        if things is not None:
            patch = remember_things(patch, pose, things, p)
        return state._replace(patch=patch)

    def settled(self, state: RangingState) -> bool:
        """As `Controller.settled`: it knows its floor."""
        return float(state.floor.age) > float(self.floor.learning) and bool((state.floor.level > 0).all())

    def trouble(self, state: RangingState) -> str | None:
        """As `Controller.trouble`."""
        floor, p = state.floor, self.params
        if int(state.mode) == STOPPED and float(floor.age) <= float(self.floor.standing):
            noisy = ", and the pictures are noisy" * (float(floor.noise) > p.least_noise)
            why = noisy or ": something stands there, or the floor shows too little to both cameras"
            return f"it cannot begin: less than {p.start_needs} m of floor are seen free ahead{why}"
        share = float(known_share(floor, self.full_flow, p.least_noise, self.floor))
        if share >= FULL:
            return None
        why = (
            "the pictures are noisy" if float(floor.noise) > p.least_noise else "the floor shows little, or it is dark"
        )
        return f"floor is told from noise in {100 * share:.0f} % of the view: {why}"

    def sense(
        self,
        seen: Tensor,
        ranges: Ranges,
        pose: Pose,
        driven: Command,
        state: RangingState,
        more: tuple[Tensor, Tensor] | None = None,
    ) -> tuple[Tensor, FloorState, Patch]:
        """Remember what is seen and measure the free arcs.

        Args:
            more: further places `[..., 2, m]` of the body frame, and the evidence `[..., m]` that each adds.

        Returns:
            Lengths of the arcs as `decide` takes them, and the new states of floor and patch.
        """
        c, batch = self.constants, pose.x.shape
        cells, floor = floor_step(seen, driven.speed, driven.curvature, state.floor, self.floor)
        keep = torch.where(state.mode == c.stopped, c.fade, c.keep)
        patch = move_patch(state.patch, pose, self.numbers, keep, self.params.patch)
        weights = c.evidence
        ranged = torch.stack((ranges.x, ranges.y), -2)
        inside = ranges.valid & (ranged.abs().amax(-2) < c.reach)
        found = inside * weights[2]
        if more is not None:
            ranged, found = torch.cat((more[0], ranged), -1), torch.cat((more[1], found), -1)
        places = torch.cat((ranged, self.places.expand(*batch, *self.places.shape)), -1)
        number = cell_numbers(places, pose, self.params.patch)
        cell = (cells.ends * weights[0] - cells.free * weights[1]).flatten(-3)
        weight = torch.cat((found, cell, self.under.expand(*batch, -1)), -1)
        marked = found.shape[-1] + self.marked
        patch = add_evidence(patch, number[..., :marked], weight, self.params.patch)
        if self.params.overhangs:
            body = self.places[:, self.marked - self.under.numel() : self.marked]
            patch = remember_ranges(patch, ranges, pose, body, self.rig, self.params)
        evidence = in_the_way(patch, self.params.blocked)
        lengths = free_travel(evidence.gather(-1, number[..., marked:]), self.arcs, c.limits)
        return lengths, floor, patch

    def mode(self, state: RangingState) -> Tensor:
        """What the car is doing; `SUPPRESSED` is the start, `STOPPED` boxed in."""
        return state.mode

    def difference(self, state: RangingState) -> Tensor:
        """Length of the free arcs on the left minus the right, m."""
        return state.difference
