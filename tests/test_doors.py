"""What a public module refuses in one line: frames and signals that nothing can take, states of others, sizes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

import ndtorch
from ndtorch import binding, navigation, vision
from ndtorch.errors import InputError

SIZE = (16, 20)
DT = 1 / 30


OF_FRAMES: dict[str, tuple[Callable[[Any], Any], tuple[int, int]]] = {
    "HassensteinReichardt": (vision.HassensteinReichardt(), SIZE),
    "VisualFeatures": (vision.VisualFeatures(SIZE), SIZE),
    "OrientedDoG": (vision.OrientedDoG(SIZE), SIZE),
    "published": (ndtorch.load("published", size=SIZE), SIZE),
    "foreground": (ndtorch.load("foreground", size=(48, 48)), (48, 48)),
}
OF_SIGNALS: dict[str, tuple[Callable[[Any], Any], tuple[int, ...]]] = {
    "LowPass": (vision.LowPass(0.1, DT), (4, 1, 5, 6)),
    "NDMin": (vision.NDMin(), (2, 3, 4, 16)),
    "Resample": (vision.Resample(DT, 0.01), (4, 10)),
    "BindingInputs": (binding.BindingInputs(), (4, 10)),
    "InhibitoryNetwork": (binding.InhibitoryNetwork(), (4, 10)),
    "object_table": (binding.object_table, (10, 10)),
}
BAD: dict[str, tuple[Callable[[Tensor], Any], str]] = {
    "numpy": (lambda x: x.numpy(), r"convert it with torch\.from_numpy"),
    "list": (lambda x: x.tolist(), "must be a torch.Tensor, got list"),
    "whole numbers": (lambda x: x.long(), "must be"),
    "sparse": (lambda x: x.to_sparse(), "must be dense"),
    "NaN": (lambda x: x * float("nan"), "finite"),
}
BAD_FRAMES: dict[str, tuple[Callable[[Tensor], Any], str]] = {
    "channels last": (lambda x: x.permute(0, 2, 3, 1), r"permute\(0, 3, 1, 2\)"),
    "0..255": (lambda x: x * 255, "give uint8 or divide by 255"),
    "two channels": (lambda x: x[:, :2], "3 channels"),
    "one picture": (lambda x: x[0], r"\[.*T, C, H, W\]|C, H, W"),
}


@pytest.mark.parametrize("kind", BAD | BAD_FRAMES)
@pytest.mark.parametrize("name", OF_FRAMES)
def test_frames(name: str, kind: str) -> None:
    take, size = OF_FRAMES[name]
    change, words = (BAD | BAD_FRAMES)[kind]
    take(good := torch.full((1, 3, *size), 0.5))
    with pytest.raises(InputError, match=words):
        take(change(good))


@pytest.mark.parametrize("kind", BAD)
@pytest.mark.parametrize("name", OF_SIGNALS)
def test_signals(name: str, kind: str) -> None:
    take, shape = OF_SIGNALS[name]
    change, words = BAD[kind]
    good = torch.full(shape, 0.5)
    take(good.fill_diagonal_(0) / 10 if name == "object_table" else good)
    with pytest.raises(InputError, match=words):
        take(change(good))


def test_frames_of_another_size_name_both() -> None:
    with pytest.raises(InputError, match=r"must be 16x20 pixels .* got 20x16"):
        vision.VisualFeatures(SIZE)(torch.zeros(1, 3, 20, 16))


@pytest.mark.parametrize("name", ["HassensteinReichardt", "VisualFeatures", "published", "foreground"])
def test_a_state_of_another_module(name: str) -> None:
    take: Any = OF_FRAMES[name][0]
    frames = torch.full((1, 3, *OF_FRAMES[name][1]), 0.5)
    other = vision.ChahlSrinivasan()(torch.zeros(2, 1, 1, 8))[1]
    for state in (other, torch.zeros(3), tuple(take(frames)[1])):
        with pytest.raises(InputError, match=r"state must be a .*State or None"):
            take(frames, state)


@pytest.mark.parametrize(
    "make",
    [
        lambda: vision.VisualFeatures((100_000, 100_000)),
        lambda: vision.OrientedDoG((0, 10)),
        lambda: binding.InhibitoryNetwork(10**6),
        lambda: vision.RunningMax(1e9, DT),
        lambda: navigation.Grid(-1e9, 1e9, -1e9, 1e9),
        lambda: vision.LowPass(float("nan"), DT),
        lambda: ndtorch.load("published", fps=-1.0),
    ],
)
def test_sizes_that_allocate_and_numbers_without_meaning(make: Callable[[], Any]) -> None:
    with pytest.raises(InputError):
        make()


def test_numpy_that_was_converted_will_do() -> None:
    sums, _ = vision.VisualFeatures(SIZE)(torch.from_numpy(np.full((2, 3, *SIZE), 0.5, np.float32)))
    assert sums.shape == (2, 10)
