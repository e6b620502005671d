"""`ndtorch reproduce`."""

from __future__ import annotations

import functools
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from ndtorch.errors import InputError
from ndtorch.run.folder import place_for
from ndtorch.utils.workers import Report, cores, run_tasks

if TYPE_CHECKING:
    from ndtorch_train.reproduce.experiment import Claim
    from ndtorch_train.reproduce.page import Entry


@dataclass(frozen=True)
class Reproduce:
    """Reproduce the published results: every claim of the three papers, or those named (A1 to C9).

    Writes report.html, a page with the table of claims and all figures that opens offline, claims.json, and the
    figures as SVG and PNG. Results are kept: a run that was stopped goes on where it was. With other options or other
    code it writes into a new folder, reproduce-2, and computes only the claims whose code or parameters have changed.
    """

    ids: Annotated[tuple[str, ...], tyro.conf.Positional] = ()
    """Claims, for instance B5 C7; none for all."""
    out: Path = Path("out/reproduce")
    """Folder to write to."""
    force: bool = False
    """Write into this folder whatever is in it."""
    quick: bool = False
    """Fewer and shorter trials, under two minutes; claims that need more are left out and say so."""
    jobs: int | None = None
    """Processes (default: one for every core this process may use)."""
    table: Path | None = None
    """Also put the table of claims into this Markdown file, between its marks."""
    clip: Path | None = None
    """Video of a road camera that B9 uses too."""
    fresh: bool = False
    """Use no result of an earlier run; write into a new folder."""
    open: bool = False
    """Show report.html in the browser when it is written."""
    json: bool = False
    """Print what claims.json holds and nothing else."""

    def run(self) -> int:
        """Do it; returns the exit code."""
        from ndtorch.report.page import NAME, open_in_browser
        from ndtorch_train.reproduce.claims import chosen
        from ndtorch_train.reproduce.experiment import code_of, with_better
        from ndtorch_train.reproduce.page import markdown, publish, put_table, tally

        claims = chosen(self.ids)
        if self.clip is not None:
            if not self.clip.is_file():
                raise InputError(f"--clip {self.clip}: no such file")
            claims = [looking_at(claim, self.clip) for claim in claims]
        jobs = cores() if self.jobs is None else self.jobs
        if jobs < 1:
            raise InputError(f"--jobs must be at least 1, got {jobs}")
        tried = with_better(claims)
        made_by = {claim.id: [code_of(claim.uses), claim.parameters(self.quick)] for claim in tried}
        settings = {"command": "reproduce", "quick": self.quick, "claims": made_by}
        place = place_for(self.out, settings, self.fresh, self.force)
        place.take_over("cache")
        out = place.folder
        try:
            entries, failed = self.collect(claims, jobs, out)
            publish(entries, out, self.quick, self.words())
            if self.table is not None:
                put_table(self.table, markdown(entries, self.quick, self.words()))
        except OSError as error:
            raise InputError(f"{error.filename or out} cannot be written: {error.strerror}") from None
        if self.json:
            print((out / "claims.json").read_text(encoding="utf-8").strip())
        else:
            for entry in entries:
                print(f"{entry.claim.id:4}{entry.outcome.verdict:17}{entry.outcome.ours}")
                if entry.better is not None:
                    claim, outcome, *_ = entry.better
                    print(f"{claim.id:4}{outcome.verdict:17}{claim.parts}: {outcome.ours}")
            print(f"{tally(entries)}; written to {out / NAME}")
        if self.open:
            open_in_browser(out / NAME)
        for name, why in failed.items():
            print(f"error: {name} could not be tried: {why.strip()}", file=sys.stderr)
        return 1 if failed else 0

    def words(self) -> str:
        """The command, for the page."""
        parts = ["ndtorch reproduce", *self.ids]
        return " ".join([*parts, "--quick"] if self.quick else parts)

    def collect(self, claims: Sequence[Claim], jobs: int, out: Path) -> tuple[list[Entry], dict[str, str]]:
        """Results of all claims, from the cache or computed now, and why some could not be had."""
        from ndtorch.utils.signals import parts_kept
        from ndtorch_train.reproduce.experiment import ResultCache, with_better
        from ndtorch_train.reproduce.page import Entry, not_run

        store = ResultCache(out / "cache")
        store.folder.mkdir(exist_ok=True)
        todo, other_code = [], []
        wanted = [claim for claim in with_better(claims) if claim.parameters(self.quick) is not None]
        for claim in wanted:
            result, outdated = store.load(claim, self.quick)
            if result is None:
                todo.append(claim)
            if outdated:
                other_code.append(claim.id)
        if other_code:
            print(f"note: results of {', '.join(other_code)} are of other code and not used", file=sys.stderr)

        def finished() -> int:
            return sum(store.load(claim, self.quick)[0] is not None for claim in wanted)

        with parts_kept(out, "results", len(wanted), finished):
            failed = compute(todo, self.quick, jobs, store.folder)

        def entry(claim: Claim) -> Entry | None:
            """What is known of a claim; None if it could not be tried."""
            better = None if claim.better is None else entry(claim.better)
            if claim.parameters(self.quick) is None:
                return not_run(claim)._replace(better=better)
            result, _ = store.load(claim, self.quick)
            if result is None:
                return None
            place = store.place(claim, self.quick)
            return Entry(claim, result["outcome"], result["parameters"], result["drawings"], place, better)

        return [found for found in map(entry, claims) if found is not None], failed


def compute(claims: Sequence[Claim], quick: bool, jobs: int, folder: Path) -> dict[str, str]:
    """Run experiments in `jobs` processes with a progress bar; returns why claims failed, by claim."""
    if not claims:
        return {}
    from ndtorch.run.progress import progress_bar
    from ndtorch_train.reproduce.experiment import code_of

    def cost(claim: Claim) -> float:
        return claim.seconds[1 if quick else 0]

    ordered = sorted(claims, key=cost, reverse=True)  # long ones first, so that no core waits at the end
    shares = [0.0] * len(ordered)
    failed: dict[str, str] = {}
    form = "{desc} {percentage:3.0f}% |{bar}| {elapsed} gone, {remaining} left{postfix}"
    with progress_bar(sum(map(cost, ordered)), desc="claims", bar_format=form) as bar:
        tasks = [(claim, code_of(claim.uses)) for claim in ordered]
        for kind, index, value in run_tasks(functools.partial(_task, quick=quick, folder=folder), tasks, jobs):
            claim = ordered[index]
            if kind == "progress":
                new = max(shares[index], min(float(value), 0.99))
            elif kind == "again":
                words = f"note: the process of {claim.id} died ({value}); {claim.id} is run again"
                bar.write(words, file=sys.stderr)
                continue
            else:
                new = 1.0
                if kind == "failed":
                    failed[claim.id] = str(value)
            bar.update((new - shares[index]) * cost(claim))
            shares[index] = new
            bar.set_postfix_str(f"{sum(s == 1.0 for s in shares)} of {len(shares)} done")
    return failed


def _task(task: tuple[Claim, str], report: Report, *, quick: bool, folder: Path) -> None:
    """One experiment and the fingerprint of its code, in a process of its own."""
    from ndtorch.utils.tensors import tune_allocator
    from ndtorch_train.reproduce.experiment import run_claim

    tune_allocator()
    try:
        run_claim(task[0], quick, folder, task[1], report)
    except (BrokenPipeError, ConnectionResetError):
        raise  # the reader is gone
    except OSError as error:
        raise InputError(f"{error.filename or folder} cannot be written: {error.strerror}") from None


def looking_at(claim: Claim, clip: Path) -> Claim:
    """The claim on this clip too, if it is one of video."""
    if "clip" not in claim.full:
        return claim
    better = None if claim.better is None else looking_at(claim.better, clip)
    return replace(claim, full=dict(claim.full) | {"clip": str(clip)}, better=better)
