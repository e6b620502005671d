"""Constants of models: defaults, files, options, and errors that name the key."""

from __future__ import annotations

from pathlib import Path

import pytest

import ndtorch
from ndtorch.binding.models.published import PublishedConfig
from ndtorch.binding.models.registry import KINDS
from ndtorch.config import ModelConfig, config_text, option_places, validated, with_options
from ndtorch.errors import InputError
from ndtorch.loading import model_folders
from ndtorch.utils.toml import toml_values

CONFIGS = [kind.config_type for kind in KINDS.values()]


def test_defaults_are_the_published_constants() -> None:
    network = PublishedConfig().model_dump()["network"]
    assert network == {
        "dt": 0.01,
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
    path = model_folders()[name] / "config.toml"
    assert path.read_text(encoding="utf-8") == config_text(KINDS[name].config_type())  # type: ignore[call-arg]


@pytest.mark.parametrize("kind", CONFIGS)
def test_every_constant_says_what_it_is_and_has_a_name_of_its_own(kind: type[ModelConfig]) -> None:
    places = option_places(kind)
    assert all(len(found) == 1 for found in places.values())
    for line in config_text(kind()).splitlines():  # type: ignore[call-arg]
        assert "  # " in line or line.startswith("[") or not line


@pytest.mark.parametrize("kind", CONFIGS)
def test_a_config_is_read_back_as_it_was_written(tmp_path: Path, kind: type[ModelConfig]) -> None:
    config = with_options(kind(), {"size": 64, "fps": 12.5})  # type: ignore[call-arg]
    (tmp_path / "config.toml").write_text(config_text(config), encoding="utf-8")
    assert validated(kind, toml_values(tmp_path / "config.toml"), "x") == config
    assert config.size == (64, 64)


@pytest.mark.parametrize(
    ("name", "options"),
    [
        *(("published", {"size": size}) for size in ((30000, 30000), (0, 5), (1, 2**25))),
        *(
            ("published", {"normalise.window": 1e9}),
            ("scale-free", {"pieces": 10**9}),
            ("scale-free", {"sweeps": 10**9}),
        ),
        ("scale-free", {"delays": (1e9,)}),
        ("retinotopic", {"size": (30000, 30000)}),
    ],
)
def test_a_config_asks_for_no_more_memory_than_is_allowed(name: str, options: dict[str, object]) -> None:
    """A file may claim anything; what would end in the allocator is refused by name."""
    with pytest.raises(InputError, match="at most") as caught:
        ndtorch.load(name, **options)  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[network]\ngama = 4", r"x: network: unknown key 'gama'; did you mean gamma\?"),
        ("gamma = 4", r"x: unknown key 'gamma'; known: model, size, "),
        ("[network]\ngamma = -4", r"x: network: gamma = -4: .*greater than or equal to 0"),
        ("[network]\ndt = 0", r"x: network: dt = 0: .*greater than 0"),
        ("[network]\ndt = nan", r"x: network: dt = nan: "),
        ("[network]\nradius_limit = 1.0", r"x: network: radius_limit = 1\.0: .*less than 1"),
        ("[normalise]\nwindow = -1", r"x: normalise: window = -1: "),
        ('[normalise]\norder = "second"', r"x: normalise: order = 'second': .*'filter-first' or 'printed'"),
        ('[network]\ngamma = "fast"', r"x: network: gamma = 'fast': .*number"),
        ("size = [500]", r"x: .*size"),
        ("fps = -1", r"x: fps = -1: "),
        ('model = "video"', r"x: model = 'video': should be 'published'"),
    ],
)
def test_errors_name_the_file_the_key_and_the_value(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "config.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        validated(PublishedConfig, toml_values(path), "x")
    assert "\n" not in str(caught.value)
