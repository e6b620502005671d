"""What navigation does by kernels is what its step functions do in torch."""

from __future__ import annotations

import copy
import pickle

import pytest
import torch
from torch import Tensor
from torch.utils._pytree import tree_flatten

from ndtorch.errors import InputError
from ndtorch.navigation import (
    Command,
    DeadReckoning,
    FeatureParams,
    Grid,
    GridMap,
    MatchParams,
    Navigator,
    NavigatorState,
    Pose,
    RangingParams,
    RowRanging,
    StereoRig,
)
from ndtorch.navigation.controllers.published import AvoidanceState, SaccadeAvoidance, avoidance_step
from ndtorch.navigation.controllers.ranging.floor_motion import FloorMotion
from ndtorch.navigation.controllers.subfields import SubfieldMotion
from ndtorch.navigation.strips import cut_strips

pytest.importorskip("numba")

DT = 1 / 30
RIG = StereoRig(width=320, height=240, focal=215.0, pitch=0.1, forward=0.15)
# Every kind is compiled, which takes a minute for all kernels together; frames of cameras are of whole numbers.
KINDS = (torch.uint8, *(pytest.param(kind, marks=pytest.mark.long) for kind in (torch.float32, torch.float64)))


def pairs(dtype: torch.dtype, channels: int = 3, frames: int = 5) -> tuple[Tensor, Tensor]:
    """A random texture that moves, seen twice with a disparity."""
    coarse = torch.rand(1, channels, 60, 160)
    wide = torch.nn.functional.interpolate(coarse, scale_factor=4, mode="bilinear")[0]
    eyes = []
    for shift in (0, 40):
        views = [wide[:, :, shift + 3 * n : shift + 3 * n + 320] for n in range(frames)]
        eyes.append(torch.stack(views))
    made = [eye.mul(255).round().to(torch.uint8) if dtype == torch.uint8 else eye.to(dtype) for eye in eyes]
    return made[0], made[1]


def both(module: torch.nn.Module, left: Tensor, right: Tensor) -> tuple[list[tuple], list[tuple]]:
    """Output and state of every frame, by torch and by kernels."""
    runs = []
    for mode in (torch.no_grad, torch.inference_mode):
        state, run = None, []
        with mode():
            for n in range(len(left)):
                out, state = module(left[n : n + 1], right[n : n + 1], state)
                run.append((out, state))
        runs.append(run)
    return runs[0], runs[1]


def steady(module: RowRanging, left: Tensor, right: Tensor) -> list[Tensor]:
    """Of every frame, the ranges `[1, n]` that a change of the pixels by a millionth leaves alone."""
    eyes = [eye.double() / 255 if eye.dtype == torch.uint8 else eye.double() for eye in (left, right)]
    runs, chance = [], torch.Generator().manual_seed(1)
    for _ in range(8):
        noisy = [eye + 1e-6 * torch.randn(eye.shape, generator=chance, dtype=eye.dtype) for eye in eyes]
        state, run = None, []
        with torch.no_grad():
            for n in range(len(left)):
                ranges, state = module(noisy[0][n : n + 1], noisy[1][n : n + 1], state)
                run.append(torch.stack([ranges.valid.double(), ranges.left_angle]))
        runs.append(torch.stack(run))
    return list(torch.stack(runs).std(0).amax(1) < 1e-3)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("look", [SubfieldMotion, FloorMotion])
def test_motion_beside_the_path(look: type, kind: torch.dtype) -> None:
    for wanted, found in zip(*both(look(RIG, DT), *pairs(kind)), strict=True):
        torch.testing.assert_close(found[0], wanted[0], rtol=1e-5, atol=1e-5)
        torch.testing.assert_close(found[1].low, wanted[1].low, rtol=0, atol=1e-6)


def test_layouts_of_memory_and_strips_do_not_matter() -> None:
    look, (left, right) = FloorMotion(RIG, DT), pairs(torch.uint8)
    rects = look.fields
    with torch.inference_mode():
        _, state = look(left[:1], right[:1])
        wanted, _ = look(left[1:2], right[1:2], state)
        beside = [eye[1:2].permute(0, 2, 3, 1).contiguous().permute(0, 3, 1, 2) for eye in (left, right)]
        cut = [eye[1:2, :, r.top : r.bottom, r.left : r.right] for eye, r in zip((left, right), rects, strict=True)]
        assert torch.equal(look(*beside, state)[0], wanted)
        assert torch.equal(look(*cut, state)[0], wanted)


@pytest.mark.parametrize(
    ("features", "matching"),
    [
        (FeatureParams(), MatchParams(10, 100)),
        (FeatureParams(7, edge_reach=4, shared=True), MatchParams(10, 100)),
        (FeatureParams(40, spacing=5, edge_reach=2), MatchParams(0, 300, one_to_one=False, max_error=0.01)),
        (FeatureParams(1), MatchParams(0, 300)),
        (FeatureParams(7, edge_reach=4, shared=True, ahead=3), MatchParams(10, 100)),
    ],
)
@pytest.mark.parametrize("kind", KINDS)
def test_ranges(kind: torch.dtype, features: FeatureParams, matching: MatchParams) -> None:
    """Features alike, or just at a limit, may be taken either way: the order of rounding differs."""
    torch.manual_seed(0)
    for angles in ("atan", "linear"):
        eyes = pairs(kind, frames=4)
        module = RowRanging(RIG, DT, features, matching, angles)  # type: ignore[arg-type]
        some, certain = 0, 0.0
        for wanted, found, clear in zip(*both(module, *eyes), steady(module, *eyes), strict=True):
            alike = found[0].valid == wanted[0].valid
            assert bool(alike[clear].all())
            certain += clear.double().mean().item() / 4
            some += int(wanted[0].valid.sum())
            for part, other in zip(found[0][:5], wanted[0][:5], strict=True):
                torch.testing.assert_close(part[alike], other[alike], rtol=2e-5, atol=1e-5)
            torch.testing.assert_close(found[1].rows.low, wanted[1].rows.low, rtol=0, atol=1e-6)
        assert some or features.count == 1
        assert certain > 0.5  # not all, because the texture is of even slopes, which move alike


@pytest.mark.parametrize("module", [SubfieldMotion, FloorMotion, RowRanging])
def test_pixels_that_are_no_numbers_are_refused(module: type) -> None:
    look, (left, right) = module(RIG, DT), pairs(torch.float32, 1, 2)
    with torch.inference_mode():
        _, state = look(left[:1], right[:1])
        left[1, 0, RIG.row if module is RowRanging else 137, 120] = torch.nan
        with pytest.raises(InputError, match="finite"):
            look(left[1:], right[1:], state)


def test_the_state_machine() -> None:
    rule = SaccadeAvoidance(DT)
    sides = torch.rand(400, 2) * torch.tensor([2.4, 2.2])
    sides[350:] = 0.01
    found = wanted = rule.start(sides[0])
    modes = set()
    for now in sides:
        with torch.inference_mode():
            command, found = avoidance_step(now, found, rule.constants)
        expected, wanted = avoidance_step(now, wanted, rule.constants)
        assert tuple(map(float, command)) == pytest.approx(tuple(map(float, expected)), abs=1e-6)
        assert tuple(map(float, found)) == pytest.approx(tuple(map(float, wanted)), abs=1e-6)
        modes.add(int(rule.mode(AvoidanceState(*wanted))))
    assert len(modes) == 4


@pytest.mark.parametrize("certainty", ["beams", "log-odds"])
@pytest.mark.parametrize("kind", [torch.float32, torch.float64])
def test_the_map(kind: torch.dtype, certainty: str) -> None:
    module, (left, right) = RowRanging(RIG, DT, FeatureParams(7), MatchParams(10, 100)), pairs(kind)
    grid_map = GridMap(RIG, Grid(-1, 8, -3, 3), certainty=certainty)  # type: ignore[arg-type]
    with torch.no_grad():
        ranges, _ = module(left, right)
    assert ranges.valid.sum() > 3
    maps = []
    for mode in (torch.no_grad, torch.inference_mode):
        state = None
        with mode():
            for n in range(len(left)):
                pose = Pose(*torch.tensor([[0.1 * n], [0.2], [0.3 * n]], dtype=kind))
                state = grid_map.update(type(ranges)(*(part[n : n + 1] for part in ranges)), pose, state)
        assert state is not None
        maps.append(state.cells)
    # A place at the border of two cells may be rounded into either.
    moved = (maps[0] - maps[1]).abs().sum() / maps[0].abs().sum()
    assert moved < (1e-3 if kind == torch.float32 else 1e-9)
    torch.testing.assert_close(maps[1].sum(), maps[0].sum(), rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize(
    ("controller", "kind"),
    [
        ("ranging", torch.uint8),
        ("published", torch.uint8),
        pytest.param("published", torch.float64, marks=pytest.mark.long),
        pytest.param("ranging", torch.float64, marks=pytest.mark.long),
    ],
)
def test_a_drive(controller: str, kind: torch.dtype) -> None:
    """By torch, by kernels, and by both in turn: either goes on from the state of the other."""
    navigator, (left, right) = Navigator(RIG, DT, controller=controller), pairs(kind, 1, 40)
    frames = list(zip(left.split(1), right.split(1), strict=True))
    runs = []
    for modes in ([torch.no_grad], [torch.inference_mode], [torch.inference_mode, torch.no_grad, torch.inference_mode]):
        state, run = None, []
        for n, eyes in enumerate(frames):
            with modes[n % len(modes)]():
                command, state = navigator(*eyes, state)
            run += [float(command.speed), float(command.curvature), float(state.difference), float(state.pose.x)]
        runs.append(run)
    assert runs[1] == pytest.approx(runs[0], abs=1e-4)
    assert runs[2] == pytest.approx(runs[0], abs=1e-4)
    assert len({*runs[0][::4], *runs[0][1::4]}) > 1


def test_a_view_that_comes_to_rest() -> None:
    """A car that stands, and before which something moved, goes on after as many frames by torch and by kernels."""
    navigator, (left, right) = Navigator(RIG, DT, controller="ranging"), pairs(torch.uint8, 1, 40)
    numbers = [*range(40), *[39] * 25]
    runs = []
    for mode in (torch.no_grad, torch.inference_mode):
        state, run = None, []
        with mode():
            for k, n in enumerate(numbers):
                driven = Command(*torch.tensor([[0.5 if 3 < k < 30 else 0.0], [0.0]]))
                command, state = navigator(left[n : n + 1], right[n : n + 1], state, driven)
                run.append((float(command.speed), float(state.control.floor.noise)))
        runs.append(run)
    for wanted, found in zip(*runs, strict=True):
        assert found == pytest.approx(wanted, abs=1e-4)
    speeds, noises = zip(*runs[1], strict=True)
    begins = next(k for k in range(40, len(numbers)) if speeds[k] > 0)
    assert max(speeds[35:40]) == 0 < max(noises)
    assert noises[begins] < 0.2 * max(noises)


@pytest.mark.parametrize(
    ("controller", "params"), [("ranging", None), ("ranging", RangingParams(overhangs=False)), ("published", None)]
)
def test_a_step_has_all_parts_of_its_state(controller: str, params: object) -> None:
    """With what was driven, an error of the reckoning, strips, and a start that is not the origin."""
    navigator = Navigator(RIG, DT, controller=controller, params=params, features=FeatureParams(7))
    left, right = pairs(torch.uint8)
    navigator.reckoning = DeadReckoning(DT, scale_error=0.02, drift=0.01)
    fields = navigator.controller.fields
    start, driven = Pose(*torch.tensor([1.0, 2.0, 0.5])), Command(*torch.tensor([[0.4], [0.3]]))
    ends = []
    for mode in (torch.no_grad, torch.inference_mode):
        with mode():
            _, state = navigator(left[:1], right[:1], start=start)
            for n in range(1, 5):
                eyes = (cut_strips(eye[n : n + 1], f, RIG) for eye, f in zip((left, right), fields, strict=True))
                _, state = navigator(*eyes, state, driven)
        ends.append(state)
    flat = [[part for part in tree_flatten(tuple(end))[0] if part is not None] for end in ends]
    assert len(flat[0]) == len(flat[1]) > 15
    for wanted, found in zip(*flat, strict=True):
        assert wanted.shape == found.shape
        torch.testing.assert_close(found, wanted, rtol=1e-4, atol=1e-4)


def test_a_step_goes_on_from_a_state_that_was_copied_or_changed() -> None:
    navigator, (left, right) = Navigator(RIG, DT, controller="published"), pairs(torch.uint8, 1, 6)
    with torch.inference_mode():
        state = None
        for n in range(5):
            _, state = navigator(left[n : n + 1], right[n : n + 1], state)
        last = left[5:], right[5:]
        wanted, after = navigator(*last, state)
        for same in (copy.deepcopy(state), pickle.loads(pickle.dumps(state)), NavigatorState(*state)):
            found, other = navigator(*last, same)
            assert torch.equal(found.speed, wanted.speed)
            assert torch.equal(other.fields.low, after.fields.low)
            assert torch.equal(torch.stack(other.pose), torch.stack(after.pose))
        away = state._replace(pose=Pose(*torch.tensor([5.0, 6.0, 0.0])))
        _, other = navigator(*last, away)
        assert abs(float(other.pose.y) - 6) < 0.1
        assert float(navigator(*last, state)[1].pose.y) == float(after.pose.y)
