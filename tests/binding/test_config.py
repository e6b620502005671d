"""Constants of the model: defaults, files, and errors that name the key."""

from __future__ import annotations

from pathlib import Path

import pytest
from pydantic import ValidationError

from ndtorch.binding import BindingConfig
from ndtorch.binding.config import read_config, validated
from ndtorch.errors import InputError


def test_defaults_are_the_published_constants() -> None:
    assert BindingConfig().model_dump() == {
        "dt": 0.01,
        "tau_motion_high": 0.5,
        "tau_motion_low": 0.05,
        "order": "filter-first",
        "tau_in": 1.0,
        "tau_out": 0.5,
        "window": 2.0,
        "floor": 0.01,
        "rule": "competitive",
        "f": "cube",
        "g": "tanh-pi",
        "gamma": 0.5,
        "settle": 4.0,
        "tau_onset": 2.0,
        "radius_limit": 0.95,
        "stable_window": 1.0,
        "stable_mean": 2.0,
        "stable_change": 0.5,
        "learned_weight": 0.6,
        "scale_free_gamma": 0.2,
        "scale_free_settle": 0.5,
        "tau_smooth": 0.05,
        "readout": "delays",
    }


@pytest.mark.parametrize("name", list(BindingConfig.model_fields))
def test_every_constant_says_what_it_is(name: str) -> None:
    assert BindingConfig.model_fields[name].description


def test_a_config_cannot_be_changed() -> None:
    with pytest.raises(ValidationError):
        BindingConfig().gamma = 3.0  # type: ignore[misc]


def test_a_file_gives_what_it_says_and_defaults_for_the_rest(tmp_path: Path) -> None:
    path = tmp_path / "config.toml"
    path.write_text('gamma = 4\norder = "printed"\n')
    assert read_config(path) == BindingConfig(gamma=4.0, order="printed")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("gama = 4", r"config\.toml: unknown key 'gama'; known: dt, tau_motion_high, "),
        ("gamma = -4", r"config\.toml: gamma = -4: .*greater than or equal to 0"),
        ("dt = 0", r"config\.toml: dt = 0: .*greater than 0"),
        ("dt = nan", r"config\.toml: dt = nan: "),
        ("radius_limit = 1.0", r"config\.toml: radius_limit = 1\.0: .*less than 1"),
        ("radius_limit = 0", r"config\.toml: radius_limit = 0: .*greater than 0"),
        ("window = -1", r"config\.toml: window = -1: "),
        ('order = "second"', r"config\.toml: order = 'second': .*'filter-first' or 'printed'"),
        ('gamma = "fast"', r"config\.toml: gamma = 'fast': .*number"),
        ("[gamma]\nfast = 1", r"config\.toml: gamma = \{'fast': 1\}: "),
    ],
)
def test_errors_name_the_file_the_key_and_the_value(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "config.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        read_config(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [b"gamma = ", b"gamma 4", b"\xff\xfe\x00", b"gamma = 1\ngamma = 2"])
def test_what_is_not_toml_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "config.toml"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"config\.toml: not a TOML file: "):
        read_config(path)


def test_a_missing_file_and_a_folder_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"config\.toml: no such file"):
        read_config(tmp_path / "config.toml")
    with pytest.raises(InputError, match="Is a directory"):
        read_config(tmp_path)


def test_validated_names_where_the_values_came_from() -> None:
    with pytest.raises(InputError, match=r"^options: unknown key 'gama'"):
        validated({"gama": 1.0}, "options")
    assert validated({}, "options") == BindingConfig()
