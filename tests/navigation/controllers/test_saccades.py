"""The published controller compiled and in torch: one drives as the other."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from ndtorch.navigation import SaccadeController, StereoRig
from ndtorch.navigation.controllers._kernels import avoidance
from ndtorch.navigation.controllers.published import PublishedControl, SaccadeAvoidance, avoidance_step

RIG = StereoRig(width=320, height=240, focal=215.0, pitch=0.1, forward=0.15)
DT = 1 / 30


def frames(count: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Noise of which first the left and then the right eye sees more change."""
    chance = np.random.default_rng(0)
    pairs = []
    for n in range(count):
        strength = (0.9, 0.3) if n < count // 2 else (0.1, 0.5)
        pairs.append(tuple((chance.random((240, 320, 3)) * 255 * s).astype(np.uint8) for s in strength))
    return pairs


def test_it_drives_as_the_controller_in_torch_does() -> None:
    avoider, control = SaccadeController(RIG, DT), PublishedControl(RIG, DT)
    state = fields = machine = None
    driven, modes = set(), set()
    for n, pair in enumerate(frames(80)):
        planar = n % 2
        given = [np.ascontiguousarray(eye.transpose(2, 0, 1)) if planar else eye for eye in pair]
        found, state = avoider(*given, state)
        eyes = [torch.from_numpy(eye).permute(2, 0, 1).unsqueeze(0) for eye in pair]
        with torch.no_grad():
            sides, fields = control.look(*eyes, fields)
            wanted, machine = control.rule(sides, machine)
        assert tuple(found) == pytest.approx((float(wanted.speed), float(wanted.curvature)), abs=1e-5)
        modes.add(avoider.mode(state.machine))
        assert avoider.mode(state.machine) == int(control.mode(machine))
        assert avoider.difference(state.machine) == pytest.approx(float(machine.difference), abs=1e-5)
        driven.add(round(found[1], 3))
    assert len(driven) > 1
    assert len(modes) > 1
    np.testing.assert_allclose(state.low, fields.low.numpy().reshape(state.low.shape), atol=1e-6)


def test_the_state_machines_agree() -> None:
    rule, chance = SaccadeAvoidance(DT), torch.Generator().manual_seed(0)
    compiled = SaccadeController(RIG, DT)
    sides = torch.rand(400, 2, generator=chance) * torch.tensor([2.4, 2.2])
    sides[350:] = 0.01
    wanted, found, modes = rule.start(sides[0]), compiled.begin(*sides[0].tolist()), set()
    for now in sides:
        expected, wanted = avoidance_step(now, wanted, rule.constants)
        command, found = avoidance.function(*now.tolist(), found, compiled.numbers)
        assert tuple(command) == pytest.approx(tuple(map(float, expected)), abs=1e-6)
        assert tuple(found) == pytest.approx(tuple(map(float, wanted)), abs=1e-5)
        modes.add(int(rule.mode(wanted)))
    assert len(modes) == 4
