"""What a reader gets: one page that opens offline, the same as JSON, and the table for a README."""

from __future__ import annotations

import base64
import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ndtorch.report.page import NAME, render, versions
from ndtorch.utils.files import write_text
from ndtorch_train.reproduce.experiment import Claim, Outcome

COLORS = {
    "holds": ("#0072b2", "✓"),
    "partly": ("#b07800", "◐"),
    "does not hold": ("#c0392b", "✗"),
    "not run in quick": ("#777777", "○"),
}
"""Color and mark of every verdict; the mark shows it without the color."""

BEGIN, END = "<!-- claims: begin -->", "<!-- claims: end -->"


class Entry(NamedTuple):
    """A claim with what came out, its figures `[{name, title, caption, parameters}]`, the folder they are in, and the
    same with better parts."""

    claim: Claim
    outcome: Outcome
    parameters: dict[str, Any]
    drawings: list[dict[str, Any]]
    place: Path | None
    better: Entry | None = None

    @property
    def best(self) -> Entry:
        """With the better parts, where they were tried."""
        return self if self.better is None or not self.better.tried else self.better

    @property
    def tried(self) -> bool:
        """Whether anything was measured."""
        return self.outcome.verdict != "not run in quick"


def not_run(claim: Claim) -> Entry:
    """A claim that has no quick form."""
    outcome = Outcome("-", "not run in quick", "Takes too long for --quick; run without it.")
    return Entry(claim, outcome, {}, [], None)


def publish(entries: Sequence[Entry], out: Path, quick: bool, command: str) -> None:
    """Write report.html, claims.json and figures/ into `out`."""
    figures = out / "figures"
    figures.mkdir(parents=True, exist_ok=True)
    for entry in [one for pair in entries for one in (pair, pair.better) if one is not None]:
        for drawing in entry.drawings:
            for kind in ("svg", "png"):
                assert entry.place is not None
                shutil.copyfile(entry.place / f"{drawing['name']}.{kind}", figures / f"{drawing['name']}.{kind}")
    data = {"quick": quick, "command": command, "claims": [as_json(entry) for entry in entries]}
    write_text(out / "claims.json", json.dumps(data, indent=1, ensure_ascii=False) + "\n")
    write_text(out / NAME, page(entries, quick, command))


def as_json(entry: Entry) -> dict[str, Any]:
    """A claim as claims.json has it."""
    claim, outcome = entry.claim, entry.outcome
    better = None
    if entry.better is not None:
        same = ("id", "source", "claim", "printed", "tolerance", "better")
        better = {"parts": entry.better.claim.parts}
        better |= {key: value for key, value in as_json(entry.better).items() if key not in same}
    return {
        "id": claim.id,
        "source": claim.source,
        "claim": claim.text,
        "printed": claim.printed,
        "ours": outcome.ours,
        "tolerance": claim.tolerance,
        "verdict": outcome.verdict,
        "why": outcome.why,
        "parameters": entry.parameters,
        "numbers": outcome.numbers,
        "figures": [drawing["name"] for drawing in entry.drawings],
        "better": better,
    }


WORDS = {
    "holds": ("holds", "hold"),
    "partly": ("holds in part", "hold in part"),
    "does not hold": ("does not hold", "do not hold"),
    "not run in quick": ("was not run in quick", "were not run in quick"),
}
"""Words for one claim and for several."""


def tally(entries: Sequence[Entry]) -> str:
    """How many claims hold, as published and with the better parts."""

    def counted(verdicts: list[str]) -> str:
        counts = [(verdicts.count(verdict), *words) for verdict, words in WORDS.items()]
        parts = [(n, one if n == 1 else many) for n, one, many in counts if n]
        return ", ".join(f"{n} {noun(n) if k == 0 else ''}{said}" for k, (n, said) in enumerate(parts))

    def noun(n: int) -> str:
        return "claim " if n == 1 else "claims "

    words = counted([e.outcome.verdict for e in entries])
    if any(e.best is not e for e in entries):
        words += f"; with the better parts {counted([e.best.outcome.verdict for e in entries])}"
    return words


def markdown(entries: Sequence[Entry], quick: bool, command: str) -> str:
    """The table of claims for a README; the report names the criteria that were not met."""

    def cell(text: str) -> str:
        return text.replace("|", "\\|").replace("\n", " ")

    def shown(outcome: Outcome) -> str:
        return f"**{outcome.verdict}**" if outcome.verdict != "holds" else "holds"

    def reason(outcome: Outcome) -> str:
        return outcome.why.partition("Not met: ")[0].strip()

    lines = [
        f"Written by `{command}`: {tally(entries)}." + (" A quick run: fewer or shorter trials." if quick else ""),
        "",
        "| | claim | printed | ours | tolerance | verdict | why | with the better parts |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for entry in entries:
        claim, outcome = entry.claim, entry.outcome
        cells = [f"{claim.text} [{claim.source}]", claim.printed, outcome.ours, claim.tolerance]
        cells += [shown(outcome), reason(outcome)]
        if entry.better is None:
            cells.append("")
        else:
            parts, with_them = entry.better.claim.parts, entry.better.outcome
            cells.append(f"{shown(with_them)}, {parts}: {with_them.ours}. {reason(with_them)}")
        lines.append(f"| {claim.id} | {' | '.join(map(cell, cells))} |")
    return "\n".join(lines) + "\n"


def put_table(path: Path, table: str) -> None:
    """Put the table between the marks of a Markdown file, or behind its end where it has none."""
    text = path.read_text(encoding="utf-8") if path.exists() else ""
    if BEGIN in text and END in text:
        before, rest = text.split(BEGIN, 1)
        text = f"{before}{BEGIN}\n{table}{END}{rest.split(END, 1)[1]}"
    else:
        text = f"{text.rstrip()}\n\n{BEGIN}\n{table}{END}\n".lstrip()
    write_text(path, text)


def page(entries: Sequence[Entry], quick: bool, command: str) -> str:
    """The whole page, figures and all in one file."""
    return render(
        "claims.html",
        Path(__file__).with_name("templates"),
        title="Published results, reproduced",
        entries=entries,
        tally=tally(entries),
        quick=quick,
        colors=COLORS,
        data_address=data_address,
        command=command,
        facts=versions("ndtorch-robot", "ndtorch-train"),
    )


def data_address(entry: Entry, name: str) -> str:
    """A figure as a data address: the drawing, or the pixels where they are smaller."""
    assert entry.place is not None
    svg, png = ((entry.place / f"{name}.{kind}").read_bytes() for kind in ("svg", "png"))
    data, kind = (svg, "svg+xml") if len(svg) <= 3 * len(png) else (png, "png")
    return f"data:image/{kind};base64,{base64.b64encode(data).decode()}"
