"""`ndtorch sweep`: reads a sweep from a TOML file, runs its trials and writes tables and heat maps."""

from __future__ import annotations

import functools
import itertools
import json
import math
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
import tyro
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from ndtorch.errors import InputError, did_you_mean
from ndtorch.utils.packages import need, toml_file
from ndtorch.utils.toml import toml_values
from ndtorch.utils.workers import Event, Report, cores, run_tasks

if TYPE_CHECKING:
    import pandas

    from ndtorch_train.sweep.trials import Trial

MOST = 1_000_000
"""Largest number of trials of one sweep."""


class Span(BaseModel):
    """A range of values; `steps` of a grid."""

    model_config = ConfigDict(extra="forbid")
    low: float = Field(alias="from")
    high: float = Field(alias="to")
    steps: Annotated[int, Field(ge=1, le=MOST)] | None = None
    scale: Literal["linear", "log"] = "linear"


class Show(BaseModel):
    """Parameters along x, along y and from panel to panel, and the results to draw."""

    model_config = ConfigDict(extra="forbid")
    x: str = ""
    y: str = ""
    panels: str = ""
    values: tuple[str, ...] = ()


class SweepConfig(BaseModel):
    """The contents of a sweep's file."""

    model_config = ConfigDict(extra="forbid")
    kind: Literal["binding", "driving"] = "binding"
    method: Literal["grid", "random"] = "grid"
    trials: Annotated[int, Field(ge=0, le=MOST)] = 0
    seed: int = 0
    device: str = "cpu"
    vary: dict[str, list[Any] | Span] = Field(min_length=1)
    fixed: dict[str, Any] = Field(default_factory=dict)
    show: Show = Show()

    def axes(self) -> tuple[str, str, str, tuple[str, ...]]:
        """Parameters along x, y and panels, and results; by default the first three that vary and the first result."""
        from ndtorch_train.sweep.trials import RESULTS

        x, y, panels = (*([self.show.x, self.show.y, self.show.panels] if self.show.x else self.vary), "", "", "")[:3]
        return x, y, panels, self.show.values or RESULTS[self.kind][:1]


def read_sweep(data: Mapping[str, Any], where: str) -> tuple[SweepConfig, list[Trial]]:
    """A sweep and its trials from the values of a TOML file.

    Raises:
        InputError: an unknown key or value, or no trial.
    """
    from ndtorch_train.sweep.trials import KINDS, RESULTS

    try:
        config = SweepConfig.model_validate(dict(data))
        kind = KINDS[config.kind]
        known = [one.name for one in fields(kind)]
        for key in (*config.vary, *config.fixed):
            if key not in known:
                raise InputError(f"{where}: unknown parameter {key!r}{did_you_mean(key, known)}")
        if twice := config.vary.keys() & config.fixed.keys():
            raise InputError(f"{where}: {min(twice)} is both in [vary] and in [fixed]")
        x, y, panels, values = config.axes()
        if strange := {x, y, panels} - {"", *config.vary} or set(values) - set(RESULTS[config.kind]):
            raise InputError(f"{where}: [show] names {min(strange)!r}, which is no parameter that varies or result")
        integers = {one.name for one in fields(kind) if isinstance(one.default, int)}
        choices = combinations(config, integers, where)
        trials = TypeAdapter(list[kind]).validate_python([config.fixed | choice for choice in choices])  # type: ignore[valid-type]
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"] if not isinstance(part, int))
        raise InputError(f"{where}: {place or 'the file'}: {first['msg']}, got {first['input']!r:.60}") from None
    return config, list(dict.fromkeys(trials))


def combinations(config: SweepConfig, integers: set[str], where: str) -> list[dict[str, Any]]:
    """The varied parameters of every trial."""
    if config.method == "grid":
        axes = [grid_values(name, spec, where) for name, spec in config.vary.items()]
        if not 0 < math.prod(map(len, axes)) <= MOST:
            raise InputError(f"{where}: {math.prod(map(len, axes))} trials; 1 to {MOST} are possible")
        return [dict(zip(config.vary, values, strict=True)) for values in itertools.product(*axes)]
    rng = np.random.default_rng(config.seed)
    if not config.trials or not all(config.vary.values()):
        raise InputError(f"{where}: a random sweep needs trials and no empty list in [vary]")

    def draw(name: str, spec: list[Any] | Span) -> Any:
        if isinstance(spec, list):
            return spec[rng.integers(len(spec))]
        if name in integers:
            return int(rng.integers(math.ceil(spec.low), math.floor(spec.high) + 1))
        if spec.scale == "log":
            return math.exp(rng.uniform(math.log(spec.low), math.log(spec.high)))
        return float(rng.uniform(spec.low, spec.high))

    return [{name: draw(name, spec) for name, spec in config.vary.items()} for _ in range(config.trials)]


def grid_values(name: str, spec: list[Any] | Span, where: str) -> list[Any]:
    """Values of a parameter on a grid."""
    if isinstance(spec, list):
        return spec
    if spec.steps is None:
        raise InputError(f"{where}: {name} needs steps")
    if spec.scale == "log" and min(spec.low, spec.high) <= 0:
        raise InputError(f"{where}: {name} must be positive on a logarithmic scale")
    spaced = np.geomspace if spec.scale == "log" else np.linspace
    # Rounded, so that 0.1 is 0.1 in tables and on axes.
    return [float(f"{value:.9g}") for value in spaced(spec.low, spec.high, spec.steps)]


@dataclass(frozen=True)
class Sweep:
    """Run many trials: a grid or random sweep of binding or driving, described in a TOML file.

    Writes results.parquet (a row a trial), summary.md and heat maps. A stopped sweep continues: trials that are in
    results.parquet are not run again. Two sweeps are included: `binding` and `maps`.
    """

    config: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="CONFIG")]
    """TOML file (its keys are described in train/README.md), or the name of an included sweep."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Folder to write to (default: out/sweep/NAME)."""
    jobs: int | None = None
    """Processes (default: one for each core)."""
    cluster: str | None = None
    """Address of a Ray cluster on which ndtorch-train is installed; "local" starts one on this machine."""
    fresh: bool = False
    """Run every trial anew."""
    json: bool = False
    """Print one JSON object and nothing else."""

    def run(self) -> int:
        """Run the trials; returns the exit code."""
        import pandas

        file = toml_file(self.config, "ndtorch_train", "sweeps")
        config, trials = read_sweep(toml_values(file), str(file))
        jobs = cores() if self.jobs is None else self.jobs
        if jobs < 1:
            raise InputError(f"--jobs must be at least 1, got {jobs}")
        out = self.out or Path("out/sweep") / file.stem
        out.mkdir(parents=True, exist_ok=True)
        table, names = out / "results.parquet", [one.name for one in fields(type(trials[0]))]
        rows: dict[Trial, dict[str, Any]] = {}
        if table.is_file() and not self.fresh:
            for row in pandas.read_parquet(table).to_dict("records"):
                rows[type(trials[0])(**{name: row[name] for name in names})] = row
        todo = [trial for trial in trials if trial not in rows]
        began, failed = time.perf_counter(), list[str]()
        for finished, why in self.work(config, file.stem, todo, jobs):
            failed += [why] if why else []
            rows |= finished
            pandas.DataFrame(list(rows.values())).to_parquet(table)
        seconds = time.perf_counter() - began
        frame = pandas.DataFrame([rows[trial] for trial in trials if trial in rows])
        if len(frame):
            write_results(config, file.stem, frame, out)
        report = {"trials": len(frame), "computed_now": len(todo), "seconds": round(seconds, 2), "folder": str(out)}
        print(json.dumps(report) if self.json else ", ".join(f"{key} {value}" for key, value in report.items()))
        for why in sorted(set(failed)):
            print(f"error: {failed.count(why)} blocks of trials failed: {why.strip()}", file=sys.stderr)
        return 1 if failed else 0

    def work(
        self, config: SweepConfig, name: str, todo: Sequence[Trial], jobs: int
    ) -> Iterator[tuple[dict[Trial, dict[str, Any]], str]]:
        """Rows of every block of trials, or why it failed."""
        from ndtorch.run.progress import progress_bar
        from ndtorch_train.sweep.trials import blocks

        parts = blocks(todo, jobs)
        function = functools.partial(local_block, device=config.device)
        events = run_tasks(function, parts, jobs) if self.cluster is None else run_on_ray(parts, self.cluster, config)
        with progress_bar(len(todo), desc=name, unit=" trials") as bar:
            for kind, index, value in events:
                if kind == "done":
                    pairs = zip(parts[index], value, strict=True)
                    yield {trial: asdict(trial) | result for trial, result in pairs}, ""
                    bar.update(len(parts[index]))
                elif kind == "failed":
                    yield {}, str(value)


def local_block(trials: Sequence[Trial], report: Report, *, device: str) -> list[dict[str, Any]]:
    """A block as a task of `ndtorch.utils.workers`."""
    from ndtorch_train.sweep.trials import run_block

    return run_block(trials, device)


def run_on_ray(parts: Sequence[Sequence[Trial]], address: str, config: SweepConfig) -> Iterator[Event]:
    """Run blocks on a Ray cluster; events as of `run_tasks`.

    Raises:
        InputError: Ray is not installed, or no cluster answers.
    """
    from ndtorch_train.sweep.trials import run_block

    ray = need("ray", "--cluster")
    try:
        ray.init(address=None if address == "local" else address, log_to_driver=False, include_dashboard=False)
    except Exception as error:
        raise InputError(f"--cluster {address}: no Ray cluster ({str(error).splitlines()[0]})") from None
    try:
        remote = ray.remote(num_cpus=1)(run_block)
        waiting = {remote.remote(part, config.device): n for n, part in enumerate(parts)}
        while waiting:
            for reference in ray.wait(list(waiting))[0]:
                index = waiting.pop(reference)
                try:
                    yield Event("done", index, ray.get(reference))
                except ray.exceptions.RayError as error:
                    yield Event("failed", index, str(error))
    finally:
        ray.shutdown()


def write_results(config: SweepConfig, name: str, frame: pandas.DataFrame, folder: Path) -> None:
    """Write summary.md, means over all other parameters, and the heat maps."""
    import pandas

    from ndtorch_train.plots import draw_heat_map
    from ndtorch_train.sweep.trials import RESULTS

    lines = [f"# {name}", "", f"{len(frame)} trials; means over all other parameters.", ""]
    results = list(RESULTS[config.kind])
    lines += [f"| | | trials | {' | '.join(results)} |", f"|---|---|---|{'---|' * len(results)}"]
    for key in config.vary:
        values = frame[key]
        groups = values if values.nunique() <= 32 else pandas.qcut(values, 10)
        for value, group in frame.groupby(groups, observed=True):
            cells = [f"{group[result].astype(float).mean():.3g}" for result in results]
            label = f"{value:.4g}" if isinstance(value, float) else value
            lines.append(f"| {key} | {label} | {len(group)} | {' | '.join(cells)} |")
    (folder / "summary.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    x, y, panels, shown = config.axes()
    for value in shown:
        for kind in ("svg", "png"):
            draw_heat_map(frame, (x, y, panels), value, name, folder / f"heatmap-{value}.{kind}")
