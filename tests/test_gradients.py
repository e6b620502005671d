"""Gradients with respect to frames: numbers everywhere, and those of finite differences."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from torch import Tensor

import ndtorch
from ndtorch.errors import InputError


def film(frames: int, size: tuple[int, int]) -> Tensor:
    """A red patch that comes in and goes to the right, `[T, 3, H, W]` double."""
    still = 0.3 + 0.2 * torch.rand(3, *size, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    video = still.repeat(frames, 1, 1, 1)
    for n in range(1, frames):
        video[n, 0, 4:10, 2 * n : 2 * n + 6] = 0.8
    return video.requires_grad_()


def retinotopic() -> Any:
    return ndtorch.load("retinotopic", size=(24, 24), along=4).double()


def test_frames_of_the_retinotopic_model_have_gradients() -> None:
    model, frames = retinotopic(), film(12, (24, 24))
    signals, state = model(frames)
    windows = state.windows
    parts = (signals.fields, signals.outputs, windows.place, windows.velocity, windows.covariance, windows.peak)
    for part in (*parts, model.weights(state)):
        (slope,) = torch.autograd.grad(part.square().sum(), frames, retain_graph=True)
        assert torch.isfinite(slope).all()


def test_gradients_of_the_retinotopic_model_are_right() -> None:
    model = ndtorch.load("retinotopic", size=(24, 24), along=3).double()
    # Some motion everywhere: at zero a root has no slope that finite differences could find.
    fields = 0.5 + torch.rand(7, 3, 3, 10, dtype=torch.float64, generator=torch.Generator().manual_seed(0))

    def followed(x: Tensor) -> tuple[Tensor, ...]:
        windows = model.from_fields(x)[1].windows
        return windows.place, windows.velocity, windows.peak, windows.mean

    assert torch.autograd.gradcheck(followed, (fields.requires_grad_(),), eps=1e-6, atol=1e-4, fast_mode=True)


def flat(kind: str, frames: int, size: tuple[int, int]) -> Tensor:
    """A film in which roots and quotients of zero come about."""
    video = film(frames, size).detach()
    if kind == "saturated":
        return (3 * video).clamp(0, 1).requires_grad_()
    level = {"black": 0.0, "uniform": 0.5, "white": 1.0}[kind]
    return torch.full_like(video, level).requires_grad_()


@pytest.mark.parametrize("kind", ["black", "uniform", "white", "saturated"])
@pytest.mark.parametrize("name", ["published", "scale-free", "retinotopic"])
def test_gradients_are_numbers_where_there_is_nothing_to_see(name: str, kind: str) -> None:
    options: dict[str, Any] = {"along": 4} if name == "retinotopic" else {}
    model: Any = ndtorch.load(name, size=(32, 40), **options).double()
    frames = flat(kind, 6, (32, 40))
    signals, state = model(frames)
    parts = [part for part in (*signals, model.weights(state)) if part.requires_grad]
    slopes = [torch.autograd.grad(p.square().sum(), frames, retain_graph=True, allow_unused=True)[0] for p in parts]
    assert all(slope is None or torch.isfinite(slope).all() for slope in slopes)
    assert len(slopes) > 1


@pytest.mark.parametrize("name", ["published", "scale-free"])
def test_gradients_of_whole_field_models_are_right(name: str) -> None:
    model: Any = ndtorch.load(name, size=(12, 14)).double()
    frames = torch.rand(7, 3, 12, 14, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    # Motion of the second frame is zero but for rounding, and is divided by its own largest.
    _, state = model(frames[:4])

    def outputs(x: Tensor) -> Tensor:
        out: Tensor = model(x, state)[0].outputs
        return out

    assert torch.autograd.gradcheck(outputs, (frames[4:].requires_grad_(),), eps=1e-6, atol=1e-4, fast_mode=True)


def test_figures_says_that_it_has_no_gradients() -> None:
    model = ndtorch.load("foreground", size=(32, 40), fps=25.0)
    with pytest.raises(InputError, match="no gradients"):
        model(film(3, (32, 40)).float())
    with torch.no_grad():
        model(film(3, (32, 40)).float())
