"""Many drives in parallel, each kept as soon as it is done, so that a command goes on where it was stopped."""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeVar

from ndtorch.cli.command_run import INCOMPLETE, INTERRUPTED
from ndtorch.errors import InputError
from ndtorch.run.folder import make_writable
from ndtorch.utils import workers
from ndtorch.utils.files import TABLE_BYTES, read_text, write_text
from ndtorch.utils.packages import code_digest, toml_file
from ndtorch_robot.config import DriveConfig, RobotOptions
from ndtorch_robot.sim.arenas import FILES, load_arena

Job = TypeVar("Job")
Result = dict[str, Any]


def drive_many(
    work: Callable[[Job], Result],
    jobs: Mapping[str, Job],
    key: Callable[[Job], Any],
    seconds: float,
    out: Path,
    processes: int = 0,
) -> tuple[list[Result], int]:
    """Do those jobs, by name, whose results are not in `out`/drives, where they stay for the next time.

    Args:
        key: what a result depends on, for JSON.
        seconds: simulated time of a job, for the progress.
        processes: number of jobs at a time; 0 is one a core.

    Returns:
        The results of the jobs that are finished, in their order, and the exit code of the command.
    """
    from ndtorch.run.progress import progress_bar

    if processes < 0:
        raise InputError(f"--jobs must be 1 or more, got {processes}")
    code = code_digest(("ndtorch", "ndtorch_robot"), ("torch", "numpy"))
    make_writable(out)
    (out / "drives").mkdir(exist_ok=True)
    keys = {name: json.dumps([key(job), code], sort_keys=True, default=str) for name, job in jobs.items()}
    digests = {name: hashlib.sha256(text.encode()).hexdigest() for name, text in keys.items()}
    files = {name: out / "drives" / f"{digest[:16]}.json" for name, digest in digests.items()}
    missing = [name for name, file in files.items() if finished(file) is None]
    exit_code = 0
    form = "{desc} {percentage:3.0f}%|{bar}| {n:.0f}/{total:.0f} s, {rate_fmt}, {remaining} left"
    bar = progress_bar(seconds * len(missing), desc=f"{len(missing)} to do", unit="x", bar_format=form)
    tasks = [jobs[name] for name in missing]
    with bar, closing(workers.run_tasks(work, tasks, processes or workers.cores())) as events:
        try:
            for kind, task, value in events if missing else ():
                if kind == "done":
                    # Written beside and moved, so that there is never half of it.
                    write_text(files[missing[task]], json.dumps(value) + "\n")
                else:
                    print(f"failed: {missing[task]}: {str(value).strip().splitlines()[-1]}", file=sys.stderr)
                    exit_code = INCOMPLETE
                bar.update(seconds)
        except KeyboardInterrupt:
            exit_code = INTERRUPTED
    return [result for file in files.values() if (result := finished(file)) is not None], exit_code


def finished(file: Path) -> Result | None:
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
    plan = [str(load_arena(arena).rings)] if arena.endswith((".yaml", ".yml")) else []  # of an image
    return [values, *plan, *map(read_text, files)]


def drive_once(config: DriveConfig) -> Result:
    from ndtorch_robot.drive import drive

    return drive(config).summary
