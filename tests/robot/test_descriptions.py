"""Options of robot commands, their files and the navigator: described in sentences, and read without importing it."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import itertools
import subprocess
import sys
import textwrap
from importlib.metadata import entry_points
from pathlib import Path
from typing import get_type_hints

import pytest
from pydantic import BaseModel

from ndtorch.cli.commands import GROUP
from ndtorch.navigation import NavigatorOptions, controller_names
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


def test_they_are_those_of_the_class() -> None:
    kinds = get_type_hints(NavigatorOptions)
    fields = [(field.name, kinds[field.name], field.default) for field in dataclasses.fields(NavigatorOptions)]
    assert [option[:3] for option in declared()] == fields
    assert all(option.words for option in declared())


def test_the_default_controller_exists() -> None:
    assert {option.name: option.default for option in declared()}["controller"] in controller_names()


def test_no_command_imports_torch_for_its_help(tmp_path: Path) -> None:
    program = (
        "import sys\nfrom ndtorch.cli.commands import installed, main\n"
        "for name in installed():\n"
        "    try:\n        main([name, '--help'])\n    except SystemExit as end:\n        assert end.code == 0, name\n"
        "    for module in ('torch', 'cv2', 'matplotlib', 'mujoco', 'scipy', 'sklearn'):\n"
        "        assert module not in sys.modules, f'{name} imports {module}'\n"
        "print('all', len(installed()))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, cwd=tmp_path, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1].startswith("all 1")
