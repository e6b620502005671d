"""What every model refuses at its edge, in one line."""

from __future__ import annotations

import pytest
import torch

import ndtorch
from ndtorch.errors import InputError

NAMES = ("published", "scale-free", "retinotopic", "video")


@pytest.mark.parametrize("name", NAMES)
def test_floats_of_0_to_255_are_refused(name: str) -> None:
    model = ndtorch.load(name, size=32)
    frames = 255 * torch.rand(4, 3, 32, 32, generator=torch.Generator().manual_seed(0))
    with pytest.raises(InputError, match=r"frames of floats must lie in 0\.\.1, got .*divide by 255"):
        model(frames)
    model(frames.to(torch.uint8))


@pytest.mark.parametrize("name", NAMES)
def test_half_precision_is_refused_for_models_and_taken_for_frames(name: str) -> None:
    model = ndtorch.load(name, size=32)
    to_half, to_bfloat = (lambda: model.to(torch.float16)), (lambda: model.to(dtype=torch.bfloat16))
    for convert in (model.half, model.bfloat16, to_half, to_bfloat):
        with pytest.raises(InputError, match="computes in single or double precision"):
            convert()
    frames = torch.rand(4, 3, 32, 32, generator=torch.Generator().manual_seed(0)).half()
    (given, _), (wanted, _) = model(frames), model(frames.float())
    assert torch.allclose(given.outputs, wanted.outputs, atol=1e-6)


def test_a_number_is_a_square() -> None:
    assert ndtorch.load("video", size=48).size == (48, 48)
    with pytest.raises(InputError, match="size"):
        ndtorch.load("published", size=(1, 2, 3))
