"""Configurations, and names of units: options and keys say their unit where it is none of the usual ones."""

from __future__ import annotations

import ast
import inspect
import itertools
import re
import textwrap
from collections.abc import Iterator
from importlib.metadata import entry_points
from pathlib import Path

import pytest
from pydantic import BaseModel

import ndtorch
from ndtorch.binding.models.published import PublishedConfig
from ndtorch.binding.models.registry import KINDS
from ndtorch.cli.commands import GROUP
from ndtorch.config import ModelConfig, config_text, option_places, validated, with_options
from ndtorch.errors import InputError
from ndtorch.loading import model_folders
from ndtorch.utils.toml import toml_values
from ndtorch_robot.calibration.model import Calibration
from ndtorch_robot.cameras.source import CameraSettings
from ndtorch_robot.navigator_options import declared
from ndtorch_robot.run_config import RunConfig
from ndtorch_robot.sim.disturbances import read_disturbances

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


OTHER = re.compile(r"(?<![\w.])(ms|us|mm|cm|km|km/h|rad|radians|milliseconds|minutes|hours|kHz)(?![\w])")
"""Units that must stand in the name, as help texts have them."""

NUMBER = re.compile(r"\b(int|float)\b")

ENDINGS = (
    *("_s", "_ms", "_m", "_px", "_hz", "_deg", "_rad", "_percent", "_per_s", "_per_s2", "_per_m"),
    *("_levels", "_ratio", "_sum"),
)
"""Units at the end of a key, as files about hardware have them."""

WITHOUT = {
    "camera_monitor": "static_correlation chance_correlation min_turns",
    "simulation": "seed",
    "cameras": "gain",
    "left": "distortion",
    "right": "distortion",
    "quality": "views",
}
"""Numbers that have no unit, by the table: shares, levels of gray, counts."""


def options() -> Iterator[tuple[str, str, str]]:
    """Command, name and help of every option that is a number."""
    for point in entry_points(group=GROUP):
        if point.value.startswith("ndtorch"):
            for part in point.load().__mro__[:-1]:
                yield from ((point.name, name, text) for name, text in said(part))
    yield from (("drive", option.name, option.words) for option in declared() if option.kind in (int, float))


def said(command: type) -> Iterator[tuple[str, str]]:
    """Name and help of the numbers among the fields of a class."""
    body = ast.parse(textwrap.dedent(inspect.getsource(command))).body[0]
    assert isinstance(body, ast.ClassDef)
    for field, text in itertools.pairwise(body.body):
        if isinstance(field, ast.AnnAssign) and isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant):
            assert isinstance(field.target, ast.Name)
            if NUMBER.search(ast.unparse(field.annotation)):
                yield field.target.id, str(text.value.value)


def test_options_are_in_the_usual_units_or_say_theirs() -> None:
    found = list(options())
    assert {("cameras", "exposure_ms"), ("bind", "seconds"), ("drive", "speed")} <= {(c, n) for c, n, _ in found}
    wrong = [(c, n) for c, n, text in found for unit in OTHER.findall(text) if unit not in n.split("_")]
    assert wrong == []
    # A frame rate has one name.
    rates = {n for _, n, text in found if re.match(r"(\w+: )?frames (a|per) second", text, re.IGNORECASE)}
    assert rates == {"fps"}


def numbers(table: type[BaseModel], name: str) -> Iterator[tuple[str, str]]:
    """Table and key of every number in a file; tables that are checked elsewhere are left out."""
    for key, field in table.model_fields.items():
        kind = field.annotation
        parts = (kind, *getattr(kind, "__args__", ()))
        inner = next((part for part in parts if isinstance(part, type) and issubclass(part, BaseModel)), None)
        if inner is not None and key != "navigation":
            yield from numbers(inner, key)
        elif inner is None and not re.search("dict|Mapping", str(kind)) and NUMBER.search(str(kind)):
            yield name, key


@pytest.mark.parametrize(("table", "name"), [(RunConfig, ""), (CameraSettings, "cameras"), (Calibration, "")])
def test_keys_of_hardware_end_in_their_unit(table: type[BaseModel], name: str) -> None:
    found = list(numbers(table, name))
    assert len(found) > 4
    bare = [(t, key) for t, key in found if not key.endswith(ENDINGS)]
    assert [(t, key) for t, key in bare if key not in WITHOUT.get(t, "").split()] == []


@pytest.mark.parametrize(
    ("old", "new"),
    [("rate=15", "fps"), ("late=0.1", "latency_s"), ("turned", "'right-yaw'"), ("noise=0.1", "noise_sigma")],
)
def test_an_old_disturbance_is_told_with_the_new_one(old: str, new: str) -> None:
    with pytest.raises(InputError, match=f"is called {new} now"):
        read_disturbances(old)
