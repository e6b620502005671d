"""Names of units, as docs/design.md has them: options and keys say their unit where it is none of the usual ones."""

from __future__ import annotations

import ast
import inspect
import itertools
import re
import textwrap
from collections.abc import Iterator
from importlib.metadata import entry_points

import pytest
from pydantic import BaseModel

from ndtorch.cli.commands import GROUP
from ndtorch.errors import InputError
from ndtorch_robot.calibration.model import Calibration
from ndtorch_robot.cameras.source import CameraSettings
from ndtorch_robot.navigator_options import declared
from ndtorch_robot.run_config import RunConfig
from ndtorch_robot.sim.disturbances import read_disturbances

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
