"""A name for the code that a result depends on."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from ndtorch.utils.packages import code_digest


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
