"""Which part of the project may import which, and what `import ndtorch` leaves untouched."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import ndtorch

LIBRARY = Path(ndtorch.__file__).resolve().parent
HEAVY = ("cv2", "torchvision", "rerun", "matplotlib", "mujoco", "tyro", "serial")


def imports(path: Path) -> Iterator[str]:
    """Full names of every module, or name in one, that the file imports anywhere."""
    package = ("ndtorch", *path.relative_to(LIBRARY).parent.parts)
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = [] if node.level == 0 else list(package[: len(package) - node.level + 1])
            parts = [*base, *([node.module] if node.module else [])]
            yield from (".".join([*parts, name.name]) for name in node.names)


def imported(folder: str) -> set[str]:
    files = list((LIBRARY / folder).rglob("*.py"))
    assert files, f"no files in {folder}"
    return {name for path in files for name in imports(path)}


def within(names: set[str], *packages: str) -> set[str]:
    return {name for name in names if any(name == p or name.startswith(p + ".") for p in packages)}


@pytest.mark.parametrize("folder", ["vision", "scenes"])
def test_the_lowest_floor_knows_nothing_above_it(folder: str) -> None:
    above = ("ndtorch.binding", "ndtorch.navigation", "ndtorch.report", "ndtorch.cli", "ndtorch.loading")
    assert within(imported(folder), *above) == set()


@pytest.mark.parametrize(("folder", "neighbour"), [("binding", "navigation"), ("navigation", "binding")])
def test_binding_and_navigation_do_not_know_each_other(folder: str, neighbour: str) -> None:
    above = ("ndtorch.report", "ndtorch.cli", "ndtorch.loading")
    assert within(imported(folder), f"ndtorch.{neighbour}", *above) == set()


@pytest.mark.parametrize("folder", ["vision", "scenes", "binding", "navigation"])
def test_no_floor_imports_the_package_as_a_whole(folder: str) -> None:
    """`import ndtorch` or `from ndtorch import x` would drag in every floor."""
    modules = {f"ndtorch.{path.stem}" for path in LIBRARY.iterdir()}
    taken = within(imported(folder), "ndtorch")
    assert {name for name in taken if ".".join(name.split(".")[:2]) not in modules} == set()


def test_the_library_never_imports_the_programs() -> None:
    assert within(imported("."), "ndtorch_train", "ndtorch_robot", "tests") == set()


def test_the_scan_sees_relative_and_nested_imports(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.modules[__name__], "LIBRARY", tmp_path)
    path = tmp_path / "vision" / "bad.py"
    path.parent.mkdir()
    path.write_text(
        "def f():\n    from ..binding import rules\n    import ndtorch_train.sweep\n    from . import motion\n"
    )
    assert set(imports(path)) == {"ndtorch.binding.rules", "ndtorch_train.sweep", "ndtorch.vision.motion"}


PROGRAM = f"""
import sys, torch, logging, os
def settings():
    return (torch.get_num_threads(), torch.get_num_interop_threads(), torch.get_default_dtype(),
            torch.get_default_device(), torch.is_grad_enabled(), len(logging.getLogger().handlers),
            torch.initial_seed(), dict(os.environ))
torch.set_num_threads(2)
before = settings()
import ndtorch
import ndtorch.binding, ndtorch.navigation, ndtorch.scenes, ndtorch.vision
assert settings() == before, (settings(), before)
print(*[name for name in {HEAVY!r} if name in sys.modules])
"""


def test_import_loads_nothing_heavy_and_changes_no_setting(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], capture_output=True, text=True, cwd=tmp_path, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == []
    assert list(tmp_path.iterdir()) == []


def test_the_package_itself_imports_no_torch(tmp_path: Path) -> None:
    """So that `ndtorch --help` and `ndtorch scenes` answer at once."""
    program = "import sys, ndtorch.scenes.named; print('torch' in sys.modules or 'numpy' in sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, cwd=tmp_path, timeout=120, check=True
    )
    assert done.stdout.strip() == "False"
