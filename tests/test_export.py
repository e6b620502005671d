"""Exported models give the same numbers without this package."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

import ndtorch
from ndtorch.errors import InputError
from ndtorch.export import export, packed
from ndtorch.utils.tensors import leaves

SIZE, FRAMES = (24, 24), 3


def noise() -> Tensor:
    """Four chunks of it."""
    return torch.rand(4 * FRAMES, 3, *SIZE, generator=torch.Generator().manual_seed(0))


def largest_difference(model: Any, first: Any, following: Any, film: Tensor, frames: int = FRAMES) -> float:
    """Between a model and its programs, over chunks of a film: of signals and of the state."""
    kept: tuple[Tensor, ...] = ()
    state, apart = None, 0.0
    with torch.no_grad():
        for part in film.split(frames):
            signals, after = model(part, state)
            out = first(part) if state is None else following(part, *kept)
            wanted = [*signals, *leaves(after).values()]
            assert len(out) == len(wanted)
            pairs = zip(out, wanted, strict=True)
            apart = max(apart, *(float((a.double() - b.double()).abs().max()) for a, b in pairs if a.numel()))
            state, kept = after, out[len(signals) :]
    return apart


def model(name: str, **options: Any) -> Any:
    if name in ("published", "scale-free"):
        # Learning, within the few frames looked at.
        options = {"settle": 0.0, **({"tau_onset": 0.0} if name == "published" else {}), **options}
    return ndtorch.load(name, size=SIZE, **({"along": 4} if name == "retinotopic" else {}), **options)


# `scale-free` has the signals of `published` and another rule, which tests/binding/test_feedback.py exports.
PROGRAMS = ["published", *(pytest.param(name, marks=pytest.mark.long) for name in ("retinotopic", "scale-free"))]


@pytest.mark.slow
@pytest.mark.parametrize("name", PROGRAMS)
def test_an_exported_program_gives_the_same(name: str, tmp_path: Path) -> None:
    # Motion of the second frame is zero but for rounding, and is divided by its own largest: one backend alone.
    module = model(name, backend="torch")
    files = export(module, tmp_path, "pt2", FRAMES)
    assert [path.name for path in files] == ["first.pt2", "next.pt2"]
    first, following = (torch.export.load(path).module() for path in files)
    assert largest_difference(module, first, following, noise()) < 1e-4


def test_what_cannot_be_exported_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"published makes 16\.\d* rows of 5 frames at 30 frames a second"):
        export(model("published", fps=30.0), tmp_path, frames=5)
    with pytest.raises(InputError, match="foreground cannot be exported"):
        export(ndtorch.load("foreground", size=SIZE), tmp_path)
    with pytest.raises(InputError, match="format must be one of pt2, aoti, onnx, got 'tflite'"):
        export(model("published"), tmp_path, "tflite")  # type: ignore[arg-type]


def test_an_onnx_program() -> None:
    onnx = pytest.importorskip("onnx")
    pytest.importorskip("onnxscript")
    program = torch.export.export(Summed(), (torch.rand(3, 5), torch.rand(5)))
    written = onnx.load_from_string(packed(program, "onnx"))
    onnx.checker.check_model(written)
    assert [part.name for part in written.graph.input] == ["x", "total"]


class Summed(torch.nn.Module):
    """A program with a state, and small."""

    def forward(self, x: Tensor, total: Tensor) -> tuple[Tensor, Tensor]:
        after = total + x.sum(0)
        return after.sqrt(), after


@pytest.mark.long
@pytest.mark.skipif(shutil.which("g++") is None, reason="AOTInductor needs a C++ compiler")
def test_a_compiled_package_is_written_and_runs(tmp_path: Path) -> None:
    x, total = torch.rand(3, 5), torch.rand(5)
    (tmp_path / "next.pt2").write_bytes(packed(torch.export.export(Summed(), (x, total)), "aoti"))
    following = torch._inductor.aoti_load_package(str(tmp_path / "next.pt2"))
    for _ in range(2):
        root, after = following(x, total)
        torch.testing.assert_close(after, total + x.sum(0))
        torch.testing.assert_close(root, after.sqrt())
        total = after


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
