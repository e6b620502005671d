"""Many drives in parallel, each kept as soon as it is done, so that a command goes on where it was stopped."""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, TypeVar

from ndtorch.cli.command_run import INCOMPLETE, INTERRUPTED
from ndtorch.errors import InputError
from ndtorch.run.folder import make_writable
from ndtorch.utils import workers
from ndtorch.utils.files import TABLE_BYTES, read_text, write_text
from ndtorch.utils.packages import code_digest, toml_file
from ndtorch_robot.config import DriveConfig, RobotOptions
from ndtorch_robot.sim.arenas import FILES

REPORT_EVERY = 0.5
"""Seconds between two reports of a worker."""

Job = TypeVar("Job")


@dataclass
class Batch:
    """What came of many drives.

    Attributes:
        folder: of the results.
        results: of the drives that are finished, in their order.
        missing: number of the others.
        troubles: why drives could not be done, a line each.
        interrupted: by Ctrl-C.
    """

    folder: Path
    results: list[dict[str, Any]]
    missing: int
    troubles: list[str]
    interrupted: bool

    def exit_code(self) -> int:
        """Print the troubles; returns the exit code of the command."""
        for trouble in self.troubles:
            print(f"failed: {trouble}", file=sys.stderr)
        return INTERRUPTED if self.interrupted else INCOMPLETE if self.troubles else 0


def drive_many(
    work: Callable[[Job], dict[str, Any]],
    jobs: Sequence[Job],
    key: Callable[[Job], Any],
    label: Callable[[Job], str],
    size: Callable[[Job], float],
    out: Path,
    *,
    processes: int = 0,
) -> Batch:
    """Do those jobs whose results are not in `out`/drives, where they stay for the next time.

    Args:
        work: does one job in a process of its own.
        key: what the result depends on, for JSON.
        label: name for people.
        size: for the progress, in s.
        processes: number of jobs at a time; 0 is one a core.
    """
    from ndtorch.run.progress import progress_bar

    if processes < 0:
        raise InputError(f"--jobs must be 1 or more, got {processes}")
    code = code_digest(("ndtorch", "ndtorch_robot"), ("torch", "numpy"))
    names = [digest([key(job), code]) for job in jobs]
    make_writable(out)
    kept = out / "drives"
    kept.mkdir(exist_ok=True)
    missing = [n for n, name in enumerate(names) if finished(kept / f"{name}.json") is None]
    troubles, interrupted = list[str](), False
    form = "{desc} {percentage:3.0f}%|{bar}| {n:.0f}/{total:.0f} s, {rate_fmt}, {remaining} left"
    bar = progress_bar(sum(size(jobs[n]) for n in missing), desc=f"{len(missing)} to do", unit="x", bar_format=form)
    tasks = [jobs[n] for n in missing]
    with bar, closing(workers.run_tasks(work, tasks, processes or workers.cores())) as events:
        try:
            for kind, task, value in events if missing else ():
                if kind == "done":
                    # Written beside and moved, so that there is never half of it.
                    write_text(kept / f"{names[missing[task]]}.json", json.dumps(value) + "\n")
                else:
                    troubles.append(f"{label(tasks[task])}: {str(value).strip().splitlines()[-1]}")
                bar.update(size(tasks[task]))
        except KeyboardInterrupt:
            interrupted = True
    results = [result for name in names if (result := finished(kept / f"{name}.json")) is not None]
    return Batch(out, results, len(jobs) - len(results), troubles, interrupted)


def digest(values: Any) -> str:
    return hashlib.sha256(json.dumps(values, sort_keys=True, default=str).encode()).hexdigest()[:16]


def finished(file: Path) -> dict[str, Any] | None:
    """The result in a file; None without one that can be read."""
    try:
        result = json.loads(read_text(file, TABLE_BYTES))
    except (FileNotFoundError, ValueError, RecursionError):
        return None
    return result if isinstance(result, dict) else None


def key_of(options: RobotOptions) -> list[Any]:
    """What a drive depends on beside the code: its options, and the files of its arena and its robot."""
    values = {name: v for name, v in asdict(options).items() if name not in ("out", "rrd", "view", "record")}
    arena = values.get("arena", "")
    files = [toml_file(Path(arena), "ndtorch_robot", "arenas")] if arena.endswith(".toml") or arena in FILES else []
    files += [] if options.robot is None else [toml_file(options.robot, "ndtorch_robot", "configs")]
    return [values, *map(read_text, files)]


def drive_once(config: DriveConfig) -> dict[str, Any]:
    """Summary of one drive."""
    from ndtorch_robot.drive import drive

    return drive(config).summary
