"""Which part of the project may import which, and what `import ndtorch` leaves untouched."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping
from graphlib import CycleError, TopologicalSorter
from importlib.util import find_spec
from pathlib import Path

import pytest

HEAVY = ("cv2", "numba", "scipy", "torchvision", "rerun", "matplotlib", "tyro", "serial")

PACKAGES = ("ndtorch", "ndtorch_robot", "ndtorch_train")

FLOORS = (
    "arguments config errors utils",
    "foreground kernels scenes vision",
    "binding navigation",
    "export loading",
    "__main__ cli report run",
)
"""Rooms of the library, from the ground up. A file imports from its own floor and from those below."""

FLOOR = {f"ndtorch.{room}": floor for floor, rooms in enumerate(FLOORS) for room in rooms.split()}
# The names of `ndtorch` itself come from all over the house, when they are used.
FLOOR |= {"ndtorch": 3, "ndtorch_robot": len(FLOORS), "ndtorch_train": len(FLOORS) + 1}

APART = ({"ndtorch.binding", "ndtorch.navigation"},)
"""Rooms of one floor that do not know each other."""

Arrows = dict[str, set[str]]


def folder_of(package: str) -> Path:
    spec = find_spec(package)
    assert spec is not None
    assert spec.origin is not None
    return Path(spec.origin).parent


def arrows_of(folders: Iterable[Path]) -> Arrows:
    """Who imports whom in these packages, at the top of a file or inside a function; not for type checkers alone."""
    files = {name_of(path, folder): path for folder in folders for path in folder.rglob("*.py")}
    return {
        name: {there for want in wanted(path, name) if (there := nearest(want, files))} for name, path in files.items()
    }


def name_of(path: Path, folder: Path) -> str:
    """A module's dotted name; of a package, the package's."""
    parts = path.relative_to(folder.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def nearest(name: str, files: Mapping[str, Path]) -> str | None:
    """The module that holds a name: the name's own, or the one before its last dot."""
    return next((n for n in (name, name.rpartition(".")[0]) if n in files), None)


def wanted(path: Path, name: str) -> Iterator[str]:
    """Full names of every module, or name in one, that a file imports."""
    package = name.split(".") if path.name == "__init__.py" else name.split(".")[:-1]
    todo: list[ast.AST] = [ast.parse(path.read_text(encoding="utf-8"))]
    while todo:
        node = todo.pop()
        if isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING"):
            todo += node.body if ast.unparse(node.test).startswith("not ") else node.orelse
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = [] if node.level == 0 else package[: len(package) - node.level + 1]
            yield from (".".join([*base, *filter(None, [node.module]), alias.name]) for alias in node.names)
        else:
            todo += ast.iter_child_nodes(node)


def room_of(module: str) -> str:
    """The room of the library, or the program, that a module belongs to."""
    parts = module.split(".")
    return ".".join(parts[:2]) if parts[0] == "ndtorch" else parts[0]


def circle_in(arrows: Arrows) -> list[str]:
    """A circle, from a module back to itself; empty if there is none."""
    try:
        TopologicalSorter(arrows).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


@pytest.fixture(scope="module")
def arrows() -> Arrows:
    return arrows_of(map(folder_of, PACKAGES))


@pytest.mark.parametrize("package", PACKAGES)
def test_no_files_import_each_other_in_a_circle(package: str, arrows: Arrows) -> None:
    # That importing `a.b` runs `a` first is not meant: a room's own list of names would be a circle with each of them.
    assert circle_in({name: there for name, there in arrows.items() if name.split(".")[0] == package}) == []


def test_no_arrow_points_upward(arrows: Arrows) -> None:
    rooms = {room_of(name) for name in arrows}
    assert rooms <= set(FLOOR), f"on which floor are {rooms - set(FLOOR)}?"
    upward = [f"{name} -> {to}" for name in arrows for to in arrows[name] if FLOOR[room_of(to)] > FLOOR[room_of(name)]]
    assert upward == []


def test_neighbours_that_do_not_know_each_other(arrows: Arrows) -> None:
    met = [f"{name} -> {to}" for name in arrows for to in arrows[name] if {room_of(name), room_of(to)} in APART]
    assert met == []


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
