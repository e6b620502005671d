"""Files that come with a package."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

import ndtorch
from ndtorch.errors import InputError
from ndtorch.utils.packages import toml_file


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
