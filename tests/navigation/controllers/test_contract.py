"""Controllers by name: those there are keep the contract, and another one is one class."""

from typing import NamedTuple

import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import (
    CRUISE,
    Command,
    Navigator,
    NavigatorOptions,
    StereoRig,
    controller_names,
    make_controller,
)
from ndtorch.navigation.controllers import contract
from ndtorch.navigation.controllers.contract import DEFAULT_CONTROLLER, Controller, register
from ndtorch.navigation.controllers.published import AvoidanceParams, SubfieldMotion

DT = 1 / 30
RIG = StereoRig(forward=0.15)
NAMES = controller_names()


def frames(steps=12):
    generator = torch.Generator().manual_seed(3)
    wide = torch.randint(0, 256, (3, 480, 740 + 3 * steps), generator=generator, dtype=torch.uint8)
    pairs = [[wide[..., 3 * t + k : 3 * t + k + 640] for k in (0, 100)] for t in range(steps)]
    return torch.stack([a for a, _ in pairs]), torch.stack([b for _, b in pairs])


@pytest.mark.parametrize("name", NAMES)
def test_each_keeps_the_contract(name):
    controller, (left, right) = make_controller(name, RIG, DT), frames()
    assert isinstance(controller.params, controller.Params)
    assert controller.fields == NavigatorOptions(name).fields(RIG)
    command, state = Navigator(RIG, DT, controller=controller)(left, right)
    assert torch.isfinite(torch.stack(command)).all()
    assert int(controller.mode(state.control)) in controller.modes
    assert state.difference == state.control.difference
    assert state.sides.shape == (2,)
    batched, batch = Navigator(RIG, DT, controller=controller)(torch.stack((left, left)), torch.stack((right, right)))
    torch.testing.assert_close(batched.speed[1], command.speed)
    assert batch.difference.shape == (2,)


class Nothing(NamedTuple):
    steps: torch.Tensor
    difference: torch.Tensor


class Slow(Controller):
    """Goes straight on, slowly."""

    name, Params, modes = "slow", AvoidanceParams, (CRUISE,)

    def __init__(self, rig, dt, params=None):
        super().__init__(rig, dt, params)
        self.look = SubfieldMotion(rig, dt)
        self.fields = self.look.fields

    def see(self, frames, state=None):
        motion, state = self.look(*frames, state)
        return motion[..., 0, :], motion[..., 0, :], state

    def start(self, seen, pose):
        return Nothing(torch.zeros_like(pose.x), torch.zeros_like(pose.x))

    def step(self, seen, ranges, pose, driven, state):
        steps = state.steps + 1
        return Command(torch.full_like(steps, 0.1), torch.zeros_like(steps)), Nothing(steps, torch.zeros_like(steps))

    def mode(self, state):
        return torch.full_like(state.steps, CRUISE)


def test_another_controller_is_one_class(monkeypatch):
    monkeypatch.setitem(contract.CONTROLLERS, "slow", {})
    assert register(Slow) is Slow
    assert controller_names() == (DEFAULT_CONTROLLER, "goal", "published", "slow")
    navigator = NavigatorOptions("slow").navigator(RIG, 30.0)
    assert navigator.backend == "torch"
    command, state = navigator(*frames(5))
    assert (command.speed == 0.1).all()
    assert float(state.control.steps) == 5
    other = type("Other", (Slow,), {"name": "published"})
    with pytest.raises(InputError, match="controller 'published' already"):
        register(other)
