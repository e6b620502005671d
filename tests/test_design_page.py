"""The page on the design names files and folders that exist."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs" / "design.md").read_text(encoding="utf-8")
NAMED = sorted(set(re.findall(r"`((?:ndtorch|robot|train|models|tests|docs)/[\w./-]+)`", PAGE)))


def layout() -> list[str]:
    """Folders of the layout: a line begins with them, and its indent says inside which one they lie."""
    found, above = [], {}
    for line in PAGE.split("```")[1].strip("\n").splitlines():
        indent = len(line) - len(line.lstrip())
        above = {level: name for level, name in above.items() if level < indent}
        inside = above[max(above)] if above else ""
        run = re.match(r"(?:[\w.]+/ *)*", line.lstrip())
        folders = [inside + name for name in run[0].split()] if run else []
        found += folders
        if len(folders) == 1:
            above[indent] = folders[0]
    return found


@pytest.mark.parametrize("path", NAMED)
def test_a_path_of_the_page_exists(path: str) -> None:
    assert (ROOT / path).exists()


@pytest.mark.parametrize("folder", layout())
def test_a_folder_of_the_layout_exists(folder: str) -> None:
    assert (ROOT / folder).is_dir()
