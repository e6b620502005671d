"""labelled.csv, labelled.md and the page: a row a method and clip."""

from __future__ import annotations

import csv
import html
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ndtorch.files import write_text
from ndtorch_train.score.labelled.metrics import Score

COLUMNS = {
    "precision": "precision",
    "recall": "recall",
    "f": "F",
    "idf1": "IDF1",
    "mota": "MOTA",
    "switches": "switches",
    "count_error": "count error",
    "mask_f": "mask F",
    "ms_per_frame": "ms a frame",
    "fragments": "fragments",
    "direction": "direction",
    "false_per_minute": "false a minute",
}
"""Columns of the table after method and clip, and their headings; the last of all is the time against MOG2's."""
LOW = ("switches", "count_error", "ms_per_frame", "fragments", "false_per_minute")
"""Columns in which less is better."""


@dataclass(frozen=True)
class Row:
    """Scores of a method on a clip, and its processor time over that of MOG2 alone on the same frames."""

    method: str
    clip: str
    score: Score
    ratio: float


def write(rows: Sequence[Row], note: str, out: Path) -> str:
    """Write labelled.csv, labelled.md and index.html; returns the table as markdown."""
    text = markdown(rows)
    with (out / "labelled.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["method", "clip", *COLUMNS, "times_mog2"])
        for row in rows:
            values = [getattr(row.score, name) for name in COLUMNS]
            writer.writerow([row.method, row.clip, *("" if v is None else f"{v:.6g}" for v in (*values, row.ratio))])
    write_text(out / "labelled.md", f"{note}\n\n{text}")
    write_text(out / "index.html", page(rows, note))
    return text


def cells(row: Row) -> list[str]:
    """What stands in a row after method and clip."""
    values = [getattr(row.score, name) for name in COLUMNS]
    return ["-" if v is None else str(v) if isinstance(v, int) else f"{v:.2f}" for v in (*values, row.ratio)]


def best(rows: Sequence[Row]) -> list[set[int]]:
    """Numbers of the rows of one clip that are best, column by column."""
    found = []
    for name in COLUMNS:
        values = {n: v for n, row in enumerate(rows) if (v := getattr(row.score, name)) is not None}
        first = (min if name in LOW else max)(values.values()) if values else None
        found.append({n for n, v in values.items() if v == first})
    return found


def clips(rows: Sequence[Row]) -> list[list[Row]]:
    """The rows of each clip."""
    return [[row for row in rows if row.clip == name] for name in dict.fromkeys(row.clip for row in rows)]


def markdown(rows: Sequence[Row]) -> str:
    """The table, the best of every clip in bold."""
    heads = ["method", "clip", *COLUMNS.values(), "times MOG2"]
    lines = ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
    for group in clips(rows):
        winners = best(group)
        for n, row in enumerate(group):
            shown = cells(row)
            bold = [f"**{c}**" if k < len(winners) and n in winners[k] else c for k, c in enumerate(shown)]
            lines.append("| " + " | ".join([row.method, row.clip, *bold]) + " |")
    return "\n".join(lines) + "\n"


def page(rows: Sequence[Row], note: str) -> str:
    """The same as a page that opens offline."""
    heads = ["method", "clip", *COLUMNS.values(), "times MOG2"]
    body = []
    for group in clips(rows):
        winners = best(group)
        for n, row in enumerate(group):
            tags = [
                f"<td><b>{c}</b></td>" if k < len(winners) and n in winners[k] else f"<td>{c}</td>"
                for k, c in enumerate(cells(row))
            ]
            name = f"<td>{html.escape(row.method)}</td><td>{html.escape(row.clip)}</td>"
            body.append(f"<tr{' class=first' if n == 0 else ''}>{name}{''.join(tags)}</tr>")
    style = (
        "body{font:15px/1.5 sans-serif;margin:2em auto;max-width:90em;padding:0 1em}table{border-collapse:collapse}"
        "td,th{padding:.2em .6em;text-align:right}td:first-child,td:nth-child(2){text-align:left}"
        "tr.first td{border-top:1px solid #999}"
    )
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8"><title>Labelled video</title>'
        f"<style>{style}</style></head><body><h1>Video with others' truth</h1><p>{html.escape(note)}</p>"
        f"<table><tr>{''.join(f'<th>{h}</th>' for h in heads)}</tr>{''.join(body)}</table></body></html>"
    )
