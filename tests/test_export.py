"""Exported models give the same numbers without this package."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import torch

import ndtorch
from ndtorch.errors import InputError
from ndtorch.export import EXPORTED, export
from ndtorch.tree import leaves

SIZE, FRAMES = (24, 24), 5


def largest_difference(model: Any, first: Any, following: Any) -> float:
    """Between a model and its programs, over four chunks: of signals and of the state."""
    film = torch.rand(4 * FRAMES, 3, *SIZE, generator=torch.Generator().manual_seed(0))
    state, kept, apart = None, (), 0.0
    with torch.no_grad():
        for part in film.split(FRAMES):
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
        options = {"settle": 0.0, "tau_onset": 0.0, **options}
    return ndtorch.load(name, size=SIZE, **({"along": 4} if name == "retinotopic" else {}), **options)


@pytest.mark.slow
@pytest.mark.parametrize("name", EXPORTED)
def test_an_exported_program_gives_the_same(name: str, tmp_path: Path) -> None:
    module = model(name)
    files = export(module, tmp_path, "pt2", FRAMES)
    assert [path.name for path in files] == ["first.pt2", "next.pt2"]
    first, following = (torch.export.load(path).module() for path in files)
    assert largest_difference(module, first, following) < 1e-4


def test_what_cannot_be_exported_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"video cannot be exported: .*; published, scale-free, retinotopic can"):
        export(ndtorch.load("video", size=SIZE), tmp_path)
    with pytest.raises(InputError, match=r"published makes 16\.\d* rows of 5 frames at 30 frames a second"):
        export(model("published", fps=30.0), tmp_path, frames=5)
    with pytest.raises(InputError, match="format must be one of pt2, aoti, onnx, got 'tflite'"):
        export(model("published"), tmp_path, "tflite")  # type: ignore[arg-type]
