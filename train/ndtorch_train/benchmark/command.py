"""`ndtorch benchmark`: its sub-commands and their options."""

from __future__ import annotations

import functools
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from ndtorch.errors import InputError
from ndtorch.utils.workers import cores
from ndtorch_train.benchmark.base import Benchmark, BenchmarkResult, Split


@dataclass(frozen=True)
class Options:
    """What every benchmark takes."""

    out: Path | None = None
    """Folder to write to (default: out/benchmark/NAME)."""
    jobs: int | None = None
    """Processes (default: one for every core this process may use)."""
    fresh: bool = False
    """Run every task anew."""
    json: bool = False
    """Print the rows of the table as JSON and nothing else."""

    def benchmark(self) -> Benchmark:
        """What is to be measured, its options checked."""
        raise NotImplementedError

    def run(self) -> int:
        """Measure and write; returns the exit code."""
        made = self.benchmark()
        return self.measure(made, self.out or Path("out/benchmark") / made.name).report(self.json)

    def measure(self, made: Benchmark, out: Path) -> BenchmarkResult:
        """Run a benchmark; each task that is done is printed."""
        jobs = cores() if self.jobs is None else self.jobs
        if jobs < 1:
            raise InputError(f"--jobs must be at least 1, got {jobs}")
        tell = functools.partial(print, file=sys.stderr if self.json else sys.stdout, flush=True)
        return made.run(out, jobs, self.fresh, tell)


@dataclass(frozen=True)
class Seeded(Options):
    """What every benchmark of drawn scenes takes."""

    split: Split = "tune"
    """Which seeds."""


@dataclass(frozen=True)
class OverTime(Seeded):
    """Score the number and the features of moving bars at every second, beside simple peers."""

    methods: tuple[str, ...] = ("scale-free", "published", "retinotopic", "color rank", "FastICA")
    """Methods to compare."""
    films: tuple[str, ...] = ()
    """Rows of the table; none for all."""
    count: int = 8
    """Number of films a row."""

    def benchmark(self) -> Benchmark:
        """The films."""
        from ndtorch_train.benchmark.bar_scenes import CONDITIONS
        from ndtorch_train.benchmark.over_time import over_time_benchmark

        return over_time_benchmark(self.methods, self.films or tuple(CONDITIONS), self.count, self.split)


@dataclass(frozen=True)
class Foreground(Seeded):
    """Score models for video, and background subtraction with trackers, on labelled clips."""

    folder: Annotated[Path, tyro.conf.Positional] = Path()
    """Folder of folders with clip.mp4, and gt.txt (MOT format) or masks.mkv."""
    methods: tuple[str, ...] = ("foreground", "mog2-sort")
    """Methods: foreground, mog2-sort, knn-bytetrack (needs the package trackers), or folders of models."""

    def benchmark(self) -> Benchmark:
        """The clips."""
        from ndtorch_train.benchmark.foreground import foreground_benchmark

        return foreground_benchmark(self.methods, self.folder, self.split)


@dataclass(frozen=True)
class ShapeIdentification(Seeded):
    """Score methods that identify a shape of moving dots, among two, as psychophysics of common fate does."""

    methods: tuple[str, ...] = ()
    """Methods to compare: figure-ground and flow; all by default."""
    conditions: tuple[str, ...] = ()
    """Conditions: plain, fast, short-lived and noise; all by default."""
    films: int = 100
    """Number of films of each condition."""

    def benchmark(self) -> Benchmark:
        """The films."""
        from ndtorch_train.benchmark.shape_identification import shape_benchmark

        return shape_benchmark(self.methods, self.conditions, self.films, self.split)


@dataclass(frozen=True)
class RangesOnPhotographs(Options):
    """Score ranges of single rows on stereo pairs with ground truth, beside OpenCV's semi-global matching."""

    pairs: Annotated[Path, tyro.conf.Positional] = Path()
    """Folder of folders with left.png, right.png and disp*.png, .tif or .pfm."""
    disparities: tuple[int, int] = (8, 128)
    """Least and largest disparity that count, pixels."""

    def benchmark(self) -> Benchmark:
        """The stereo pairs."""
        from ndtorch_train.benchmark.ranges import range_benchmark

        return range_benchmark(self.pairs, self.disparities)


@dataclass(frozen=True)
class BenchmarkCommand:
    """Score models and peers, one sub-command a benchmark.

    Every benchmark writes NAME.csv, NAME.md, an image and report.html, and goes on where it was stopped. Choose
    constants on the split `tune` and report the split `test`: their seeds have none in common.
    """

    subcommands: ClassVar[Mapping[str, type[Options]]] = {
        "over-time": OverTime,
        "foreground": Foreground,
        "shape-identification": ShapeIdentification,
        "ranges": RangesOnPhotographs,
    }

    def run(self) -> int:
        """Never called: `ndtorch.cli.commands` runs one of `subcommands`."""
        raise NotImplementedError
