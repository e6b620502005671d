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
from ndtorch.export import export, write
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
            signals, after = model.signals(part, state)
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
        options = {"settle": 0.0, "tau_onset": 0.0, **options}
    return ndtorch.load(name, size=SIZE, **({"along": 4} if name == "retinotopic" else {}), **options)


# `scale-free` has the signals of `published` and another rule, which tests/binding/test_feedback.py exports.
PROGRAMS = ["published", *(pytest.param(name, marks=pytest.mark.long) for name in ("retinotopic", "scale-free"))]


def test_every_model_is_exported_here_or_refused() -> None:
    others = {"published", "retinotopic", "scale-free", "foreground"}
    assert set(ndtorch.model_names()) == others


@pytest.mark.slow
@pytest.mark.parametrize("name", PROGRAMS)
def test_an_exported_program_gives_the_same(name: str, tmp_path: Path) -> None:
    module = model(name)
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


def test_an_onnx_program_is_one_file(tmp_path: Path) -> None:
    onnx = pytest.importorskip("onnx")
    pytest.importorskip("onnxscript")
    program = torch.export.export(Summed(), (torch.rand(3, 5), torch.rand(5)))
    write({tmp_path / "next.onnx": program}, "onnx")
    assert [path.name for path in tmp_path.iterdir()] == ["next.onnx"]
    written = onnx.load(tmp_path / "next.onnx")
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
    write({tmp_path / "next.pt2": torch.export.export(Summed(), (x, total))}, "aoti")
    following = torch._inductor.aoti_load_package(str(tmp_path / "next.pt2"))
    for _ in range(2):
        root, after = following(x, total)
        torch.testing.assert_close(after, total + x.sum(0))
        torch.testing.assert_close(root, after.sqrt())
        total = after
