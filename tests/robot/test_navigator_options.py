"""Options of a navigator that are read without importing it are those that it has."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from pathlib import Path
from typing import get_type_hints

from ndtorch.navigation import NavigatorOptions, controller_names
from ndtorch_robot.navigator_options import declared


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
