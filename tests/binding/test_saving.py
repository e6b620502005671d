"""States of every model to files and back, bit for bit, and what is refused."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors.torch import load_file

import ndtorch
from ndtorch.binding import BindingModel, load_state, save_state, to_device
from ndtorch.binding.saving import read_about
from ndtorch.errors import InputError
from ndtorch.utils.files import save_tensors
from ndtorch.utils.tensors import leaves

NAMES = ("published", "scale-free", "retinotopic")


def noise(*shape: int) -> torch.Tensor:
    return torch.rand(*shape, generator=torch.Generator().manual_seed(0))


def model(name: str = "published", **options: Any) -> Any:
    return ndtorch.load(name, size=(32, 33), **options)


def same(a: Any, b: Any) -> bool:
    one, other = leaves(a), leaves(b)
    return list(one) == list(other) and all(
        torch.equal(one[name], other[name]) and one[name].dtype == other[name].dtype for name in one
    )


@pytest.mark.parametrize("batch", [(), (2,), (2, 3)])
@pytest.mark.parametrize("fps", [30.0, 100.0])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_a_state_comes_back_bit_for_bit(tmp_path: Path, batch: tuple[int, ...], fps: float, dtype: torch.dtype) -> None:
    module = model(fps=fps).to(dtype)
    _, state = module(noise(*batch, 6, 3, 32, 33).to(dtype))
    save_state(state, tmp_path / "state.safetensors", {"scene": "noise", "fps": str(fps)})
    loaded, about = load_state(tmp_path / "state.safetensors", module)
    assert same(loaded, state)
    assert loaded.second.weights.dtype == dtype
    assert about == {"scene": "noise", "fps": str(fps)} == read_about(tmp_path / "state.safetensors")


@pytest.mark.parametrize("name", NAMES)
def test_a_file_without_one_part_is_refused(tmp_path: Path, name: str) -> None:
    module, path = model(name), tmp_path / "state"
    _, state = module(noise(4, 3, 32, 33))
    for part in leaves(state):
        save_state(state, path)
        tensors = load_file(path)
        del tensors[part]
        save_tensors(tensors, path)
        with pytest.raises(InputError, match=f"{part} missing"):
            load_state(path, module)


def broken(tmp_path: Path, part: str, value: torch.Tensor, module: BindingModel) -> Path:
    """A saved state one part of which is another."""
    _, state = module(noise(4, 3, 32, 33))
    save_state(state, tmp_path / "state")
    save_tensors({**load_file(tmp_path / "state"), part: value}, tmp_path / "state")
    return tmp_path / "state"


@pytest.mark.parametrize(
    ("part", "value", "message"),
    [
        ("second.weights", torch.full((10, 10), math.nan), "second.weights must be finite, got NaN or infinite"),
        ("second.weights", torch.zeros(9, 10), r"second.weights must be \[..., 10, 10\], got \[9, 10\]"),
        ("second.weights", torch.zeros(10, 10, dtype=torch.int32), "second.weights must be torch.float32"),
        ("second.stopped", torch.zeros(()), "second.stopped must be torch.bool"),
        ("second.weights", torch.zeros(3, 10, 10), None),
        ("third.weights", torch.zeros(10, 10), "third.weights does not belong to it"),
    ],
)
def test_parts_that_do_not_fit_are_refused(tmp_path: Path, part: str, value: torch.Tensor, message: str | None) -> None:
    path = broken(tmp_path, part, value, model())
    if message is None:
        assert load_state(path, model())[0].second.weights.shape == (3, 10, 10)
        return
    with pytest.raises(InputError, match=message) as caught:
        load_state(path, model())
    assert "\n" not in str(caught.value)


def test_moving_to_another_device_leaves_the_counters() -> None:
    _, state = model()(noise(4, 3, 32, 33))
    moved = to_device(state, "meta")
    assert moved.second.weights.device.type == "meta"
    assert moved.second.stopped.device.type == "meta"
    assert moved.second.steps.device.type == moved.resample.taken.device.type == "cpu"
    assert int(moved.second.steps) == 4
    assert isinstance(state, type(moved))
