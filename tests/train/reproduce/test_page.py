"""What a reader gets."""

from __future__ import annotations

from pathlib import Path

from ndtorch_train.reproduce.page import BEGIN, END, put_table


def test_a_table_goes_behind_a_file_without_marks(tmp_path: Path) -> None:
    path = tmp_path / "new.md"
    put_table(path, "| t |\n")
    put_table(path, "| u |\n")
    assert path.read_text() == f"{BEGIN}\n| u |\n{END}\n"
