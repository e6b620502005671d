"""A step of many cars by the kernel of one, and what is left to the parts."""

from __future__ import annotations

import math
from typing import Any

import pytest
import torch
from torch.utils._pytree import tree_flatten

from ndtorch.navigation import Command, Navigator, RangingParams
from ndtorch.navigation.batch_step import batch_step
from ndtorch.navigation.state import StepState
from ndtorch.navigation.strip_kernels import state_fits
from ndtorch.navigation.strips import Strips
from ndtorch.vision.temporal import FilterState
from tests.navigation.test_kernels import DT, RIG, pairs

pytest.importorskip("numba")


@pytest.mark.parametrize("controller", ["published", "ranging"])
def test_many_cars_drive_as_each_of_them_alone(controller: str) -> None:
    """Kernels for one car after the other, from the step on from which all know what to steer by."""
    # It learns its floor though a thing may stand before it.
    params = RangingParams(start_needs=1e-6) if controller == "ranging" else None
    navigator, (left, right) = Navigator(RIG, DT, controller=controller, params=params), pairs(torch.uint8, 1, 30)
    both = [torch.stack((eye, eye // 4 * 3), 1).unsqueeze(2) for eye in (left, right)]
    driven = Command(torch.tensor([[0.5], [0.4]]), torch.tensor([[0.0], [0.1]]))
    runs, state, steps = [], None, 0
    with torch.inference_mode():
        for ours, theirs in zip(*both, strict=True):
            command, state = navigator(ours, theirs, state, driven)
            runs.append(torch.cat((command.speed, command.curvature, *(p.unsqueeze(-1) for p in state.pose)), -1))
            steps += isinstance(state, StepState)
        assert steps > 5
        for car in range(2):
            alone = None
            for n in range(30):
                here = Command(*(part[car] for part in driven))
                command, alone = navigator(*(eye[n, car] for eye in both), alone, here)
                wanted = torch.cat((command.speed, command.curvature, torch.stack(alone.pose)))
                torch.testing.assert_close(runs[n][car], wanted, rtol=1e-4, atol=1e-4)
        for part, one in zip(tree_flatten(tuple(state))[0], tree_flatten(tuple(alone))[0], strict=True):
            if one is not None:
                assert part[1].numel() == one.numel()
                torch.testing.assert_close(part[1].flatten(), one.flatten(), rtol=1e-3, atol=1e-3)


def test_what_does_not_fit_together_is_left_to_the_parts() -> None:
    navigator, (left, right) = Navigator(RIG, DT, controller="published"), pairs(torch.uint8, 1, 12)
    driven, state = Command(torch.full((2, 1), 0.5), torch.zeros(2, 1)), None
    with torch.inference_mode():
        eyes = [[torch.stack((eye[n], eye[n] // 2)).unsqueeze(1) for n in range(12)] for eye in (left, right)]
        for n in range(11):
            _, state = navigator(eyes[0][n], eyes[1][n], state, driven)
        one, other = (Strips(eye[11], eye[11]) for eye in eyes)
        good: dict[str, Any] = {"left": one, "right": other, "state": state, "driven": driven}
        whole = navigator.whole_step()

        def step(**given: Any) -> Any:
            return batch_step(whole, **{**good, **given})

        assert step() is not None
        assert step(driven=None) is not None
        for side, eye in (("left", one), ("right", other)):
            for part in ("field", "row"):
                frames = getattr(eye, part)
                for odd in (frames[:1], torch.cat((frames, frames)), frames.float(), frames[0], frames.numpy()):
                    assert step(**{side: eye._replace(**{part: odd})}) is None, (side, part, odd.shape)
        for rows in (lambda x: x[:1], lambda x: torch.cat((x, x))):
            # Of both eyes alike.
            assert step(left=one._replace(row=rows(one.row)), right=other._replace(row=rows(other.row))) is None
            assert step(left=Strips(*map(rows, one)), right=Strips(*map(rows, other))) is None
        for bad in (Command(torch.zeros(2), torch.zeros(2)), Command(torch.zeros(3, 1), torch.zeros(2, 1))):
            assert step(driven=bad) is None
        for number in (math.nan, math.inf):
            assert step(driven=driven._replace(curvature=torch.tensor([[0.0], [number]]))) is None
        assert step(state=None) is None


def test_kernels_go_on_from_states_of_their_own_type_size_and_device() -> None:
    frames, low = torch.zeros(1, 3, 4, 5, dtype=torch.uint8), torch.zeros(3, 4)
    assert state_fits(None, frames, (3, 4))
    assert state_fits(FilterState(low), frames, (3, 4))
    assert not state_fits(FilterState(low.double()), frames, (3, 4))
    assert state_fits(FilterState(low.double()), frames.double(), (3, 4))
    assert not state_fits(FilterState(low), frames, (4, 3))
    assert not state_fits(FilterState(low.to("meta")), frames, (3, 4))
