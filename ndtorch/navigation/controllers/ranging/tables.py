"""Parameters of the ranging controller as its compiled step takes them, for one rig and time step."""

from __future__ import annotations

import math

import numpy as np

from ndtorch.navigation.body import USUAL_SPEED
from ndtorch.navigation.controllers.ranging._kernels import DecisionNumbers, RangingTables
from ndtorch.navigation.controllers.ranging._kernels_floor import FloorNumbers
from ndtorch.navigation.controllers.ranging.floor_view import FloorView
from ndtorch.navigation.controllers.ranging.params import RangingParams
from ndtorch.navigation.local_grid._kernels import LINE_FROM, LINE_PLACES, LINE_TO, GridNumbers
from ndtorch.navigation.local_grid.motion_primitives import motion_primitives
from ndtorch.navigation.stereo.rig import StereoRig
from ndtorch.utils.jit import packed


def ranging_tables(
    rig: StereoRig, params: RangingParams, view: FloorView, dt: float, seen_through: float = 0.0
) -> RangingTables:
    """All that is fixed of a step.

    Args:
        seen_through: evidence that a range takes from every cell before it.
    """
    p = params
    wide, tight = 1 / p.turn_radius_m, 1 / p.tight_radius_m
    arcs = [(0.0, 1), (wide, 1), (tight, 1), (-wide, 1), (-tight, 1), (-tight, -1), (0.0, -1), (tight, -1)]
    longest = math.floor(min(1.6, p.grid.reach - 0.5) / p.grid.cell_m) * p.grid.cell_m
    lag = USUAL_SPEED * p.body.reaction_s
    primitives = motion_primitives(arcs, p.body, p.safety_margin_m, longest, p.grid.cell_m, lag)
    x, y = np.meshgrid(
        np.linspace(-0.4, 0.4, 6) * p.body.length_m, np.linspace(-0.4, 0.4, 5) * p.body.width_m, indexing="ij"
    )
    return RangingTables(
        floor_numbers(rig, p, view, dt),
        grid_numbers(rig, p, dt, seen_through),
        primitives,
        packed(decision_numbers(p, dt)),
        np.concatenate((view.x.numpy().ravel(), x.ravel(), primitives.x)).astype(np.float32),
        np.concatenate((view.y.numpy().ravel(), y.ravel(), primitives.y)).astype(np.float32),
        x.size,
    )


def floor_numbers(rig: StereoRig, params: RangingParams, view: FloorView, dt: float) -> FloorNumbers:
    """Numbers of `floor_step`."""
    p, sweep = params.floor, view.sweep.numpy()
    # Far floor is finer than a pixel and gives less; before its own level is learned this is a fair guess.
    profile = (1.0 - 0.5 * (view.depth.numpy() - 1.2)).clip(0.3, 1.0)
    standing = round(p.standing_s / dt)
    learning = standing + max(1, round(p.learning_s / dt))
    return FloorNumbers(
        flow=((sweep * dt) ** 2).astype(np.float32),
        profile=profile.astype(np.float32),
        full=(-np.expm1(-sweep * dt * params.speed_m_per_s / p.saturation_px)).astype(np.float32),
        yaw=rig.focal * dt,
        saturation=-1 / p.saturation_px,
        tolerance=math.log(p.tolerance_ratio),
        clear=float(p.min_signal_ratio * p.tolerance_ratio),
        standing=standing,
        learning=learning,
        learn_share=2 / (learning - standing),
        share=dt / p.adaptation_s / (2 * p.blocks),
        upright=int(p.min_upright_bands),
        trusted=float(p.min_agreement_ratio),
        floor_weight=float(params.floor_evidence),
        end_weight=float(params.hidden_evidence),
        least_noise=float(params.min_noise_output),
    )


def grid_numbers(rig: StereoRig, params: RangingParams, dt: float, seen_through: float) -> GridNumbers:
    """Numbers that update the grid."""
    p = params.grid
    return GridNumbers(
        cell=float(p.cell_m),
        keep=math.exp(-dt / p.lifetime_s),
        fade=math.exp(-dt / params.boxed_in_memory_s),
        reach=float(p.reach),
        least=float(p.max_free_evidence),
        most=float(p.max_evidence),
        range_weight=float(params.range_evidence),
        blocked=float(params.blocked_evidence),
        unknown=-0.1 * params.blocked_evidence,
        beam_forward=float(rig.forward),
        beam_left=rig.baseline / 2,
        miss=float(params.miss_evidence),
        seen_through=float(seen_through),
        cells_per_m=(LINE_TO - LINE_FROM) / (LINE_PLACES - 1) / p.cell_m,
    )


def decision_numbers(params: RangingParams, dt: float) -> DecisionNumbers:
    """Numbers of `decide` and `limit`."""
    p = params
    return DecisionNumbers(
        speed=float(p.speed_m_per_s),
        tight_speed=float(p.tight_speed_m_per_s),
        reverse_speed=float(p.reverse_speed_m_per_s),
        unseen_speed=float(p.unseen_speed_m_per_s),
        wide=1 / p.turn_radius_m,
        tight=1 / p.tight_radius_m,
        turn_below_m=float(p.turn_below_m),
        cruise_above_m=float(p.cruise_above_m),
        wide_turn_min_m=float(p.wide_turn_min_m),
        min_free_m=float(p.min_free_m),
        turn_steps=round(p.min_turn_s / dt),
        reverse_length=float(p.reverse_m),
        room=float(p.reverse_until_free_m),
        side_hysteresis_m=float(p.side_hysteresis_m),
        known_ratio=float(p.known_ratio),
        unknown_margin_m=float(p.unknown_margin_m),
        start_needs=float(p.start_free_m),
        dt=float(dt),
    )
