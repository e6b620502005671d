"""Every option of a robot command and every key of its files has a description of whole sentences."""

from __future__ import annotations

import ast
import inspect
import itertools
import textwrap
from importlib.metadata import entry_points

import pytest
from pydantic import BaseModel

from ndtorch.cli.commands import GROUP
from ndtorch_robot.camera_monitor.limits import CameraLimits
from ndtorch_robot.cameras import CameraSettings
from ndtorch_robot.config import DriveConfig
from ndtorch_robot.navigator_options import declared
from ndtorch_robot.robot_config import BodyTable, LimitsTable, RigTable, RobotTable
from ndtorch_robot.run_config import NavigationTable, RunConfig, SimulationTable

COMMANDS = [point for point in entry_points(group=GROUP) if point.value.startswith("ndtorch_robot.")]
OPTIONS = {option.name for option in declared()}


def is_sentence(text: str | None) -> bool:
    return text is not None and text[:1].isupper() and text.endswith(".") and len(text.split()) > 3


@pytest.mark.parametrize("point", COMMANDS, ids=lambda point: point.name)
def test_options_of_commands(point) -> None:
    body = ast.parse(textwrap.dedent(inspect.getsource(point.load()))).body[0]
    assert isinstance(body, ast.ClassDef)
    told = {
        field.target.id: text.value.value
        for field, text in itertools.pairwise(body.body)
        if isinstance(field, ast.AnnAssign)
        and isinstance(field.target, ast.Name)
        and isinstance(text, ast.Expr)
        and isinstance(text.value, ast.Constant)
    }
    assert told
    assert [name for name, text in told.items() if not is_sentence(str(text))] == []


def test_options_of_the_navigator() -> None:
    assert [option.name for option in declared() if not is_sentence(option.words)] == []


@pytest.mark.parametrize(
    "table",
    [
        *(BodyTable, LimitsTable, RigTable, RobotTable),
        *(CameraLimits, CameraSettings, DriveConfig, NavigationTable, RunConfig, SimulationTable),
    ],
)
def test_keys_of_files(table: type[BaseModel]) -> None:
    def is_table(kind: object) -> bool:
        parts = (kind, *getattr(kind, "__args__", ()))
        return any(isinstance(part, type) and issubclass(part, BaseModel) for part in parts)

    told = {
        key: field.description
        for key, field in table.model_fields.items()
        if key not in OPTIONS and not is_table(field.annotation)
    }
    assert [key for key, text in told.items() if not is_sentence(text)] in ([], ["cameras"])
