"""What a user gets who makes a mistake: one line that names what was typed, and the exit code 2."""

from __future__ import annotations

import re

import pytest

from tests import mistakes


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    mistakes.prepare(tmp_path)
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("words", mistakes.cases())
def test_a_mistake_is_one_line(words: str) -> None:
    code, line = mistakes.said(words)
    assert code == 2, line
    assert line.startswith("error: ")
    assert line.count("\n") == 1
    typed = [part.lstrip("-") for part in re.split(r"[\s=,:./]+", words)]
    assert any(part and part.casefold() in line.casefold().replace("_", "-") for part in typed), line
