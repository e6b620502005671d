"""Every public module against what is no state of its own, and against NaN: one `InputError` that says so."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from ndtorch import navigation, vision
from ndtorch.errors import InputError
from ndtorch.utils.tensors import leaves, mapped
from tests.properties import DT, PUBLIC, RIG, Part, samples, trial
from tests.test_properties import ABSTRACT, PARTS

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


class Localised:
    """A localiser, as a module is asked."""

    def __call__(self, rows: Tensor, pose: navigation.Pose, state: Any = None) -> tuple[Any, Any]:
        localiser = navigation.Localiser(RIG, DT)
        for seen, at in zip(rows, zip(*pose, strict=True), strict=True):
            state = localiser(seen, navigation.Pose(*map(float, at)), state)
        return state.pose, state


class Saccades:
    """The published controller alone."""

    def __call__(self, frames: Tensor, state: Any = None) -> tuple[Any, Any]:
        controller = navigation.SaccadeController(RIG, DT)
        for left, right in frames.numpy():
            command, state = controller(left, right, state)
        return command, state


def full(name: str) -> navigation.Navigator:
    """A navigator with all that it may have beside a controller."""
    parts: dict[str, Any] = {
        "grid_map": navigation.GridMap(RIG, navigation.Grid(cell=0.5)),
        "observations": navigation.ObservationList(DT, 12),
        "tracker": navigation.AlphaBetaTracker(DT),
    }
    located = navigation.Localiser(RIG, DT) if name != "published" else None
    return navigation.Navigator(RIG, DT, controller=name, localiser=located, **parts)


EYES = PARTS["Navigator"]
STATEFUL = {name: PARTS[name] for name in WITH_STATE} | {
    "Localiser": Part(
        lambda: Localised(),  # type: ignore[arg-type, return-value]
        lambda draw: (draw(2, RIG.width), navigation.Pose(draw(), draw(), draw())),
        batched=False,
        double=False,
    ),
    "SaccadeController": Part(
        lambda: Saccades(),  # type: ignore[arg-type, return-value]
        lambda draw: ((255 * draw(2, 1, RIG.height, RIG.width)).to(torch.uint8),),
        batched=False,
        double=False,
    ),
    **{
        f"{name}, all parts": replace(EYES, make=lambda name=name: full(name)) for name in navigation.controller_names()
    },
}


def test_no_public_class_with_a_state_is_left_out() -> None:
    public = {name: getattr(module, name) for module in PUBLIC for name in module.__all__}
    calls = {
        name: getattr(kind, "forward", kind.__dict__.get("__call__"))
        for name, kind in public.items()
        if inspect.isclass(kind)
    }
    stateful = {name for name, call in calls.items() if call and "state" in inspect.signature(call).parameters}
    assert stateful - set(ABSTRACT) - {"Sequential"} <= set(STATEFUL)


def with_nan(tree: Any, name: str) -> Any:
    """The same with NaN as the last number of one leaf."""

    def change(at: str, value: Tensor) -> Tensor:
        value = value.clone(memory_format=torch.contiguous_format)
        if at == name:
            value.view(-1)[-1] = math.nan
        return value

    return mapped(tree, change)


def fractions(tree: Any) -> list[str]:
    return [name for name, value in leaves(tree).items() if value.is_floating_point() and value.numel()]


@pytest.mark.parametrize("name", STATEFUL)
@torch.no_grad()
def test_nan_anywhere_in_a_state_is_refused(name: str) -> None:
    part = STATEFUL[name]
    given = streams(part)
    if name.endswith("parts"):
        given = trial(given, 0)
    _, state = part.run(given)
    part.run(given, state)
    silent = []
    for leaf in fractions(state):
        if ".rows." in leaf and not leaf.endswith(".0.0"):  # one tile of a map stands for all
            continue
        try:
            part.run(given, with_nan(state, leaf))
            silent.append(leaf)
        except InputError:
            pass
    assert not silent


READ_IN_PART = {"Navigator", "Controller", "StereoRanging"}
"""They read two rectangles and a few rows of a frame."""


@pytest.mark.parametrize("name", STATEFUL)
@torch.no_grad()
def test_nan_in_what_is_given_is_refused(name: str) -> None:
    """Frames, ranges, poses, motion: what is read of them is looked at, whatever the state."""
    part = STATEFUL[name]
    given = streams(part)
    if name.endswith("parts"):
        given = trial(given, 0)
    _, state = part.run(given)
    in_part = name in READ_IN_PART or name.endswith("parts")
    for leaf in fractions(given):
        if leaf.endswith(UNREAD.get(name, ())):
            continue
        bad = mapped(given, lambda at, x, leaf=leaf: torch.full_like(x, math.nan) if at == leaf else x)
        for before in (None, state):
            with pytest.raises(InputError):
                part.run(bad if in_part else with_nan(given, leaf), before)


UNREAD = {"GridMap": ("left_range",)} | dict.fromkeys(
    ("ObservationList", "AlphaBetaTracker"), ("left_range", "left_angle", "right_angle")
)


@pytest.mark.parametrize("name", navigation.controller_names())
def test_a_pixel_of_nan_is_refused_or_changes_nothing(name: str) -> None:
    """Few pixels are read, and all that are read are looked at."""
    navigator = navigation.Navigator(RIG, DT, controller=name)
    chance = torch.Generator().manual_seed(2)
    eyes = torch.rand(2, 1, 1, RIG.height, RIG.width, generator=chance)
    _, state = navigator(*eyes)
    wanted, refused = leaves(navigator(*eyes, state)), 0
    for number in range(0, 2 * RIG.height * RIG.width, 131):
        bad = eyes.clone()
        bad.view(-1)[number] = math.nan
        try:
            made = leaves(navigator(*bad, state))
        except InputError:
            refused += 1
        else:
            assert all(torch.equal(value, wanted[leaf]) for leaf, value in made.items())
    assert refused > 3


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
