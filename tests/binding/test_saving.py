"""States to files and back, bit for bit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors.torch import load_file, save_file

from ndtorch.binding import BindingState, VisualBinding, load_state, save_state, to_device
from ndtorch.binding.saving import flatten_state
from ndtorch.errors import InputError


def noise(*shape: int) -> torch.Tensor:
    return torch.rand(*shape, generator=torch.Generator().manual_seed(0))


def model(**options: Any) -> VisualBinding:
    return VisualBinding(torch.zeros(10, 10), size=(8, 9), **options)


def same(a: BindingState, b: BindingState) -> bool:
    one, other = flatten_state(a), flatten_state(b)
    return list(one) == list(other) and all(
        torch.equal(one[name], other[name]) and one[name].dtype == other[name].dtype for name in one
    )


@pytest.mark.parametrize("batch", [(), (2,), (2, 3)])
@pytest.mark.parametrize("fps", [30.0, 100.0])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_a_state_comes_back_bit_for_bit(tmp_path: Path, batch: tuple[int, ...], fps: float, dtype: torch.dtype) -> None:
    _, state = model(fps=fps)(noise(*batch, 6, 3, 8, 9).to(dtype))
    save_state(state, tmp_path / "state.safetensors", {"scene": "noise", "fps": str(fps)})
    loaded, about = load_state(tmp_path / "state.safetensors")
    assert same(loaded, state)
    assert loaded.second.weights.dtype == dtype
    assert about == {"scene": "noise", "fps": str(fps)}


def test_a_state_without_motion_comes_back_without(tmp_path: Path) -> None:
    _, state = model().from_sums(noise(6, 10))
    save_state(state, str(tmp_path / "state"))
    loaded, about = load_state(str(tmp_path / "state"))
    assert loaded.motion is None
    assert same(loaded, state)
    assert about == {}


def test_a_run_resumed_from_a_file_is_the_run(tmp_path: Path) -> None:
    module, frames = model(fps=30.0), noise(20, 3, 8, 9)
    _, state = module(frames[:11])
    save_state(state, tmp_path / "state")
    loaded, _ = load_state(tmp_path / "state")
    whole, end = module(frames[11:], state)
    resumed, resumed_end = module(frames[11:], loaded)
    assert all(torch.equal(a, b) for a, b in zip(resumed, whole, strict=True))
    assert same(resumed_end, end)


def names() -> list[str]:
    _, state = model()(noise(2, 3, 8, 9))
    return list(flatten_state(state))


@pytest.mark.parametrize("name", names())
def test_a_file_without_one_part_is_refused(tmp_path: Path, name: str) -> None:
    path = tmp_path / "state"
    _, state = model()(noise(2, 3, 8, 9))
    save_state(state, path)
    tensors = load_file(path)
    del tensors[name]
    save_file(tensors, path)
    with pytest.raises(InputError, match=f"not a saved state of this model: {name} missing"):
        load_state(path)


def test_names_of_the_parts_are_dotted() -> None:
    assert {"motion.slow", "resample.given", "inputs.low", "first.weights", "second.stopped"} <= set(names())


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nothing\.safetensors is missing"):
        load_state(tmp_path / "nothing.safetensors")


def test_other_files_and_folders_are_refused(tmp_path: Path) -> None:
    (tmp_path / "text").write_text("not a state at all")
    (tmp_path / "empty").write_bytes(b"")
    for path in (tmp_path / "text", tmp_path / "empty", tmp_path):
        with pytest.raises(InputError, match="is not a saved state"):
            load_state(path)


def test_saving_does_not_change_the_state(tmp_path: Path) -> None:
    _, state = model()(noise(4, 3, 8, 9))
    before = {name: part.clone() for name, part in flatten_state(state).items()}
    save_state(state, tmp_path / "state")
    assert all(torch.equal(part, before[name]) for name, part in flatten_state(state).items())


def test_moving_to_another_device_leaves_the_counters() -> None:
    _, state = model()(noise(4, 3, 8, 9))
    moved = to_device(state, "meta")
    assert moved.second.weights.device.type == "meta"
    assert moved.second.stopped.device.type == "meta"
    assert moved.second.steps.device.type == moved.resample.taken.device.type == "cpu"
    assert int(moved.second.steps) == 4
    assert isinstance(moved, BindingState)


def test_moving_a_state_without_motion() -> None:
    _, state = model().from_sums(noise(4, 10))
    assert to_device(state, "cpu").motion is None
    assert same(to_device(state, "cpu"), state)
