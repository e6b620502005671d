"""Models by name and by folder, of one's own too, and the errors of broken folders."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file

import ndtorch
from ndtorch.binding import FirstStage, PublishedModel, spectral_radius
from ndtorch.errors import InputError
from ndtorch.loading import model_folders, model_kind
from ndtorch.utils.files import save_tensors
from ndtorch.utils.tensors import leaves
from ndtorch.vision import GROUPS

NAMES = ("published", "scale-free", "retinotopic", "foreground")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A copy of the trained model to break."""
    return Path(shutil.copytree(model_folders()["published"], tmp_path / "model"))


def test_the_models_are_there_by_name() -> None:
    assert set(ndtorch.model_names()) == set(NAMES)
    for name in NAMES:
        model = ndtorch.load(name, size=48)
        assert (model.name, model_kind(name), model.size) == (name, name, (48, 48))


def test_the_trained_weights_are_usable_and_shared() -> None:
    weights = ndtorch.load("published", size=(16, 16)).first_stage()
    assert weights is not None
    assert (weights >= 0).all()
    for group in GROUPS.values():
        assert 0.8 < float(spectral_radius(weights[group, group])) <= 0.9 + 1e-5
    for name in ("scale-free", "retinotopic"):
        assert torch.equal(ndtorch.load(name, size=(16, 16)).first_stage(), weights)


def test_options_take_the_place_of_the_folders(folder: Path) -> None:
    model = ndtorch.load(folder, size=(20, 30), fps=30, border="reflect", exact=True, gamma=4, settle=1.0)
    assert isinstance(model, PublishedModel)
    assert model.features.size == (20, 30)
    assert (model.fps, model.features.motion.border, model.features.orientation.exact) == (30, "reflect", True)
    assert (model.config.network.gamma, model.settle, model.config.network.tau_in) == (4.0, 1.0, 1.0)
    assert ndtorch.load(folder, size=(20, 30), **{"network.gamma": 2.0}).config.network.gamma == 2.0


@pytest.mark.parametrize("name", NAMES)
def test_what_is_saved_loads_back_equal(tmp_path: Path, name: str) -> None:
    options = {"gamma": 0.7} if name != "retinotopic" else {"most": 3}
    model = ndtorch.load(name, size=(32, 48), fps=25.0, **options)
    model.save(tmp_path / "mine")
    again = ndtorch.load(tmp_path / "mine")
    assert type(again) is type(model)
    assert again.config == model.config
    ours, theirs = model.state_dict(), again.state_dict()
    assert ours.keys() == theirs.keys()
    assert all(torch.equal(ours[key], theirs[key]) for key in ours)
    frames = torch.rand(20, 3, 32, 48, generator=torch.Generator().manual_seed(0))
    (one, end), (other, other_end) = model(frames), again(frames)
    assert all(torch.equal(a, b) for a, b in zip(one, other, strict=True))
    assert all(torch.equal(a, b) for a, b in zip(leaves(end).values(), leaves(other_end).values(), strict=True))
    assert {path.name for path in (tmp_path / "mine").iterdir()} == {"config.toml", "README.md"} | (
        set() if name == "foreground" else {"weights.safetensors"}
    )


def test_a_model_that_is_there_is_replaced_only_when_told(tmp_path: Path) -> None:
    ndtorch.load("published", size=(32, 48)).save(tmp_path)
    (tmp_path / "README.md").write_text("mine")
    other = ndtorch.load("foreground", size=(32, 48))
    with pytest.raises(InputError, match=r"holds a model; say overwrite=True to replace it"):
        other.save(tmp_path)
    assert ndtorch.load(tmp_path).name == "published"
    other.save(tmp_path, overwrite=True)
    assert ndtorch.load(tmp_path).name == "foreground"
    assert not (tmp_path / "weights.safetensors").exists()
    assert (tmp_path / "README.md").read_text() == "mine"


def test_a_trained_first_stage_takes_the_place_of_the_folders() -> None:
    parts = [torch.full((n, n), 0.2).fill_diagonal_(0) for n in (4, 3, 3)]
    stage = FirstStage(*parts, seconds=1.0)
    for name in ("published", "scale-free", "retinotopic"):
        weights = ndtorch.load(name, size=(16, 16), first_stage=stage).first_stage()
        assert weights is not None
        assert torch.equal(weights[GROUPS["color"], GROUPS["color"]], parts[2])
    with pytest.raises(InputError, match="foreground has no option first_stage; published, scale-free"):
        ndtorch.load("foreground", first_stage=stage)


def test_an_unknown_name_is_refused() -> None:
    with pytest.raises(InputError, match=r"model must be .*published.*; got 'publish'; did you mean published\?"):
        ndtorch.load("publish")
    with pytest.raises(InputError, match=r"^the model binding is called published now$"):
        ndtorch.load("binding")


@pytest.mark.parametrize("name", list(GROUPS))
def test_missing_and_misshapen_weights_are_refused_by_name(folder: Path, name: str) -> None:
    path = folder / "weights.safetensors"
    tensors = load_file(path)
    n = len(tensors.pop(name))
    save_tensors(tensors, path)
    with pytest.raises(InputError, match=f"has no weights called '{name}'; it has "):
        ndtorch.load(folder)
    save_tensors({**tensors, name: torch.zeros(2, 2)}, path)
    with pytest.raises(InputError, match=rf"{name} must be \[{n}, {n}\], got \(2, 2\)"):
        ndtorch.load(folder)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"gama": 1.0}, r"options: unknown key 'gama'; did you mean gamma\?"),
        ({"fused": True}, "options: fused is gone: the sums are always compiled"),
        ({"radius_limit": 2.0}, r"options: network: radius_limit = 2\.0"),
        ({"rule": "oja"}, "rule must be one of competitive"),
        ({"tau_background": 3.0}, "published has no option tau_background; foreground has it"),
    ],
)
def test_options_that_do_not_fit_are_refused_by_name(folder: Path, options: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        ndtorch.load(folder, **options)


def test_the_model_video_is_gone(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"^the model video is gone; foreground does its job$"):
        ndtorch.load("video", size=48)
    (tmp_path / "config.toml").write_text('model = "video"')
    with pytest.raises(InputError, match=r"config\.toml: the model video is gone; foreground does its job$"):
        ndtorch.load(tmp_path)
    with pytest.raises(ImportError, match="VideoModel is gone"):
        from ndtorch.binding import VideoModel  # type: ignore[attr-defined]  # noqa: F401


def test_the_model_figures_is_foreground(tmp_path: Path) -> None:
    assert ndtorch.load("figures", size=48).name == model_kind("figures") == "foreground"
    (tmp_path / "config.toml").write_text('model = "figures"\n[tracking]\nmax_lost_s = 2.0')
    assert ndtorch.load(tmp_path).config.tracking.max_lost_s == 2.0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"coast": 2.0}, r"^options: coast is called tracking\.max_lost_s now$"),
        ({"tracking.coast": 2.0}, r"^options: tracking\.coast is called tracking\.max_lost_s now$"),
        ({"tracking.swing": 0.3}, r"^options: tracking\.swing is gone: it is a constant in the code now$"),
        ({"fastest": 30.0}, r"^options: fastest is called max_fps now$"),
    ],
)
def test_old_keys_answer_with_the_new_ones(options: dict, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message):
        ndtorch.load("foreground", size=48, **options)
    (tmp_path / "config.toml").write_text('model = "foreground"\n[tracking]\ncoast = 2.0')
    with pytest.raises(InputError, match=r"config\.toml: .*coast is called max_lost_s now"):
        ndtorch.load(tmp_path)
