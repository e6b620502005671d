"""Wrong arguments of public calls are named in one line; errors of other causes stay what they are."""

from __future__ import annotations

import copy
import math
import pickle
import sys
import tomllib
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
import pytest
import torch
from torch import Tensor, nn

import ndtorch
from ndtorch import vision
from ndtorch.errors import InputError
from ndtorch.utils.packages import code_digest, toml_file
from ndtorch.utils.public_calls import explained, fits, wrapped


class Walks(Protocol):
    legs: int

    def walk(self) -> None: ...


class Dog:
    legs = 4

    def walk(self) -> None:
        pass


@pytest.mark.parametrize(
    ("hint", "right", "wrong"),
    [
        (float, [1.5, 2, np.float32(1.5), np.int64(2), math.inf], [True, "x", None, torch.zeros(1)]),
        (int, [2, np.int64(2)], [True, 2.0, "2"]),
        (bool, [True, np.bool_(False)], [1, None]),
        (str | Path, ["x", Path("x")], [1, b"x"]),
        (float | None, [None, 1.0], ["x"]),
        (Literal["wrap", "clamp"], ["wrap"], ["wrapp", 1, None]),
        (tuple[int, int], [(1, 2), [1, 2], torch.Size((1, 2))], [(1,), (1, 2, 3), (1, "x"), 3]),
        (tuple[float, ...], [(), (1, 2.5)], [("x",), 1.0]),
        (Sequence[float], [[1.0], (1, 2), ()], ["12", [None], 1.0]),
        (Iterable[Any], [[1], iter(()), torch.zeros(1)], ["x", 1]),
        (Callable[[int], int], [abs, torch.tanh], ["abs"]),
        (Tensor | float, [torch.zeros(1), 1.0], [np.zeros(1)]),
        (Walks, [Dog()], ["dog"]),
        (Any, [None, "x"], []),
    ],
)
def test_values_fit_their_annotations_or_do_not(hint: Any, right: list[Any], wrong: list[Any]) -> None:
    assert [value for value in right if not fits(value, hint)] == []
    assert [value for value in wrong if fits(value, hint)] == []


def half(x: float, name: str = "x") -> float:
    """Half of it.

    Raises:
        ZeroDivisionError: it is 0.
    """
    if x == 0:
        raise ZeroDivisionError("it is 0")
    if name == "broken":
        raise KeyError(name)
    return x / 2


def test_an_error_that_no_argument_explains_stays_what_it_is() -> None:
    call = wrapped(half, None)
    assert call(3.0) == 1.5
    with pytest.raises(InputError, match="x must be a number, got 'a'") as caught:
        call("a")
    assert isinstance(caught.value.__cause__, TypeError)
    with pytest.raises(KeyError, match="broken"):
        call(1.0, name="broken")
    with pytest.raises(ZeroDivisionError, match="it is 0"):
        call(0, name=1)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="unexpected keyword"):
        call(1.0, nome="x")
    assert call(True) == 0.5  # a method looks at nothing while a call goes well
    with pytest.raises(InputError, match="x must be a number, got True"):
        wrapped(half, lambda value: value is True)(True)


def test_what_a_generator_raises_is_explained_when_it_comes() -> None:
    def count(to: int) -> Iterator[int]:
        yield from range(to)

    made = wrapped(count, None)("x")
    with pytest.raises(InputError, match="to must be a whole number, got 'x'"):
        next(made)


def test_calls_of_the_library_are_pickled_copied_compiled_and_mapped() -> None:
    assert explained(vision.row_shift) is vision.row_shift
    assert pickle.loads(pickle.dumps(vision.row_shift)) is vision.row_shift
    module = vision.NDMin()
    x = torch.rand(2, 4, 3, 8, 8, generator=torch.Generator().manual_seed(0))
    wanted = module(x)[0]
    assert torch.equal(copy.deepcopy(module)(x)[0], wanted)
    assert torch.equal(torch.vmap(lambda one: module(one)[0])(x), wanted)
    compiled: Any = torch.compile(module, backend="eager", fullgraph=True)
    assert torch.equal(compiled(x)[0], wanted)
    around: nn.Module = nn.Sequential(module)
    assert torch.equal(around(x)[0], wanted)


def test_a_bare_name_is_a_file_that_comes_along(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert toml_file(Path("binding"), "ndtorch_train", "sweeps").is_file()
    assert toml_file(Path("sim"), "ndtorch_robot", "configs").is_file()
    for path in (Path("binding.toml"), Path("some/binding"), tmp_path / "binding"):
        assert toml_file(path, "ndtorch_train", "sweeps") == path
    Path("binding").touch()
    assert toml_file(Path("binding"), "ndtorch_train", "sweeps") == Path("binding")
    with pytest.raises(InputError, match="none of binding, maps"):
        toml_file(Path("bindings"), "ndtorch_train", "sweeps")


def test_one_version_everywhere() -> None:
    root = Path(__file__).parents[2]
    files = [root / part / "pyproject.toml" for part in ("", "robot", "train")]
    projects = [tomllib.loads(file.read_text())["project"] for file in files]
    assert {project["version"] for project in projects} == {ndtorch.__version__}
    for project in projects[1:]:
        assert any(need.startswith(f"ndtorch>={ndtorch.__version__},") for need in project["dependencies"])
    assert f"\nversion: {ndtorch.__version__}\n" in (root / "CITATION.cff").read_text()
    assert f"\n## {ndtorch.__version__} (2" in (root / "CHANGELOG.md").read_text()


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An importable package `some_code`."""
    folder = tmp_path / "some_code"
    (folder / "deep").mkdir(parents=True)
    for name in ("__init__.py", "x.py", "deep/y.py", "notes.md"):
        (folder / name).write_text("1")
    monkeypatch.syspath_prepend(tmp_path)
    return folder


def fresh(*uses: str) -> str:
    code_digest.cache_clear()
    return code_digest(uses)


def test_it_follows_the_code_and_nothing_else(package: Path) -> None:
    whole, deep, one = fresh("some_code"), fresh("some_code.deep"), fresh("some_code.x")
    assert len({whole, deep, one}) == 3
    (package / "notes.md").write_text("2")
    assert fresh("some_code") == whole
    (package / "x.py").write_text("2")
    assert fresh("some_code") != whole
    assert fresh("some_code.x") != one
    assert fresh("some_code.deep") == deep
    assert "some_code" not in sys.modules


def test_it_is_the_same_wherever_the_code_lies(package: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = fresh("some_code")
    (tmp_path / "elsewhere").mkdir()
    package.rename(tmp_path / "elsewhere" / "some_code")
    monkeypatch.syspath_prepend(tmp_path / "elsewhere")
    assert fresh("some_code") == before
