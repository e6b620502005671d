"""`ndtorch sweep`: reads a sweep from a TOML file, runs its trials and writes tables and heat maps."""

from __future__ import annotations

import functools
import itertools
import json
import math
import sys
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
from ndtorch.utils.workers import Event, cores, run_tasks

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
    steps: Annotated[int, Field(ge=1, le=MOST)] = 10
    scale: Literal["linear", "log"] = "linear"

    def grid(self) -> list[float]:
        """The values of a grid, rounded, so that 0.1 is 0.1 in tables and on axes."""
        spaced = np.geomspace if self.scale == "log" else np.linspace
        return [float(f"{value:.9g}") for value in spaced(self.low, self.high, self.steps)]

    def draw(self, rng: np.random.Generator, whole: bool) -> float:
        """A random value."""
        if whole:
            return int(rng.integers(math.ceil(self.low), math.floor(self.high) + 1))
        if self.scale == "log":
            return math.exp(rng.uniform(math.log(self.low), math.log(self.high)))
        return float(rng.uniform(self.low, self.high))


class SweepConfig(BaseModel):
    """The contents of a sweep's file; `show` names the results of which heat maps are drawn."""

    model_config = ConfigDict(extra="forbid")
    kind: Literal["binding", "driving"] = "binding"
    method: Literal["grid", "random"] = "grid"
    trials: Annotated[int, Field(ge=1, le=MOST)] = 100
    seed: int = 0
    device: str = "cpu"
    vary: dict[str, Annotated[list[Any], Field(min_length=1)] | Span] = Field(min_length=1)
    fixed: dict[str, Any] = Field(default_factory=dict)
    show: tuple[str, ...] = ()


def read_sweep(data: Mapping[str, Any], where: str) -> tuple[SweepConfig, list[Trial]]:
    """A sweep and its trials from the values of a TOML file.

    Raises:
        InputError: an unknown key or value, or no trial.
    """
    from ndtorch_train.sweep.trials import KINDS, RESULTS

    try:
        config = SweepConfig.model_validate(dict(data))
        kind = KINDS[config.kind]
        for names, known in (
            ((*config.vary, *config.fixed), [one.name for one in fields(kind)]),
            (config.show, RESULTS[config.kind]),
        ):
            for name in names:
                if name not in known:
                    raise InputError(f"{where}: unknown name {name!r}{did_you_mean(name, known)}")
        if any(isinstance(one, Span) and one.scale == "log" and one.low <= 0 for one in config.vary.values()):
            raise InputError(f"{where}: values on a logarithmic scale must be positive")
        whole = {one.name for one in fields(kind) if isinstance(one.default, int)}
        choices = combinations(config, whole, where)
        trials = TypeAdapter(list[kind]).validate_python([config.fixed | choice for choice in choices])  # type: ignore[valid-type]
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"] if not isinstance(part, int))
        raise InputError(f"{where}: {place or 'the file'}: {first['msg']}, got {first['input']!r:.60}") from None
    return config, list(dict.fromkeys(trials))


def combinations(config: SweepConfig, whole: set[str], where: str) -> list[dict[str, Any]]:
    """The varied parameters of every trial."""
    if config.method == "grid":
        axes = [spec.grid() if isinstance(spec, Span) else spec for spec in config.vary.values()]
        if math.prod(map(len, axes)) > MOST:
            raise InputError(f"{where}: {math.prod(map(len, axes))} trials; 1 to {MOST} are possible")
        return [dict(zip(config.vary, values, strict=True)) for values in itertools.product(*axes)]
    rng = np.random.default_rng(config.seed)
    return [
        {
            name: spec.draw(rng, name in whole) if isinstance(spec, Span) else spec[rng.integers(len(spec))]
            for name, spec in config.vary.items()
        }
        for _ in range(config.trials)
    ]


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

        from ndtorch.run.progress import progress_bar
        from ndtorch_train.sweep.trials import blocks, run_block

        file = toml_file(self.config, "ndtorch_train", "sweeps")
        config, trials = read_sweep(toml_values(file), str(file))
        jobs = cores() if self.jobs is None else self.jobs
        if jobs < 1:
            raise InputError(f"--jobs must be at least 1, got {jobs}")
        out = self.out or Path("out/sweep") / file.stem
        out.mkdir(parents=True, exist_ok=True)
        table, kind = out / "results.parquet", type(trials[0])
        rows: dict[Trial, dict[str, Any]] = {}
        if table.is_file() and not self.fresh:
            for row in pandas.read_parquet(table).to_dict("records"):
                rows[kind(**{one.name: row[one.name] for one in fields(kind)})] = row
        todo, failed = [trial for trial in trials if trial not in rows], list[str]()
        parts = blocks(todo, jobs)
        work = functools.partial(run_block, device=config.device)
        events = run_tasks(work, parts, jobs) if self.cluster is None else run_on_ray(parts, self.cluster, work)
        with progress_bar(len(todo), desc=file.stem, unit=" trials") as bar:
            for event, index, value in events:
                if event == "done":
                    rows |= {t: asdict(t) | result for t, result in zip(parts[index], value, strict=True)}
                    pandas.DataFrame(list(rows.values())).to_parquet(table)
                    bar.update(len(parts[index]))
                else:
                    failed.append(str(value).strip())
        frame = pandas.DataFrame([rows[trial] for trial in trials if trial in rows])
        if len(frame):
            write_results(config, file.stem, frame, out)
        report = {"trials": len(frame), "computed_now": len(todo), "folder": str(out)}
        print(json.dumps(report) if self.json else ", ".join(f"{key} {value}" for key, value in report.items()))
        for why in sorted(set(failed)):
            print(f"error: {failed.count(why)} blocks of trials failed: {why}", file=sys.stderr)
        return 1 if failed else 0


def run_on_ray(parts: Sequence[Sequence[Trial]], address: str, work: Any) -> Iterator[Event]:
    """Run blocks on a Ray cluster; events as of `run_tasks`.

    Raises:
        InputError: Ray is not installed, or no cluster answers.
    """
    ray = need("ray", "--cluster")
    try:
        ray.init(address=None if address == "local" else address, log_to_driver=False, include_dashboard=False)
    except Exception as error:
        raise InputError(f"--cluster {address}: no Ray cluster ({str(error).splitlines()[0]})") from None
    try:
        remote = ray.remote(num_cpus=1)(lambda part: work(part))
        waiting = {remote.remote(part): n for n, part in enumerate(parts)}
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
    """Write summary.md, means over all other parameters, and the heat maps over the first three that vary but seeds."""
    import pandas

    from ndtorch_train.plots import draw_heat_map
    from ndtorch_train.sweep.trials import RESULTS

    results = RESULTS[config.kind]
    lines = [f"# {name}", "", f"{len(frame)} trials; means over all other parameters.", ""]
    lines += [f"| | | trials | {' | '.join(results)} |", f"|---|---|---|{'---|' * len(results)}"]
    for key in config.vary:
        groups = frame[key] if frame[key].nunique() <= 32 else pandas.qcut(frame[key], 10)
        for value, group in frame.groupby(groups, observed=True):
            cells = " | ".join(f"{group[result].astype(float).mean():.3g}" for result in results)
            label = f"{value:.4g}" if isinstance(value, float) else value
            lines.append(f"| {key} | {label} | {len(group)} | {cells} |")
    (folder / "summary.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    axes = [key for key in config.vary if key != "seed"][:3]
    for value in config.show or results[:1] if axes else ():
        draw_heat_map(frame, axes, value, name, folder / f"heatmap-{value}.png")
