"""`ndtorch sweep`."""

from __future__ import annotations

import functools
import itertools
import json
import shutil
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from ndtorch.errors import InputError
from ndtorch.utils.files import TABLE_BYTES, read_text, replacing, write_text
from ndtorch.utils.workers import Event, Report, cores, run_tasks

if TYPE_CHECKING:
    from ndtorch_train.rows import Row, RowStore
    from ndtorch_train.sweep.config import SweepConfig
    from ndtorch_train.sweep.parameters import Trial

KEPT = "rows.jsonl"
"""Rows of finished trials."""


@dataclass(frozen=True)
class Sweep:
    """Run many trials: a grid or random sweep of binding or driving, described in a TOML file.

    Writes results.parquet (a row a trial), summary.md and heat maps. A sweep that was stopped goes on where it was. One
    whose file or code has changed writes into a new folder, NAME-2, and takes over the trials that are the same. Two
    sweeps are included: `binding` and `maps`.
    """

    config: Annotated[Path, tyro.conf.Positional]
    """TOML file (its keys are described in train/README.md), or the name of an included sweep."""
    out: Path | None = None
    """Folder to write to (default: out/sweep/ and the name of the file)."""
    force: bool = False
    """Write into this folder whatever is in it."""
    jobs: int | None = None
    """Processes (default: one for every core this process may use)."""
    cluster: tuple[str, ...] | None = None
    """Run on a Ray cluster: its address, or none to start one on this machine. Needs ndtorch-train[cluster]."""
    compare: int = 0
    """Number of trials that are run one at a time afterwards, to print how much faster a batch is."""
    fresh: bool = False
    """Begin in a new folder: use no earlier results."""
    json: bool = False
    """Print what summary.json holds and nothing else."""

    def run(self) -> int:
        """Do it; returns the exit code."""
        from ndtorch.run.folder import place_for
        from ndtorch.utils.packages import code_digest, toml_file
        from ndtorch.utils.signals import parts_kept
        from ndtorch_train.rows import RowStore
        from ndtorch_train.sweep.config import module_of, read_sweep
        from ndtorch_train.sweep.parameters import trial_id

        if self.cluster is not None and len(self.cluster) > 1:
            raise InputError(f"--cluster takes one address, got {' '.join(self.cluster)}")
        config = read_sweep(toml_file(self.config, "ndtorch_train", "sweeps"))
        jobs = cores() if self.jobs is None else self.jobs
        if jobs < 1:
            raise InputError(f"--jobs must be at least 1, got {jobs}")
        module = module_of(config.kind)
        code = code_digest(module.USES)[:12]
        settings = {"command": "sweep", "trials": sorted(map(trial_id, config.trials)), "show": config.show}
        wanted = self.out or Path("out/sweep") / config.name
        place = place_for(wanted, settings | {"code": code}, self.fresh, self.force)
        out = place.folder
        try:
            if place.before is not None and (place.before / KEPT).is_file() and not (out / KEPT).exists():
                shutil.copy(place.before / KEPT, out / KEPT)
            store = RowStore(out / KEPT)
            done = {name for name, (row,) in store.rows.items() if row["code"] == code}
            if len(done) < len(store.rows):
                note(f"{len(store.rows) - len(done)} trials in {out} are of other code and not used")
            if store.damaged:
                note(f"{store.damaged} lines of {out / KEPT} are damaged; their trials are run again")
            names = {trial_id(trial) for trial in config.trials}
            todo = [trial for trial in config.trials if trial_id(trial) not in done]
            if len(todo) < len(config.trials):
                finished = f"{len(config.trials) - len(todo)} of {len(config.trials)} trials were finished before"
                print(finished, file=sys.stderr if self.json else sys.stdout)
            began = time.perf_counter()
            with parts_kept(out, "trials", len(config.trials), lambda: len(store.rows.keys() & names)):
                failed = self.work(config, todo, module, jobs, store, code)
            seconds = time.perf_counter() - began
            found = store.load()
            rows = [found[name][0] for name in map(trial_id, config.trials) if name in found]
            file = out / "summary.json"
            # Where nothing was left to compute, the summary of the run that computed it stays.
            before = {} if todo else earlier_summary(file)
            report: dict[str, Any] = {"trials": len(rows), "computed now": len(todo), "seconds": round(seconds, 2)}
            if todo and not failed:
                report["trials per second"] = round(len(todo) / seconds, 2)
            if before.get("trials") == len(rows):
                report = dict(before)
            if self.compare:
                report |= one_at_a_time(config, module, min(self.compare, len(config.trials)))
            write_results(config, rows, module.RESULTS, out)
            if report != before:
                write_text(file, json.dumps(report, indent=1) + "\n")
        except OSError as error:
            raise InputError(f"{error.filename or out} cannot be written: {error.strerror or error}") from None
        if self.json:
            print(json.dumps(report))
        else:
            print(", ".join(f"{key} {value}" for key, value in report.items()))
            print(f"written to {out}: results.parquet summary.md summary.json heatmap-*.svg heatmap-*.png")
        for why in sorted(set(failed)):
            print(f"error: {failed.count(why)} blocks of trials failed: {why.strip()}", file=sys.stderr)
        return 1 if failed else 0

    def work(
        self, config: SweepConfig, todo: Sequence[Trial], module: ModuleType, jobs: int, store: RowStore, code: str
    ) -> list[str]:
        """Run the trials and keep every block's results as it comes; returns why blocks failed."""
        if not todo:
            return []
        from ndtorch.run.progress import progress_bar
        from ndtorch_train.sweep.parameters import trial_id

        blocks = module.blocks(todo, jobs)
        failed: list[str] = []
        with progress_bar(len(todo), desc=config.name, unit=" trials") as bar:
            for kind, index, value in self.events(config, blocks, jobs):
                if kind == "done":
                    rows = [
                        {"trial": trial_id(trial), **trial, **result, "code": code}
                        for trial, result in zip(blocks[index], value, strict=True)
                    ]
                    store.add({row["trial"]: [row] for row in rows})
                    bar.update(len(blocks[index]))
                elif kind == "again":
                    again = f"its {len(blocks[index])} trials are run again"
                    bar.write(f"note: a process died ({value}); {again}", file=sys.stderr)
                elif kind == "failed":
                    failed.append(str(value))
        return failed

    def events(self, config: SweepConfig, blocks: Sequence[Sequence[Trial]], jobs: int) -> Iterator[Event]:
        """Events of local processes or of a cluster."""
        if self.cluster is None:
            yield from run_tasks(functools.partial(local_block, kind=config.kind, device=config.device), blocks, jobs)
        else:
            from ndtorch_train.sweep.cluster import run_on_ray

            function = functools.partial(any_block, kind=config.kind, device=config.device)
            yield from run_on_ray(function, blocks, self.cluster[0] if self.cluster else None, jobs)


def note(words: str) -> None:
    """Say what is not as expected."""
    print(f"note: {words}", file=sys.stderr)


def write_results(config: SweepConfig, rows: Sequence[Row], results: Sequence[str], folder: Path) -> None:
    """Write results.parquet (a row a trial), summary.md, and the heat maps as SVG and PNG."""
    import pyarrow
    import pyarrow.parquet

    from ndtorch_train.plots import draw_heat_map

    with replacing(folder / "results.parquet") as beside:
        pyarrow.parquet.write_table(pyarrow.Table.from_pylist(list(rows)), beside)
    write_text(folder / "summary.md", summary(config, rows, results))
    for value in config.show[3] if rows else ():
        for kind in ("svg", "png"):
            draw_heat_map(list(rows), config.show[:3], value, config.name, folder / f"heatmap-{value}.{kind}")


def summary(config: SweepConfig, rows: Sequence[Row], results: Sequence[str]) -> str:
    """A Markdown table: means of every result for every value of every parameter that varies, of few values."""
    import numpy as np

    from ndtorch_train.plots import short

    lines = [f"# {config.name}", "", f"{len(rows)} trials; means over all other parameters.", ""]
    lines += [f"| | | trials | {' | '.join(results)} |", f"|---|---|---|{'---|' * len(results)}"]
    for key in config.varied:
        values = sorted({row[key] for row in rows})
        if len(values) > 32:  # of a random sweep: by tenths
            edges = np.quantile([row[key] for row in rows], np.linspace(0, 1, 11))
            groups = [
                (f"{a:.3g}..{b:.3g}", [r for r in rows if a <= r[key] <= b]) for a, b in itertools.pairwise(edges)
            ]
        else:
            groups = [(short(value), [r for r in rows if r[key] == value]) for value in values]
        for name, group in groups:
            cells = []
            for result in results:
                known = [float(r[result]) for r in group if r[result] is not None]
                cells.append(f"{np.mean(known):.3g}" if known else "-")
            lines.append(f"| {key} | {name} | {len(group)} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def earlier_summary(file: Path) -> dict[str, Any]:
    """The summary of an earlier run; empty where there is none that can be read."""
    try:
        found = json.loads(read_text(file, TABLE_BYTES))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def any_block(trials: Sequence[Trial], *, kind: str, device: str) -> list[dict[str, Any]]:
    """Results of a block of trials."""
    from ndtorch.utils.tensors import tune_allocator
    from ndtorch_train.sweep.config import module_of

    tune_allocator()
    found: list[dict[str, Any]] = module_of(kind).run_block(trials, device)
    return found


def local_block(trials: Sequence[Trial], report: Report, *, kind: str, device: str) -> list[dict[str, Any]]:
    """The same, as a task of `ndtorch.utils.workers`."""
    return any_block(trials, kind=kind, device=device)


def one_at_a_time(config: SweepConfig, module: ModuleType, count: int) -> dict[str, Any]:
    """Run evenly chosen trials alone and together, in this process, and compare time and results."""
    import torch

    torch.set_num_threads(1)
    step = len(config.trials) / count
    chosen = [config.trials[int(k * step)] for k in range(count)]

    def timed(blocks: Sequence[Sequence[Trial]]) -> tuple[float, list[dict[str, Any]]]:
        start = time.perf_counter()
        found = [result for block in blocks for result in module.run_block(block, config.device)]
        return (time.perf_counter() - start) / len(found), found

    timed([chosen[:1]])  # what is made once
    slow, alone = timed([[trial] for trial in chosen])
    fast, _ = timed([max(module.blocks(config.trials, 1), key=len)])
    parts = module.blocks(chosen, 1)
    together = dict(zip((id(trial) for part in parts for trial in part), timed(parts)[1], strict=True))
    pairs = [(together[id(trial)], result) for trial, result in zip(chosen, alone, strict=True)]
    first = module.RESULTS[0]
    return {
        "one at a time, trials per second": round(1 / slow, 2),
        "together, one process, trials per second": round(1 / fast, 2),
        "ratio": round(slow / fast, 1),
        "trials whose last digits differ": sum(one != other for one, other in pairs),
        f"trials whose {first} differs": sum(one[first] != other[first] for one, other in pairs),
    }
