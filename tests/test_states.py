"""Every public module against every kind of thing that is no state of its own: one `InputError` that says so."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from ndtorch import navigation, vision
from ndtorch.errors import InputError
from tests.properties import DT, RIG, Part, samples, trial
from tests.test_properties import PARTS

WITH_STATE = [name for name, part in PARTS.items() if part.state]


def spoiled(state: Any, change: Callable[[Tensor], Any]) -> Any:
    """The same, with every tensor and array changed."""
    if isinstance(state, Tensor):
        return change(state)
    if isinstance(state, np.ndarray):
        changed = change(torch.from_numpy(state))
        usual = isinstance(changed, Tensor) and changed.layout == torch.strided and not changed.is_meta
        return changed.numpy() if usual else changed
    if isinstance(state, tuple):
        parts = [spoiled(part, change) for part in state]
        return type(state)(*parts) if hasattr(state, "_fields") else tuple(parts)
    return state


def streams(part: Part, steps: int = 3) -> Any:
    chance = torch.Generator().manual_seed(1)
    made = part.given(lambda *shape: samples((2, steps, *shape), "noise", chance))
    return made if part.batched else trial(made, 0)


BAD: dict[str, Callable[[Any], Any]] = {
    "text": lambda state: "state",
    "number": lambda state: 1.0,
    "list": lambda state: [1, 2],
    "dict": lambda state: {},
    "tensor": lambda state: torch.zeros(3),
    "nothing": lambda state: (),
    "its parts": lambda state: tuple(state),
    "the output": lambda state: (torch.zeros(3), state),
    "of another": lambda state: vision.ChahlSrinivasan()(torch.zeros(2, 1, 1, 8))[1],
    "meta": lambda state: spoiled(state, lambda x: x.to("meta")),
    "sparse": lambda state: spoiled(state, lambda x: x.to_sparse() if x.ndim else x),
}


@pytest.mark.parametrize("name", WITH_STATE)
@torch.no_grad()
def test_what_is_no_state_is_refused(name: str) -> None:
    part = PARTS[name]
    given = streams(part)
    _, state = part.run(given)
    part.run(given, state)
    for kind in sorted(set(BAD) - {"of another"} if name == "ChahlSrinivasan" else BAD):
        with pytest.raises(InputError, match="state"):
            part.run(given, BAD[kind](state))


@pytest.mark.parametrize("name", ["RunningMax", "ChahlSrinivasan", "Resample"])
@pytest.mark.parametrize("change", [lambda x: x[:1], lambda x: torch.cat([x, x]), lambda x: x[..., :-1]])
@torch.no_grad()
def test_samples_that_are_kept_must_be_of_the_size_of_those_that_come(name: str, change: Any) -> None:
    part = PARTS[name]
    given = streams(part)
    _, state = part.run(given)
    with pytest.raises(InputError, match=r"state\.\w+ must be \(2, .* as the input is"):
        part.run(given, spoiled(state, lambda x: change(x) if x.ndim else x))


@pytest.mark.parametrize("name", sorted(set(WITH_STATE) - {"GridMap", "Controller"}))
@torch.no_grad()
def test_a_state_that_holds_nan_is_refused(name: str) -> None:
    """Maps and controllers do not look for it at every step: files of maps are looked at when they are read."""
    part = PARTS[name]
    given = streams(part)
    _, state = part.run(given)
    bad = spoiled(state, lambda x: torch.full_like(x, math.nan) if x.is_floating_point() else x)
    with pytest.raises(InputError, match=r"finite|state\."):
        part.run(given, bad)


OF_TRIALS = {
    "CoherentMotion",
    "InhibitoryNetwork",
    "ObjectFiles",
    "RetinotopicModel",
    "AlphaBetaTracker",
    "GridMap",
} | {"ObservationList", "Navigator", "Controller"}
CHANGED: dict[str, Callable[[Tensor], Tensor]] = {
    "half the trials": lambda x: x[:1] if x.ndim and len(x) == 2 else x,
    "three times as many": lambda x: torch.cat([x, x, x]) if x.ndim and len(x) == 2 else x,
    "whole numbers": lambda x: x.long() if x.is_floating_point() else x,
}


@pytest.mark.parametrize("change", CHANGED)
@pytest.mark.parametrize("name", sorted(OF_TRIALS))
@torch.no_grad()
def test_a_state_must_be_of_as_many_trials_and_hold_numbers_with_a_fraction(name: str, change: str) -> None:
    part = PARTS[name]
    given = streams(part, 8)
    _, state = part.run(given)
    with pytest.raises(InputError, match=r"state\.[\w.]+ "):
        part.run(given, spoiled(state, CHANGED[change]))


@pytest.mark.parametrize("name", ["pose", "command"])
@torch.no_grad()
def test_a_navigator_goes_on_from_finite_poses_and_commands(name: str) -> None:
    part = PARTS["Navigator"]
    given = streams(part)
    _, state = part.run(given)
    bad = spoiled(getattr(state, name), lambda x: torch.full_like(x, math.nan))
    with pytest.raises(InputError, match=rf"state\.{name}\.\w+ must be finite"):
        part.run(given, state._replace(**{name: bad}))


def test_what_a_navigator_is_told_must_be_of_its_kind() -> None:
    navigator, part = navigation.Navigator(RIG, DT), PARTS["Navigator"]
    left, right = streams(part)
    one = torch.zeros(1)
    for bad in ((one, one), one, 0.5, {"speed": one}, navigation.Pose(one, one, one)):
        with pytest.raises(InputError, match="driven must be a Command or None"):
            navigator(left, right, driven=bad)  # type: ignore[arg-type]
    for bad in ((one, one, one), one, 0.5, navigation.Command(one, one)):
        with pytest.raises(InputError, match="start must be a Pose or None"):
            navigator(left, right, start=bad)  # type: ignore[arg-type]
