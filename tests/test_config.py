"""Configurations: constants, what is refused by name, saving and loading."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file

import ndtorch
from ndtorch.binding import FirstStage, PublishedModel, spectral_radius
from ndtorch.binding.models.whole_field import PublishedConfig
from ndtorch.config import ModelConfig, config_text, with_options
from ndtorch.errors import InputError
from ndtorch.loading import KINDS, model_folder, model_kind
from ndtorch.utils.files import save_tensors
from ndtorch.utils.tensors import leaves
from ndtorch.utils.toml import check, toml_values
from ndtorch.vision import GROUPS

CONFIGS = [kind.config_type for kind in KINDS.values()]


def test_defaults_are_the_published_constants() -> None:
    network = PublishedConfig().model_dump()["network"]
    assert network == {
        "dt": 0.01,
        "delay": 0.0,
        "rule": "competitive",
        "f": "cube",
        "g": "tanh-pi",
        "gamma": 0.5,
        "tau_in": 1.0,
        "tau_out": 0.5,
        "settle": 4.0,
        "tau_onset": 2.0,
        "radius_limit": 0.95,
    }


@pytest.mark.parametrize("name", list(KINDS))
def test_what_is_shipped_says_all_constants_and_they_are_the_defaults(name: str) -> None:
    path = model_folder(name) / "config.toml"
    assert path.read_text(encoding="utf-8") == config_text(KINDS[name].config_type())  # type: ignore[call-arg]


@pytest.mark.parametrize("kind", CONFIGS)
def test_a_config_is_read_back_as_it_was_written(tmp_path: Path, kind: type[ModelConfig]) -> None:
    config = with_options(kind(), {"size": 64, "fps": 12.5})  # type: ignore[call-arg]
    (tmp_path / "config.toml").write_text(config_text(config), encoding="utf-8")
    assert check(toml_values(tmp_path / "config.toml"), kind, "x") == config
    assert config.size == (64, 64)


@pytest.mark.parametrize(
    ("name", "options"),
    [
        *(("published", {"size": size}) for size in ((30000, 30000), (0, 5), (1, 2**25))),
        *(("published", {"normalise.window": 1e9}),),
        ("scale-free", {"duration": 1e9}),
        ("retinotopic", {"size": (30000, 30000)}),
    ],
)
def test_a_config_asks_for_no_more_memory_than_is_allowed(name: str, options: dict[str, object]) -> None:
    """A file may claim anything; what would end in the allocator is refused by name."""
    with pytest.raises(InputError, match=r"at most|less than or equal") as caught:
        ndtorch.load(name, **options)  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[network]\ngama = 4", r"x: network: unknown key 'gama'; did you mean gamma\?"),
        ("gamma = 4", r"x: unknown key 'gamma'; known: model, size, "),
        ("[network]\ngamma = -4", r"x: network\.gamma = -4: .*greater than or equal to 0"),
        ("[network]\ndt = 0", r"x: network\.dt = 0: .*greater than 0"),
        ("[network]\ndt = nan", r"x: network\.dt = nan: "),
        ("[network]\nradius_limit = 1.0", r"x: network\.radius_limit = 1\.0: .*less than 1"),
        ("[normalise]\nwindow = -1", r"x: normalise\.window = -1: "),
        ('[normalise]\norder = "second"', r"x: normalise\.order = 'second': .*'filter-first' or 'printed'"),
        ('[network]\ngamma = "fast"', r"x: network\.gamma = 'fast': .*number"),
        ("size = [500]", r"x: .*size"),
        ("fps = -1", r"x: fps = -1: "),
        ('model = "video"', r"x: model = 'video': should be 'published'"),
    ],
)
def test_errors_name_the_file_the_key_and_the_value(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "config.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        check(toml_values(path), PublishedConfig, "x")
    assert "\n" not in str(caught.value)


NAMES = ("published", "scale-free", "retinotopic", "foreground")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A copy of the trained model to break."""
    return Path(shutil.copytree(model_folder("published"), tmp_path / "model"))


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
    options: dict[str, object] = {"retinotopic": {"most": 3}, "foreground": {"learn": False}}.get(name, {"gamma": 0.7})
    model = ndtorch.load(name, size=(32, 48), fps=25.0, **options)  # type: ignore[arg-type]
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
        ({"radius_limit": 2.0}, r"options: network\.radius_limit = 2\.0"),
        ({"rule": "oja"}, "rule must be one of competitive"),
        ({"tau_background": 3.0}, "published has no option tau_background; foreground has it"),
    ],
)
def test_options_that_do_not_fit_are_refused_by_name(folder: Path, options: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        ndtorch.load(folder, **options)
