"""Files that come with a package, and a name for the code that a result depends on."""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path

import pytest

import ndtorch
from ndtorch.errors import InputError
from ndtorch.utils.packages import code_digest, toml_file


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
