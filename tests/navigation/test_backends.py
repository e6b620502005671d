"""The backends of the published navigator agree, and compiled steps take any frames as they lie in memory."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor

from ndtorch.errors import InputError
from ndtorch.navigation import (
    Command,
    FeatureParams,
    MatchParams,
    Navigator,
    Pose,
    StereoRanging,
    StereoRig,
)
from ndtorch.navigation.stereo.strips import as_frames, cut_strips
from ndtorch.utils import tensors as tree

DT = 1 / 30
RIG = StereoRig(width=320, height=240, focal=215.0, pitch=0.1, forward=0.15)
KINDS = (torch.uint8, *(pytest.param(kind, marks=pytest.mark.long) for kind in (torch.float32, torch.float64)))


def pairs(dtype: torch.dtype, channels: int = 3, frames: int = 5) -> tuple[Tensor, Tensor]:
    """A random texture that moves, seen twice with a disparity."""
    coarse = torch.rand(1, channels, 60, 160, generator=torch.Generator().manual_seed(0))
    wide = torch.nn.functional.interpolate(coarse, scale_factor=4, mode="bilinear")[0]
    eyes = []
    for shift in (0, 40):
        views = [wide[:, :, shift + 3 * n : shift + 3 * n + 320] for n in range(frames)]
        eyes.append(torch.stack(views))
    made = [eye.mul(255).round().to(torch.uint8) if dtype == torch.uint8 else eye.to(dtype) for eye in eyes]
    return made[0], made[1]


def steady(module: StereoRanging, left: Tensor, right: Tensor) -> list[Tensor]:
    """Of every frame, the ranges `[n]` that a change of the pixels by a millionth leaves alone."""
    eyes = [eye.double() / 255 if eye.dtype == torch.uint8 else eye.double() for eye in (left, right)]
    runs, chance = [], torch.Generator().manual_seed(1)
    for _ in range(8):
        noisy = [eye + 1e-6 * torch.randn(eye.shape, generator=chance, dtype=eye.dtype) for eye in eyes]
        ranges, _ = module(*noisy)
        runs.append(torch.stack([ranges.valid.double(), ranges.left_angle]))
    return list(torch.stack(runs).std(0).amax(0) < 1e-3)


@pytest.mark.parametrize(
    ("features", "matching"),
    [
        (FeatureParams(), MatchParams(10, 100)),
        (FeatureParams(7, edge_reach_px=4, shared=True), MatchParams(10, 100)),
        (FeatureParams(20, spacing_px=5, edge_reach_px=2), MatchParams(0, 300, one_to_one=False, max_error=0.01)),
        (FeatureParams(1), MatchParams(0, 300)),
    ],
)
@pytest.mark.parametrize("kind", KINDS)
def test_ranges(kind: torch.dtype, features: FeatureParams, matching: MatchParams) -> None:
    """Features alike, or just at a limit, may be taken either way: the order of rounding differs."""
    for angles in ("atan", "linear"):
        left, right = pairs(kind, frames=4)
        module = StereoRanging(RIG, DT, features, matching, angles)  # type: ignore[arg-type]
        wanted, _ = module(left, right)
        state, some, certain = None, 0, 0.0
        for n, clear in enumerate(steady(module, left, right)):
            found, state = module.step(as_frames(left[n], right[n]), state)
            alike = torch.from_numpy(found.valid) == wanted.valid[n]
            assert bool(alike[clear].all())
            certain += clear.double().mean().item() / 4
            some += int(found.valid.sum())
            for part, other in zip(found[:5], wanted[:5], strict=True):
                np.testing.assert_allclose(part[alike.numpy()], other[n][alike], rtol=1e-4, atol=1e-4)
        assert some or features.count == 1
        assert certain > 0.5  # not all, because the texture is of even slopes, which move alike


@pytest.mark.parametrize("kind", KINDS)
def test_a_drive(kind: torch.dtype) -> None:
    left, right = pairs(kind, 1, 40)
    runs = []
    for backend in ("numba", "torch"):
        navigator, state, run = Navigator(RIG, DT, controller="published", backend=backend), None, []
        for eyes in zip(left.split(1), right.split(1), strict=True):
            command, state = navigator(*eyes, state)
            run += [float(command.speed), float(command.curvature), float(state.difference), float(state.pose.x)]
            run += [*map(float, state.sides), float(navigator.mode(state))]
        runs.append(run)
    assert runs[0] == pytest.approx(runs[1], abs=1e-4)
    assert len({*runs[0][::7], *runs[0][1::7]}) > 1


@pytest.mark.parametrize("backend", ["numba", "torch"])
def test_what_was_driven_and_where_it_began(backend: str) -> None:
    navigator = Navigator(RIG, DT, controller="published", features=FeatureParams(7), backend=backend)
    left, right = pairs(torch.uint8)
    fields = navigator.controller.fields
    start, driven = Pose(*torch.tensor([1.0, 2.0, 0.5])), Command(*torch.tensor([[0.4], [0.3]]))
    _, state = navigator(left[:1], right[:1], start=start)
    for n in range(1, 5):
        eyes = (cut_strips(eye[n : n + 1], f, RIG) for eye, f in zip((left, right), fields, strict=True))
        _, state = navigator(*eyes, state, driven)
    assert float(state.pose.heading) == pytest.approx(0.5 + 4 * 0.4 * 0.3 * DT, abs=1e-5)
    along = np.hypot(float(state.pose.x) - 1, float(state.pose.y) - 2)
    assert along == pytest.approx(4 * 0.4 * DT, rel=1e-3)


@pytest.mark.parametrize("controller", ["published", "ranging"])
def test_a_batch_is_each_car(controller: str) -> None:
    navigator, (left, right) = Navigator(RIG, DT, controller=controller), pairs(torch.uint8, 1, 30)
    both = [torch.stack((eye, eye // 4 * 3)).reshape(1, 2, 30, 1, 240, 320) for eye in (left, right)]
    driven = Command(torch.tensor([[[0.5], [0.4]]]).expand(1, 2, 30), torch.tensor([[[0.0], [0.1]]]).expand(1, 2, 30))
    command, state = navigator(*(eye[..., :20, :, :, :] for eye in both), None, Command(*(d[..., :20] for d in driven)))
    rest, state = navigator(*(eye[..., 20:, :, :, :] for eye in both), state, Command(*(d[..., 20:] for d in driven)))
    assert state.pose.x.shape == (1, 2)
    for car in range(2):
        alone, own = navigator(*(eye[0, car] for eye in both), None, Command(*(d[0, car] for d in driven)))
        for part in range(2):
            assert torch.equal(torch.cat((command[part][0, car], rest[part][0, car])), alone[part])
        for name, value in tree.leaves(own).items():
            assert torch.equal(tree.leaves(state)[name][0, car].to(value.dtype), value), name
        assert int(navigator.mode(state)[0, car]) == navigator.mode(own)


@pytest.mark.parametrize("controller", ["published", "ranging"])
@pytest.mark.parametrize("worth", [torch.nan, torch.inf, 30.0])
def test_pixels_that_are_no_numbers_in_0_1_are_refused(controller: str, worth: float) -> None:
    navigator, (left, right) = Navigator(RIG, DT, controller=controller), pairs(torch.float32, 1, 2)
    _, state = navigator(left[:1], right[:1])
    for row in (RIG.row, 137):
        spoiled = left[1:].clone()
        spoiled[..., row, 120] = worth
        with pytest.raises(InputError, match=r"finite numbers in 0..1"):
            navigator(spoiled, right[1:], state)


def test_a_backend_is_chosen_or_refused() -> None:
    for name in ("ranging", "goal"):
        assert Navigator(RIG, DT, controller=name).backend == "numba"
        with pytest.raises(InputError, match=f"the {name} controller has the backend numba"):
            Navigator(RIG, DT, controller=name, backend="torch")
    control = Navigator(RIG, DT, controller="published", backend="torch").controller
    assert Navigator(RIG, DT, controller=control).backend == "torch"
    with pytest.raises(InputError, match="has the backend 'torch', got backend='numba'"):
        Navigator(RIG, DT, controller=control, backend="numba")


def test_gradients_go_through_the_torch_backend() -> None:
    left, right = (eye.requires_grad_() for eye in pairs(torch.float32, 1, 6))
    _, state = Navigator(RIG, DT, controller="published", backend="torch")(left, right)
    state.difference.backward()
    assert float(left.grad.abs().sum()) > 0  # type: ignore[union-attr]
