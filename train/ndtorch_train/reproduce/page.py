"""What a reader gets: one page that opens offline, the same as JSON, and the table for a README."""

from __future__ import annotations

import base64
import html
import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ndtorch.files import write_text
from ndtorch_train.reproduce.outcome import Claim, Outcome

COLORS = {
    "holds": ("#0072b2", "✓"),
    "partly": ("#b07800", "◐"),
    "does not hold": ("#c0392b", "✗"),
    "not run in quick": ("#777777", "○"),
}
"""Color and mark of every verdict; the mark tells it without the color."""

BEGIN, END = "<!-- claims: begin -->", "<!-- claims: end -->"


class Entry(NamedTuple):
    """A claim with what came out, its figures `[{name, title, caption, parameters}]`, and the folder they are in."""

    claim: Claim
    outcome: Outcome
    parameters: dict[str, Any]
    drawings: list[dict[str, Any]]
    place: Path | None


def not_run(claim: Claim) -> Entry:
    """A claim that has no quick form."""
    outcome = Outcome("-", "not run in quick", "Takes too long for --quick; run without it.")
    return Entry(claim, outcome, {}, [], None)


def publish(entries: Sequence[Entry], out: Path, quick: bool, command: str) -> None:
    """Write index.html, claims.json and figures/ into `out`."""
    figures = out / "figures"
    figures.mkdir(parents=True, exist_ok=True)
    for entry in entries:
        for drawing in entry.drawings:
            for kind in ("svg", "png"):
                assert entry.place is not None
                shutil.copyfile(entry.place / f"{drawing['name']}.{kind}", figures / f"{drawing['name']}.{kind}")
    data = {"quick": quick, "command": command, "claims": [as_json(entry) for entry in entries]}
    write_text(out / "claims.json", json.dumps(data, indent=1, ensure_ascii=False) + "\n")
    write_text(out / "index.html", page(entries, quick, command))


def as_json(entry: Entry) -> dict[str, Any]:
    """A claim as claims.json has it."""
    claim, outcome = entry.claim, entry.outcome
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
    }


def tally(entries: Sequence[Entry]) -> str:
    """How many claims hold."""
    counts = {verdict: sum(e.outcome.verdict == verdict for e in entries) for verdict in COLORS}
    return ", ".join(f"{n} {verdict}" for verdict, n in counts.items() if n)


def markdown(entries: Sequence[Entry], quick: bool, command: str) -> str:
    """The table of claims for a README."""

    def cell(text: str) -> str:
        return text.replace("|", "\\|").replace("\n", " ")

    lines = [
        f"Written by `{command}`: {tally(entries)}." + (" A quick run: fewer or shorter trials." if quick else ""),
        "",
        "| | claim | printed | ours | tolerance | verdict | why |",
        "|---|---|---|---|---|---|---|",
    ]
    for claim, outcome, *_ in entries:
        cells = [f"{claim.text} [{claim.source}]", claim.printed, outcome.ours, claim.tolerance]
        verdict = f"**{outcome.verdict}**" if outcome.verdict != "holds" else "holds"
        lines.append(f"| {claim.id} | {' | '.join(map(cell, cells))} | {verdict} | {cell(outcome.why)} |")
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
    rows = "\n".join(table_row(entry) for entry in entries)
    sections = "\n".join(section(entry) for entry in entries if entry.drawings)
    remark = "<p class='quick'>Quick run: fewer or shorter trials; some claims were not run.</p>" if quick else ""
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>ndtorch: published results, reproduced</title><style>{STYLE}</style></head><body>
<h1>Published results, reproduced</h1>
<p>Northcutt (2016), papers A (range estimation and mapping), B and C (visual binding), drawn again by
<code>{html.escape(command)}</code>. {html.escape(tally(entries))}.</p>{remark}
<div class="wide"><table><thead><tr><th>id</th><th>claim</th><th>printed</th><th>ours</th><th>tolerance</th>
<th>verdict</th><th>why</th></tr></thead><tbody>
{rows}
</tbody></table></div>
{sections}
</body></html>
"""


def table_row(entry: Entry) -> str:
    """One claim of the table."""
    claim, outcome = entry.claim, entry.outcome
    color, mark = COLORS[outcome.verdict]
    name = f'<a href="#{claim.id}">{claim.id}</a>' if entry.drawings else claim.id
    text = f"{html.escape(claim.text)} <small>[{html.escape(claim.source)}]</small>"
    cells = [claim.printed, outcome.ours, claim.tolerance]
    return (
        f"<tr><td>{name}</td><td>{text}</td>"
        + "".join(f"<td>{html.escape(cell)}</td>" for cell in cells)
        + f'<td class="verdict" style="background:{color}">{mark} {outcome.verdict}</td>'
        + f"<td>{html.escape(outcome.why)}</td></tr>"
    )


def section(entry: Entry) -> str:
    """The figures of a claim."""
    claim, outcome = entry.claim, entry.outcome
    color, mark = COLORS[outcome.verdict]
    parts = [
        f'<h2 id="{claim.id}">{claim.id}: {html.escape(claim.text)} <span style="background:{color}">{mark} '
        f"{outcome.verdict}</span></h2><p>{html.escape(outcome.ours)}. {html.escape(outcome.why)}</p>"
    ]
    for drawing in entry.drawings:
        given = ", ".join(f"{key} = {value}" for key, value in drawing["parameters"].items())
        parts.append(
            f'<figure><img src="{picture(entry, drawing["name"])}" alt="{html.escape(drawing["caption"])}">'
            f"<figcaption><b>After {html.escape(drawing['title'])}.</b> {html.escape(drawing['caption'])} "
            f"<small>{html.escape(given)}</small></figcaption></figure>"
        )
    return "\n".join(parts)


def picture(entry: Entry, name: str) -> str:
    """A figure as a data address: the drawing, or the pixels where they are smaller."""
    assert entry.place is not None
    svg, png = ((entry.place / f"{name}.{kind}").read_bytes() for kind in ("svg", "png"))
    data, kind = (svg, "svg+xml") if len(svg) <= 3 * len(png) else (png, "png")
    return f"data:image/{kind};base64,{base64.b64encode(data).decode()}"


STYLE = """
:root { color-scheme: light dark; --back: #fff; --ink: #1c1c1c; --line: #ccc; --soft: #f4f4f4; }
@media (prefers-color-scheme: dark) { :root { --back: #16181a; --ink: #e4e4e4; --line: #444; --soft: #202327; } }
body { background: var(--back); color: var(--ink); font: 15px/1.45 system-ui, sans-serif; margin: 2rem auto;
  max-width: 78rem; padding: 0 1rem; }
h2 { margin-top: 2.5rem; font-size: 1.15rem; } h2 span { color: #fff; border-radius: 4px; padding: .1rem .5rem;
  font-size: .85rem; font-weight: normal; }
.wide { overflow-x: auto; } table { border-collapse: collapse; font-size: 13px; line-height: 1.3; }
th, td { border: 1px solid var(--line); padding: .35rem .5rem; text-align: left; vertical-align: top; }
th { background: var(--soft); } td.verdict { color: #fff; white-space: nowrap; } a { color: inherit; }
figure { margin: 1rem 0 1.5rem; } figure img { background: #fff; max-width: 100%; border: 1px solid var(--line);
  border-radius: 4px; padding: 6px; box-sizing: border-box; } figcaption { font-size: 13px; margin-top: .3rem; }
small { opacity: .75; } .quick { border-left: 4px solid #b07800; padding-left: .7rem; }
"""
