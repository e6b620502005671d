"""What a user gets who makes a mistake: one line that names what was typed, the exit code 2, and no file."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests import mistakes


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    mistakes.prepare(tmp_path)
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(("typed", "words"), mistakes.cases())
def test_a_mistake_is_one_line(typed: str, words: str, tmp_path: Path) -> None:
    before = sorted(tmp_path.rglob("*"))
    code, line = mistakes.said(typed)
    assert code == 2, line
    assert line.startswith("error: ")
    assert line.count("\n") == 1
    parts = [part.lstrip("-") for part in re.split(r"[\s=,:./]+", typed)]
    assert any(part and part.casefold() in line.casefold().replace("_", "-") for part in parts), line
    assert words in line
    assert sorted(tmp_path.rglob("*")) == before
