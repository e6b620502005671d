"""`ndtorch reproduce`: tries the claims and writes a page, the figures and a Markdown table."""

from __future__ import annotations

import functools
import json
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from ndtorch.errors import InputError
from ndtorch_train.benchmark.base import Benchmark, Column, Row, Task
from ndtorch_train.benchmark.command import Options

if TYPE_CHECKING:
    from ndtorch.report.page import Shown

BEGIN, END = "<!-- claims: begin -->", "<!-- claims: end -->"
"""Marks in a Markdown file between which `--table` writes."""

COLUMNS = [Column(key, key) for key in ("id", "claim", "printed", "ours", "tolerance", "verdict", "why")]


@dataclass(frozen=True)
class Reproduce(Options):
    """Reproduce the published results: every claim of the three papers, or those named (A1 to C12).

    Writes report.html, a page with the table of claims and all figures that opens offline, claims.csv, claims.md, all
    numbers (rows.jsonl), and the figures as SVG and PNG. A stopped run continues.
    """

    ids: Annotated[tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="[ID ...]")] = ()
    """Claims, for instance B5 C7; all of them by default."""
    quick: bool = False
    """Fewer and shorter trials, under two minutes; claims without a quick form are left out."""
    table: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Markdown file that gets the table of claims, between its marks."""

    def benchmark(self) -> Benchmark:
        """The claims."""
        from ndtorch_train.reproduce.claims import chosen

        claims = [claim for claim in chosen(self.ids) if not self.quick or claim.quick is not None]
        if not claims:
            raise InputError(f"{', '.join(self.ids)} cannot be tried with --quick, which would take too long")
        tasks = [
            Task(f"{claim.id}{', quick' * self.quick}", functools.partial(measure, claim.id, self.quick))
            for claim in claims
        ]
        note = "Northcutt (2016): A range estimation and mapping, B and C visual binding." + (
            " A quick run: fewer or shorter trials." * self.quick
        )
        return Benchmark("claims", "Published results, reproduced", note, COLUMNS, tasks, draw=drawings)

    def run(self) -> int:
        """Try the claims; returns the exit code."""
        made = self.benchmark()
        out = self.out or Path("out/reproduce")
        if self.fresh:
            shutil.rmtree(out / "data", ignore_errors=True)
        result = self.measure(made, out)
        verdicts = [row["verdict"] for row in result.rows]
        counts = {verdict: verdicts.count(verdict) for verdict in ("holds", "partly", "does not hold")}
        tally = f"Of {len(verdicts)} claims {', '.join(f'{n} {verdict}' for verdict, n in counts.items() if n)}."
        if self.table is not None:
            put_table(self.table, f"{tally} {result.text}\n")
        return result._replace(text=f"{result.text}\n\n{tally}").report(self.json)


def measure(name: str, quick: bool, folder: Path) -> list[Row]:
    """The row of one claim."""
    from ndtorch_train.reproduce.claims import chosen
    from ndtorch_train.reproduce.experiment import Context

    (claim,) = chosen([name])
    context = Context(folder)
    options = dict(claim.quick or {}) if quick else {}
    outcome = claim.run(context, **options)
    row: dict[str, Any] = {
        **{"id": name, "claim": f"{claim.text} [{claim.source}]", "printed": claim.printed, "ours": outcome.ours},
        **{"tolerance": claim.tolerance, "verdict": outcome.verdict, "why": outcome.reasons},
        **{"criteria": dict(outcome.criteria), "numbers": outcome.numbers, "figures": context.figures},
    }
    return [json.loads(json.dumps(row, default=lambda array: array.tolist()))]


def drawings(rows: list[Row], folder: Path) -> list[Shown]:
    """The figures of all claims."""
    from ndtorch.report.page import Shown

    return [
        Shown(folder / "figures" / f"{name}.png", f"{row['id']}: after {title}", f"{caption} {row['ours']}.")
        for row in rows
        for name, title, caption in row["figures"]
    ]


def put_table(path: Path, table: str) -> None:
    """Put the table between the marks of a Markdown file, or at its end where it has none."""
    text = path.read_text(encoding="utf-8") if path.exists() else ""
    before, _, rest = text.partition(BEGIN)
    after = rest.partition(END)[2]
    path.write_text(f"{before}{BEGIN}\n{table}{END}{after or chr(10)}", encoding="utf-8")
