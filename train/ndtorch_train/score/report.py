"""The reports of the scores, on the library's page."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ndtorch.report.page import Page, Shown, Table, command_line, versions

PACKAGES = ("ndtorch-train", "scikit-learn")


def write_score_page(title: str, text: str, shown: Sequence[Shown], folder: Path) -> Path:
    """Write report.html.

    Args:
        title: what was measured.
        text: paragraphs and tables, as the command prints them in Markdown.
        shown: pictures.
        folder: where to write.
    """
    answer, tables = parts(text)
    return Page(title, answer, command_line(), versions(*PACKAGES), tables, shown).write(folder)


def read_rows(file: Path) -> list[dict[str, Any]]:
    """The rows of a CSV file for JSON: numbers as numbers, and None where there is none."""

    def value(cell: str) -> Any:
        try:
            number = float(cell)
        except ValueError:
            return cell or None
        return None if math.isnan(number) else int(number) if cell.lstrip("-").isdigit() else number

    with file.open(newline="", encoding="utf-8") as lines:
        return [{key: value(cell) for key, cell in row.items()} for row in csv.DictReader(lines)]


def parts(text: str) -> tuple[list[str], list[Table]]:
    """The paragraphs of a Markdown text, and its tables, each titled by the paragraph before it or by its number."""
    paragraphs: list[str] = []
    tables: list[Table] = []
    for block in text.strip().split("\n\n"):
        lines = block.strip().splitlines()
        if not lines or not lines[0].startswith("|"):
            paragraphs += [line for line in lines if not line.startswith("```")]
            continue
        heads, _, *rows = ([cell.strip(" *") for cell in line.strip().strip("|").split("|")] for line in lines)
        tables.append(Table("Scores" if not tables else f"Scores, table {len(tables) + 1}", heads, rows))
    return paragraphs, tables
