"""Tables of many drives."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pandas as pd

WORDS = ["arena", "controller", "disturbance"]
"""Columns of words, which name a row."""

FORMS = {
    **dict.fromkeys(("drives", "m driven", "worlds"), "{:.0f}"),
    **dict.fromkeys(("simulated hours", "pose error degrees", "success", "collided"), "{:.2f}"),
    "score": "{:.3f}",
}
"""How numbers are written; others with one decimal, and percentages without any."""


def table_of(summaries: Sequence[dict[str, Any]]) -> pd.DataFrame:
    """One row for all drives of a controller in an arena; columns without any value are left out."""
    maps = [f"map.{name}" for name in ("precision", "surfaces", "recall")]
    errors = [f"pose_error.located.{name}" for name in ("median_m", "median_degrees")]
    drives = pd.json_normalize(list(summaries))
    drives = drives.reindex(columns=drives.columns.union([*WORDS, *maps, *errors]))
    drives[WORDS] = drives[WORDS].astype(object).fillna("")
    drives[[*maps, *errors]] = drives[[*maps, *errors]].astype(float)
    groups = drives.groupby(WORDS, sort=False)
    hours = groups["simulated_seconds"].sum() / 3600
    table = pd.DataFrame(
        {
            "drives": groups.size(),
            "simulated hours": hours,
            "collisions/h": groups["collisions"].sum() / hours,
            "stops/h": groups["stopped"].sum() / hours,
            "m driven": groups["distance_m"].sum(),
            "passed within 1 m %": 100 * groups["free_area_passed"].mean(),
            "map precision %": 100 * groups[maps[0]].mean(),
            "map within 10 cm of surfaces %": 100 * groups[maps[1]].mean(),
            "map recall %": 100 * groups[maps[2]].mean(),
            "pose error cm": 100 * groups[errors[0]].median(),
            "pose error degrees": groups[errors[1]].median(),
        }
    ).reset_index()
    if not (table["pose error cm"] > 0).any():
        table = table.drop(columns=["pose error cm", "pose error degrees"])
    return table.loc[:, (table.notna() & (table != "")).any()]


def text_cells(table: pd.DataFrame) -> list[list[str]]:
    text = table.astype(object)
    for name in set(table) - set(WORDS):
        form = FORMS.get(name, "{:.0f}" if name.endswith("%") else "{:.1f}")
        text[name] = table[name].map(form.format, na_action="ignore")
    return [[str(value) for value in row] for row in text.fillna("-").replace("", "-").to_numpy()]


def markdown(table: pd.DataFrame, note: str) -> str:
    """The table in Markdown, with a line below it that says how it was made."""
    lines = [f"| {' | '.join(row)} |" for row in (list(table), *text_cells(table))]
    rule = "|".join("---" if name in WORDS else "---:" for name in table)
    return "\n".join([lines[0], f"|{rule}|", *lines[1:], "", note, ""])
