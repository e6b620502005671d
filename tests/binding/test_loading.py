"""Trained models by name and by folder, and the errors of broken folders."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file, save_file

import ndtorch
from ndtorch.binding import BindingConfig, VisualBinding, spectral_radius
from ndtorch.errors import InputError
from ndtorch.loading import model_folders
from ndtorch.vision import GROUPS


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A copy of the trained model to break."""
    return Path(shutil.copytree(model_folders()["binding"], tmp_path / "model"))


def test_the_trained_model_is_there_by_name() -> None:
    assert "binding" in ndtorch.model_names()
    model = ndtorch.load("binding", size=(16, 16))
    assert isinstance(model, VisualBinding)
    assert model.config == BindingConfig()


def test_the_trained_weights_are_usable() -> None:
    weights = ndtorch.load("binding", size=(16, 16)).first.initial
    assert weights is not None
    assert (weights >= 0).all()
    for group in GROUPS.values():
        assert 0.8 < float(spectral_radius(weights[group, group])) <= 0.9 + 1e-5


def test_options_take_the_place_of_the_folders(folder: Path) -> None:
    model = VisualBinding.load(folder, size=(20, 30), fps=30, border="reflect", exact=True, gamma=4, settle=1.0)
    assert model.features.size == (20, 30)
    assert (model.fps, model.features.motion.border, model.features.orientation.exact) == (30, "reflect", True)
    assert (model.config.gamma, model.config.settle, model.config.tau_in) == (4.0, 1.0, 1.0)


def test_the_folders_own_constants_are_used(folder: Path) -> None:
    (folder / "config.toml").write_text("gamma = 3.5")
    assert VisualBinding.load(str(folder), size=(16, 16)).config.gamma == 3.5


def test_an_unknown_name_is_refused() -> None:
    with pytest.raises(InputError, match=r"model must be one of .*binding.*; got 'blinding'"):
        ndtorch.load("blinding")


def test_a_missing_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="nowhere is not a model folder"):
        VisualBinding.load(tmp_path / "nowhere")


@pytest.mark.parametrize("name", ["config.toml", "weights.safetensors"])
def test_a_missing_file_is_refused_by_name(folder: Path, name: str) -> None:
    (folder / name).unlink()
    with pytest.raises(InputError, match=name):
        VisualBinding.load(folder)


def test_a_file_that_is_no_safetensors_is_refused(folder: Path) -> None:
    (folder / "weights.safetensors").write_text("0.3 0.45")
    with pytest.raises(InputError, match=r"weights\.safetensors is not a safetensors file"):
        VisualBinding.load(folder)


@pytest.mark.parametrize("name", list(GROUPS))
def test_missing_and_misshapen_weights_are_refused_by_name(folder: Path, name: str) -> None:
    path = folder / "weights.safetensors"
    tensors = load_file(path)
    n = len(tensors.pop(name))
    save_file(tensors, path)
    with pytest.raises(InputError, match=f"has no weights called '{name}'; it has "):
        VisualBinding.load(folder)
    save_file({**tensors, name: torch.zeros(2, 2)}, path)
    with pytest.raises(InputError, match=rf"{name} must be \[{n}, {n}\], got \(2, 2\)"):
        VisualBinding.load(folder)


def test_negative_weights_are_refused(folder: Path) -> None:
    path = folder / "weights.safetensors"
    save_file({**load_file(path), "motion": -torch.ones(4, 4)}, path)
    with pytest.raises(InputError, match="non-negative"):
        VisualBinding.load(folder)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"gama": 1.0}, r"options: unknown key 'gama'"),
        ({"gamma": -1.0}, r"options: gamma = -1\.0"),
        ({"radius_limit": 2.0}, r"options: radius_limit = 2\.0"),
        ({"rule": "oja"}, "rule must be one of competitive"),
        ({"border": "black"}, "border must be one of"),
        ({"size": (0, 10)}, "size must be"),
        ({"fps": -1}, "fps must be"),
    ],
)
def test_options_that_do_not_fit_are_refused_by_name(folder: Path, options: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        VisualBinding.load(folder, **options)
