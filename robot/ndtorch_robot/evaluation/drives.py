"""The drives of an evaluation: which they are, where their results are kept, and how one is done."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any, Generic, TypeVar

from ndtorch.errors import InputError
from ndtorch.utils import workers
from ndtorch.utils.files import TABLE_BYTES, read_text, write_text
from ndtorch.utils.packages import code_digest
from ndtorch_robot.config import DriveConfig
from ndtorch_robot.ports import Step

REPORT_EVERY = 0.5
"""Seconds between two reports of a worker."""

Summary = dict[str, Any]

Job = TypeVar("Job")


def key_of(config: DriveConfig, code: str) -> str:
    """Name of the result of a drive: the same for the same parameters, building and code."""
    values = config.model_dump(mode="json", exclude={"out", "rrd", "view", "full_frames"})
    text = read_text(config.arena) if config.arena.endswith(".toml") else ""
    return hashlib.sha256(json.dumps([values, text, code], sort_keys=True).encode()).hexdigest()[:16]


class ResultCache(Generic[Job]):
    """Results of finished drives, one file each, so that many drives can go on where they were stopped.

    Args:
        folder: of the files.
        name: of the result of a job and a hash of the code: the same for the same parameters and code.
    """

    def __init__(self, folder: Path, name: Callable[[Job, str], str]) -> None:
        self.folder, self.name_of = folder, name
        self.code = code_digest(("ndtorch", "ndtorch_robot"), ("torch", "numpy"))

    def name(self, job: Job) -> str:
        return self.name_of(job, self.code)

    def get(self, job: Job) -> Summary | None:
        """The result that was kept; None without a file that can be read."""
        try:
            result = json.loads(read_text(self.folder / f"{self.name(job)}.json", TABLE_BYTES))
        except (FileNotFoundError, ValueError, RecursionError):
            return None
        return result if isinstance(result, dict) else None

    def put(self, job: Job, result: Summary) -> None:
        """Keep a result. The file is written beside and moved, so that there is never half of it."""
        self.folder.mkdir(parents=True, exist_ok=True)
        write_text(self.folder / f"{self.name(job)}.json", json.dumps(result) + "\n")


def processes_of(jobs: int) -> int:
    """What `--jobs` asks for: 0 is one a core. Raises `InputError`: less."""
    if jobs < 0:
        raise InputError(f"--jobs must be 1 or more, got {jobs}")
    return jobs or workers.cores()


def finish(
    work: Callable[[Job, Callable[[float], None]], Summary],
    given: list[Job],
    cache: ResultCache[Job],
    processes: int,
    name: Callable[[Job], str],
    size: Callable[[Job], float] = lambda job: 1.0,
    **bar_options: Any,
) -> list[str]:
    """Do those jobs whose results are missing, keeping each as soon as it is done; returns what went wrong for good."""
    from ndtorch.run.progress import progress_bar

    missing = [job for job in given if cache.get(job) is None]
    made, troubles = [0.0] * len(missing), list[str]()
    if not missing:
        return []
    with (
        progress_bar(sum(map(size, missing)), desc=f"{len(missing)} to do", **bar_options) as bar,
        closing(workers.run_tasks(work, missing, processes)) as events,
    ):
        for kind, task, value in events:
            job, reached = missing[task], size(missing[task])
            if kind == "progress":
                reached = float(value)
            elif kind == "done":
                cache.put(job, value)
            else:
                troubles.append(f"{name(job)}: {str(value).strip().splitlines()[-1]}")
            bar.update(reached - made[task])
            made[task] = reached
    return troubles


def drive_once(config: DriveConfig, report: Callable[[float], None]) -> Summary:
    """Do one drive, in one thread; reports the simulated seconds driven so far."""
    import torch

    from ndtorch_robot.drive import drive

    torch.set_num_threads(1)
    reported = time.monotonic()

    def observe(step: Step) -> None:
        nonlocal reported
        now, made = time.monotonic(), (step.number + 1) / config.rate
        if now - reported > REPORT_EVERY or made >= config.seconds:
            reported = now
            report(made)

    return drive(config.model_copy(update={"full_frames": False, "rrd": None, "view": False}), [observe]).summary
