"""The published state machine, against a plain scalar one."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from ndtorch.navigation import AvoidanceParams, StereoRig
from ndtorch.navigation.controllers.published import CompiledPublished, SaccadeAvoidance, avoidance

DT = 1 / 30


def scalar_machine(sides, p, dt=DT):
    """The rule of the paper in seconds and if-statements, for one car."""
    share = dt / (p.smoothing_s + dt)
    low = sides[0][0] - sides[0][1]
    mode, ends, curvature, out = "suppressed", p.start_suppression_s, 0.0, []
    for step, (left, right) in enumerate(sides):
        time = step * dt
        low += share * (left - right - low)
        if mode == "turn" and time >= ends - 1e-9:
            mode, curvature = "suppressed", 0.0
            ends = ends - p.turn_s + p.suppression_s if p.suppress_from_start else ends + p.suppression_s
        if mode == "suppressed" and time >= ends - 1e-9:
            mode = "cruise"
        if mode == "cruise":
            if left < p.low_threshold and right < p.low_threshold:
                mode = "stopped"
            elif left > p.high_threshold and right > p.high_threshold:
                mode, ends = "turn", time + p.turn_s
                curvature = (-1 if left > right else 1) / p.tight_radius_m
            elif abs(low) > p.turn_threshold:
                mode, ends = "turn", time + p.turn_s
                curvature = (-1 if low > 0 else 1) / p.turn_radius_m
        out.append((0.0 if mode == "stopped" else p.speed_m_per_s, curvature))
    return out


def random_sides(seed, steps=400, batch=()):
    """Estimates that wander through all three thresholds, different on either side."""
    generator = torch.Generator().manual_seed(seed)
    knots = torch.rand(*batch, 2, steps // 20 + 2, generator=generator, dtype=torch.float64)
    level = torch.rand(*batch, 1, steps // 20 + 2, generator=generator)
    knots = torch.where(level < 0.15, 2.0 + knots, torch.where(level < 0.7, 0.2 + 0.1 * knots, 0.5 * knots))
    sides = torch.nn.functional.interpolate(knots.reshape(-1, 2, knots.shape[-1]), size=steps, mode="linear")
    return sides.reshape(*batch, 2, steps).transpose(-1, -2)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.booleans())
def test_against_the_scalar_machine(seed, from_start):
    params = AvoidanceParams(suppress_from_start=from_start)
    sides = random_sides(seed)
    command, _ = SaccadeAvoidance(DT, params)(sides)
    wanted = torch.tensor(scalar_machine(sides.tolist(), params), dtype=torch.float64)
    torch.testing.assert_close(command.speed.double(), wanted[:, 0])
    torch.testing.assert_close(command.curvature.double(), wanted[:, 1])


def test_chunks_batches_and_precision():
    sides = random_sides(3, batch=(2, 3))
    machine = SaccadeAvoidance(DT)
    whole, final = machine(sides)
    parts, state = [], None
    for chunk in [*sides[..., :100, :].split(7, -2), *sides[..., 100:, :].split(1, -2)]:
        command, state = machine(chunk, state)
        parts.append(command)
    for k in range(2):
        assert torch.equal(torch.cat([part[k] for part in parts], -1), whole[k])
    for a, b in zip(state, final, strict=True):
        assert torch.equal(a, b)
    assert torch.equal(machine(sides[1, 2])[0].curvature, whole.curvature[1, 2])
    assert whole.speed.shape == (2, 3, 400)
    torch.testing.assert_close(machine(sides.float())[0].curvature, whole.curvature.float())


RIG = StereoRig(width=320, height=240, focal=215.0, pitch=0.1, forward=0.15)


def test_the_state_machines_agree() -> None:
    rule, chance = SaccadeAvoidance(DT), torch.Generator().manual_seed(0)
    compiled = CompiledPublished(RIG, DT)
    sides = torch.rand(400, 2, generator=chance) * torch.tensor([2.4, 2.2])
    sides[350:] = 0.01
    wanted, modes = rule.start(sides[0]), set()
    found = compiled.start(sides[0], None)
    for now in sides:
        expected, wanted = rule.step(now, wanted)
        command, found = avoidance(*now.tolist(), tuple(found), compiled.numbers)
        assert tuple(command) == pytest.approx(tuple(map(float, expected)), abs=1e-6)
        assert tuple(found) == pytest.approx(tuple(map(float, wanted)), abs=1e-5)
        modes.add(int(rule.mode(wanted)))
    assert len(modes) == 4
