"""What a user gets who makes a mistake: one line, the exit code 2, and the page of the docs says so."""

from __future__ import annotations

import pytest

from tests import mistakes

WRITTEN = mistakes.PAGE.read_text(encoding="utf-8")


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
    # What there is to choose from may grow; `python -m tests.mistakes` writes the page anew.
    begin, _, hint = line.strip().partition("; did you mean ")
    assert mistakes.entry(words, begin[:40]).removesuffix(" ``") in WRITTEN
    assert hint in WRITTEN


def test_the_page_has_nothing_else() -> None:
    assert len(mistakes.cases()) >= 60
    assert WRITTEN.count("- `ndtorch ") == len(mistakes.cases())
