"""`ndtorch reproduce`: runs the claims and writes a page, JSON and a Markdown table."""

from __future__ import annotations

import base64
import functools
import json
import shutil
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from ndtorch.errors import InputError
from ndtorch.utils.workers import Report, cores, run_tasks

if TYPE_CHECKING:
    from ndtorch_train.reproduce.experiment import Claim, Entry

COLORS = {
    "holds": ("#0072b2", "✓"),
    "partly": ("#b07800", "◐"),
    "does not hold": ("#c0392b", "✗"),
    "not run in quick": ("#777777", "○"),
}
"""Color and mark of every verdict."""

BEGIN, END = "<!-- claims: begin -->", "<!-- claims: end -->"
"""Marks in a Markdown file between which `--table` writes."""


@dataclass(frozen=True)
class Reproduce:
    """Reproduce the published results: every claim of the three papers, or those named (A1 to C9).

    Writes report.html, a page with the table of claims and all figures that opens offline, claims.json, and the
    figures as SVG and PNG. A stopped run continues: results with the same parameters and version are kept.
    """

    ids: Annotated[tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="[ID ...]")] = ()
    """Claims, for instance B5 C7; all of them by default."""
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("out/reproduce")
    """Folder to write to."""
    quick: bool = False
    """Fewer and shorter trials, under two minutes; claims without a quick form are left out."""
    jobs: int | None = None
    """Processes (default: one for each core)."""
    table: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Markdown file that gets the table of claims, between its marks."""
    clip: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Video of a road camera for claim B9."""
    fresh: bool = False
    """Compute every claim anew."""
    open: bool = False
    """Show report.html in the browser."""
    json: bool = False
    """Print claims.json and nothing else."""

    def run(self) -> int:
        """Run the claims; returns the exit code."""
        from ndtorch.report.page import NAME, open_in_browser
        from ndtorch_train.reproduce.claims import chosen
        from ndtorch_train.reproduce.experiment import load_result

        claims = chosen(self.ids)
        if self.clip is not None:
            if not self.clip.is_file():
                raise InputError(f"--clip {self.clip}: no such file")
            clip = str(self.clip)
            claims = [replace(c, full={**c.full, "clip": clip}) if "clip" in c.full else c for c in claims]
        jobs = cores() if self.jobs is None else self.jobs
        if jobs < 1:
            raise InputError(f"--jobs must be at least 1, got {jobs}")
        try:
            if self.fresh:
                shutil.rmtree(self.out / "results", ignore_errors=True)
                shutil.rmtree(self.out / "data", ignore_errors=True)
            self.out.mkdir(parents=True, exist_ok=True)
            todo = [claim for claim in claims if load_result(claim, self.quick, self.out) is None]
            failed = compute(todo, self.quick, jobs, self.out)
            entries = [entry for claim in claims if (entry := load_result(claim, self.quick, self.out)) is not None]
            command = " ".join(["ndtorch reproduce", *self.ids, *(["--quick"] if self.quick else [])])
            publish(entries, self.out, self.quick, command)
            if self.table is not None:
                put_table(self.table, markdown(entries, self.quick, command))
        except OSError as error:
            raise InputError(f"{error.filename or self.out} cannot be written: {error.strerror}") from None
        if self.json:
            print((self.out / "claims.json").read_text(encoding="utf-8").strip())
        else:
            for entry in entries:
                print(f"{entry.claim.id:4}{entry.outcome.verdict:17}{entry.outcome.ours}")
            print(f"{tally(entries)}; written to {self.out / NAME}")
        if self.open:
            open_in_browser(self.out / NAME)
        for name, why in failed.items():
            print(f"error: {name} could not be tried: {why.strip()}", file=sys.stderr)
        return 1 if failed else 0


def compute(claims: Sequence[Claim], quick: bool, jobs: int, out: Path) -> dict[str, str]:
    """Run experiments in `jobs` processes with a progress bar; returns why claims failed, by claim."""
    from ndtorch.run.progress import progress_bar

    ordered = sorted(claims, key=lambda claim: claim.seconds, reverse=True)
    failed: dict[str, str] = {}
    with progress_bar(len(ordered), desc="claims") as bar:
        for kind, index, value in run_tasks(functools.partial(_task, quick=quick, out=out), ordered, jobs):
            if kind == "failed":
                failed[ordered[index].id] = str(value)
            if kind in ("done", "failed"):
                bar.update()
    return failed


def _task(claim: Claim, report: Report, *, quick: bool, out: Path) -> None:
    from ndtorch_train.reproduce.experiment import run_claim

    run_claim(claim, quick, out)


def publish(entries: Sequence[Entry], out: Path, quick: bool, command: str) -> None:
    """Write report.html, claims.json and figures/ into `out`."""
    from ndtorch.report.page import NAME, render, versions

    figures = out / "figures"
    figures.mkdir(exist_ok=True)
    for entry in entries:
        for drawing in entry.drawings:
            for kind in ("svg", "png"):
                shutil.copy(entry.folder / f"{drawing['name']}.{kind}", figures)
    data = {"quick": quick, "command": command, "claims": [as_json(entry) for entry in entries]}
    (out / "claims.json").write_text(json.dumps(data, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    page = render(
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
    (out / NAME).write_text(page, encoding="utf-8")


def as_json(entry: Entry) -> dict[str, object]:
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
    """How many claims hold, in words."""
    verdicts = [entry.outcome.verdict for entry in entries]
    counts = [f"{verdicts.count(verdict)} {verdict}" for verdict in COLORS if verdict in verdicts]
    return f"of {len(verdicts)} claims {', '.join(counts)}"


def markdown(entries: Sequence[Entry], quick: bool, command: str) -> str:
    """The table of claims for a Markdown page; the report names the criteria that were not met."""
    lines = [
        f"Written by `{command}`: {tally(entries)}." + (" A quick run: fewer or shorter trials." if quick else ""),
        "",
        "| | claim | printed | ours | tolerance | verdict | why |",
        "|---|---|---|---|---|---|---|",
    ]
    for entry in entries:
        claim, outcome = entry.claim, entry.outcome
        verdict = outcome.verdict if outcome.verdict == "holds" else f"**{outcome.verdict}**"
        why = outcome.why.partition("Not met: ")[0].strip()
        cells = [f"{claim.text} [{claim.source}]", claim.printed, outcome.ours, claim.tolerance, verdict, why]
        cells = [cell.replace("|", "\\|").replace("\n", " ") for cell in cells]
        lines.append(f"| {claim.id} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def put_table(path: Path, table: str) -> None:
    """Put the table between the marks of a Markdown file, or at its end where it has none."""
    text = path.read_text(encoding="utf-8") if path.exists() else ""
    if BEGIN in text and END in text:
        before, rest = text.split(BEGIN, 1)
        text = f"{before}{BEGIN}\n{table}{END}{rest.split(END, 1)[1]}"
    else:
        text = f"{text.rstrip()}\n\n{BEGIN}\n{table}{END}\n".lstrip()
    path.write_text(text, encoding="utf-8")


def data_address(entry: Entry, name: str) -> str:
    """A figure as a data address: the drawing, or the pixels where they are smaller."""
    svg, png = ((entry.folder / f"{name}.{kind}").read_bytes() for kind in ("svg", "png"))
    data, kind = (svg, "svg+xml") if len(svg) <= 3 * len(png) else (png, "png")
    return f"data:image/{kind};base64,{base64.b64encode(data).decode()}"
