"""Properties of every public module, for inputs drawn by chance."""

from __future__ import annotations

import inspect
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest import mock

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor, nn

from ndtorch import binding, navigation, vision
from ndtorch.binding.models.foreground import ForegroundConfig
from ndtorch.binding.models.retinotopic import RetinotopicConfig
from ndtorch.binding.models.whole_field import PublishedConfig, ScaleFreeConfig
from tests.properties import DT, KINDS, LONG, PUBLIC, QUICK, RIG, SIZE, Part, check, samples
from tests.strategies import chunkings

Draw = Callable[..., Tensor]


def pictures(draw: Draw) -> tuple[Tensor, ...]:
    return (draw(3, *SIZE),)


def rows(draw: Draw) -> tuple[Tensor, ...]:
    return (draw(1, 1, 24),)


def signals(draw: Draw) -> tuple[Tensor, ...]:
    return (draw(10),)


def eyes(draw: Draw) -> tuple[Tensor, ...]:
    return draw(1, RIG.height, RIG.width), draw(1, RIG.height, RIG.width)


def pose_of(draw: Draw) -> navigation.Pose:
    return navigation.Pose(draw(), draw(), 6.0 * draw())


def seen(draw: Draw) -> tuple[Any, ...]:
    left, angle = 0.2 + 2 * draw(4), draw(4) - 0.5
    right, x = angle - 0.1, left * torch.cos(angle)
    return navigation.Ranges(left, angle, right, x, left * torch.sin(angle), draw(4) > 0.3), pose_of(draw)


def attended(draw: Draw) -> tuple[Tensor, ...]:
    return draw(3, *SIZE), draw(10, *SIZE), draw(10), draw(10)


def table(trials: int) -> dict[str, Any]:
    return {"table": binding.object_table(torch.full((10, 10), 0.5, dtype=torch.float64).fill_diagonal_(0.0))}


def steered(name: str) -> Part:
    """A controller, as a navigator asks it, with a map, a list and a tracker where there are."""
    return Part(lambda: navigation.Navigator(RIG, DT, controller=name), eyes, limit=1e-6, double=False)


PARTS: dict[str, Part] = {
    "LowPass": Part(lambda: vision.LowPass(0.1, DT), pictures),
    "HighPass": Part(lambda: vision.HighPass(0.1, DT), pictures),
    "RunningMax": Part(lambda: vision.RunningMax(0.1, DT), signals),
    "NDMin": Part(lambda: vision.NDMin(), rows),
    "NDMinus": Part(lambda: vision.NDMinus(), rows),
    "NDS": Part(lambda: vision.NDS(tau_low=0.1), rows),
    "ChahlSrinivasan": Part(lambda: vision.ChahlSrinivasan(), rows),
    "DirectionalND": Part(lambda: vision.DirectionalND(every=2), rows),
    "BarlowLevick": Part(lambda: vision.BarlowLevick(), pictures),
    "SmallTargetDetector": Part(lambda: vision.SmallTargetDetector(), pictures),
    "LoomingDetector": Part(lambda: vision.LoomingDetector(SIZE), pictures),
    "Resample": Part(lambda: vision.Resample(DT, 0.01), signals),
    "HassensteinReichardt": Part(lambda: vision.HassensteinReichardt(), pictures),
    "OrientedDoG": Part(lambda: vision.OrientedDoG(SIZE), pictures, state=False),
    "VisualFeatures": Part(lambda: vision.VisualFeatures(SIZE), pictures),
    "LocalFeatures": Part(lambda: vision.LocalFeatures(vision.VisualFeatures(SIZE), 4), pictures),
    "ForegroundModel": Part(
        lambda: binding.ForegroundModel(ForegroundConfig(size=(40, 48), fps=30.0)),
        lambda draw: (draw(3, 40, 48),),
        batched=False,
        double=False,
    ),
    "BindingInputs": Part(lambda: binding.BindingInputs(), signals),
    "InhibitoryNetwork": Part(lambda: binding.InhibitoryNetwork(settle=0.02), signals),
    "ObjectFiles": Part(lambda: binding.ObjectFiles((4, 4), 4.0), lambda draw: (draw(4, 4, 10),)),
    "Attention": Part(lambda: binding.Attention(DT), attended, fixed=table),
    "PublishedModel": Part(
        lambda: binding.PublishedModel(PublishedConfig(size=SIZE, fps=100.0)), pictures, times=frozenset({"time"})
    ),
    "ScaleFreeModel": Part(
        lambda: binding.ScaleFreeModel(ScaleFreeConfig(size=SIZE, fps=100.0)), pictures, times=frozenset({"time"})
    ),
    "RetinotopicModel": Part(
        lambda: binding.RetinotopicModel(RetinotopicConfig(size=(24, 24), fps=100.0)),
        lambda draw: (draw(3, 24, 24),),
        times=frozenset({"time"}),
    ),
    "AlphaBetaTracker": Part(lambda: navigation.AlphaBetaTracker(DT), seen, final=True),
    "DeadReckoning": Part(lambda: navigation.DeadReckoning(DT), lambda draw: (draw() - 0.3, draw() - 0.5)),
    "GridMap": Part(lambda: navigation.GridMap(RIG, navigation.Grid(cell=0.5)), seen, final=True),
    "ObservationList": Part(lambda: navigation.ObservationList(DT, capacity=12), seen, final=True),
    "StereoRanging": Part(lambda: navigation.StereoRanging(RIG, DT), eyes),
    "Navigator": steered("ranging"),
    "Controller": steered("published"),
}
"""Every public module. `Controller` is abstract: the published one stands for it; all are tried in the long form."""


def test_no_public_module_is_left_out() -> None:
    """A model is tested as each of its kinds; a sequence and the saccades have tests beside those of their packages."""
    public = [getattr(package, name) for package in PUBLIC for name in package.__all__]
    modules = {thing.__name__ for thing in public if inspect.isclass(thing) and issubclass(thing, nn.Module)}
    assert modules - set(PARTS) == {"BindingModel", "Sequential"}


@st.composite
def runs(draw: st.DrawFn) -> tuple[str, int, int, int, list[int]]:
    """Kind of pictures, seed, trials, time steps, and where they are cut."""
    steps = draw(st.integers(2, 7))
    lengths = draw(chunkings(steps))
    cuts = [sum(lengths[:n]) for n in range(1, len(lengths))] or [1]
    return draw(st.sampled_from(KINDS)), draw(st.integers(0, 2**31)), draw(st.integers(1, 3)), steps, cuts


def try_part(part: Part, run: tuple[str, int, int, int, list[int]]) -> None:
    kind, seed, trials, steps, cuts = run
    chance = torch.Generator().manual_seed(seed)
    streams = part.given(lambda *shape: samples((trials, steps, *shape), kind, chance))
    large = mock.patch("ndtorch.vision.frames.LARGE", 2000 if seed % 2 else 1 << 18)
    with torch.no_grad(), large, tempfile.TemporaryDirectory() as folder:
        check(part, streams, cuts, Path(folder) / "state.safetensors")


@pytest.mark.parametrize("name", PARTS)
@QUICK
@given(run=runs())
def test_chunks_batches_and_resuming_change_nothing(name: str, run: Any) -> None:
    try_part(PARTS[name], run)


@pytest.mark.long
@pytest.mark.parametrize("name", [*PARTS, *(f"Navigator {name}" for name in navigation.controller_names())])
@LONG
@given(run=runs())
def test_the_same_for_many_inputs(name: str, run: Any) -> None:
    try_part(PARTS.get(name) or steered(name.split()[1]), run)
