"""`ndtorch bind`: the objects in a scene or a video, or in many."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict, dataclass, fields
from itertools import count
from pathlib import Path
from typing import Annotated

import tyro

from ndtorch.cli.command_run import INCOMPLETE, INTERRUPTED
from ndtorch.run.options import DEFAULT_SOURCE, BindJob, BindOptions


@dataclass(frozen=True)
class Bind(BindOptions):
    """Find the objects in a scene or a video, or in many: their number and their features.

    Prints the objects and the verdict, and writes them, pictures, the learned state and report.html, which
    shows it all, into a folder.
    The model foreground, which is the default for files and cameras, finds objects over time: a timeline, boxes and an
    overlay.
    Several sources, or a folder of films, give out/batch: a folder each, index.html, and responses.parquet and .csv
    with the time courses of all. The same command again does what is not finished.
    """

    sources: Annotated[tuple[str, ...], tyro.conf.Positional] = (DEFAULT_SOURCE,)
    """Scene names (see `ndtorch scenes`), video files, folders of images or of films, cameras (`camera:0`, /dev/video0)
    or addresses."""
    out: Path = Path("out")
    """Folder for results; a run gets a new folder in it, named after its source: two-bars, then two-bars-2."""
    jobs: int = 1
    """Several sources: number of processes."""
    weights: bool = False
    """Several sources: add the 100 weights to the table, once a chunk of frames."""
    force: bool = False
    """Write into the folder named after the source even if results are there; files of the same names are replaced.
    Several sources: run also what is finished."""
    json: bool = False
    """Print one JSON object on stdout and nothing else."""

    def run(self) -> int:
        import torch

        from ndtorch.run.batch import expanded
        from ndtorch.utils.tensors import tune_allocator

        # Programs choose; the library never does. Two threads get in each other's way on a busy machine.
        torch.set_num_threads(1)
        tune_allocator()
        options = {field.name: getattr(self, field.name) for field in fields(BindOptions)}
        if len(self.sources) == 1 and expanded(self.sources) == list(self.sources):
            return self.run_one(BindJob(**options, source=self.sources[0]))
        return self.run_many(BindOptions(**options))

    def run_one(self, job: BindJob) -> int:
        """Bind one source."""
        from ndtorch.report.summary import findings
        from ndtorch.run.batch import bind_source
        from ndtorch.run.progress import progress_bar

        with ExitStack() as stack:

            def begin(chosen: str, total: int | None) -> Callable[[int], object]:
                if not self.json:
                    print(f"model  {chosen}", flush=True)
                bar = progress_bar(total, self.json, unit=" frames", leave=False, mininterval=0.5)
                stack.enter_context(bar)
                return lambda frames: bar.update(frames)

            result, found, files = bind_source(job, self.out, force=self.force, begin=begin)
        if self.json:
            print(json.dumps(found, ensure_ascii=False))
        else:
            print(f"{result.source.name}: {result.simulated_seconds:g} s seen in {result.wall_seconds:.1f} s\n")
            print(*findings(result), sep="\n")
            print(f"written  {files[0].parent}: {', '.join(path.name for path in files)}")
        if result.interrupted:
            return INTERRUPTED
        return INCOMPLETE if result.source.silent else 0

    def run_many(self, options: BindOptions) -> int:
        """Bind several sources."""
        from ndtorch.run.batch import INDEX, Outcome, bind_sources, expanded
        from ndtorch.run.progress import progress_bar

        folder, names = self.out / "batch", expanded(self.sources)
        with progress_bar(len(names), self.json, unit=" sources", leave=False) as bar:
            numbers = count(1)

            def report(one: Outcome) -> None:
                bar.update()
                if not self.json:
                    text = f"left out: {one.error}" if one.error else "; ".join(one.objects) or "no objects"
                    bar.write(f"[{next(numbers)}/{len(names)}] {one.source}: {text}")

            try:
                done = bind_sources(
                    names, folder, options, jobs=self.jobs, weights=self.weights, again=self.force, report=report
                )
            except KeyboardInterrupt:
                print(f"stopped; what is finished is in {folder}, and the same command does the rest", flush=True)
                return INTERRUPTED
        failed = [one for one in done if one.error]
        if self.json:
            print(json.dumps({"folder": str(folder), "sources": [asdict(one) for one in done]}, ensure_ascii=False))
        else:
            print(f"{len(done) - len(failed)} of {len(done)} sources; written  {folder / INDEX}")
        return INCOMPLETE if failed else 0
