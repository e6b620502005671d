"""The drives of an evaluation: which they are, where their results are kept, and how one is done."""

from __future__ import annotations

import hashlib
import json
import sys
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import closing
from itertools import product
from pathlib import Path
from typing import Any, Generic, TypeVar

from ndtorch.errors import InputError
from ndtorch.utils import workers
from ndtorch.utils.files import TABLE_BYTES, read_text, write_text
from ndtorch.utils.packages import code_digest
from ndtorch_robot.config import DriveConfig
from ndtorch_robot.ports import Step

IRRELEVANT = {"out", "rrd", "view", "full_frames"}
"""Keys that change nothing in a drive."""

CODE = ("ndtorch", "ndtorch_robot")
"""The code that a drive runs through."""

PACKAGES = ("torch", "numpy")
"""What else draws and counts in it."""

REPORT_EVERY = 0.5
"""Seconds between two reports of a worker."""

Summary = dict[str, Any]

Job = TypeVar("Job")


def all_drives(
    base: DriveConfig,
    arenas: tuple[str, ...],
    walls: tuple[str, ...],
    controllers: tuple[str, ...],
    seeds: list[int],
    disturbances: tuple[str, ...] | None = None,
) -> list[DriveConfig]:
    """Every combination, once; the seeds vary fastest."""
    given = (base.disturbance,) if disturbances is None else disturbances
    combinations = dict.fromkeys(product(arenas, walls, given, controllers, seeds))
    names = ("arena", "walls", "disturbance", "controller", "seed")
    return [base.model_copy(update=dict(zip(names, values, strict=True))) for values in combinations]


def key_of(config: DriveConfig, code: str) -> str:
    """Name of the result of a drive: the same for the same parameters, building and code."""
    values = config.model_dump(mode="json", exclude=IRRELEVANT)
    text = read_text(config.arena) if config.arena.endswith(".toml") else ""
    return hashlib.sha256(json.dumps([values, text, code], sort_keys=True).encode()).hexdigest()[:16]


class ResultCache(ABC, Generic[Job]):
    """Results of finished drives, one file each, so that many drives can go on where they were stopped."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.code = folder, code_digest(CODE, PACKAGES)

    @abstractmethod
    def name(self, job: Job) -> str:
        """Name of the result: the same for the same parameters and code."""

    def file(self, job: Job) -> Path:
        return self.folder / f"{self.name(job)}.json"

    def get(self, job: Job) -> dict[str, Any] | None:
        try:
            found = json.loads(read_text(self.file(job), TABLE_BYTES))
        except (FileNotFoundError, ValueError, RecursionError):
            return None
        return found if isinstance(found, dict) else None

    def put(self, job: Job, result: Summary) -> None:
        """Keep a result. The file is written beside and moved, so that there is never half of it."""
        file = self.file(job)
        file.parent.mkdir(parents=True, exist_ok=True)
        write_text(file, json.dumps(result) + "\n")


class DriveCache(ResultCache[DriveConfig]):
    """Summaries of finished drives."""

    def name(self, job: DriveConfig) -> str:
        return key_of(job, self.code)


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
    made, troubles, left = [0.0] * len(missing), list[str](), len(missing)
    if not missing:
        return []
    with (
        progress_bar(sum(map(size, missing)), desc=f"{left} to go", **bar_options) as bar,
        closing(workers.run_tasks(work, missing, processes)) as events,
    ):
        for kind, task, value in events:
            job, reached = missing[task], size(missing[task])
            if kind == "progress":
                reached = float(value)
            elif kind == "again":
                bar.write(f"note: {name(job)}: its process died ({value}); once more", file=sys.stderr)
                reached = 0.0
            elif kind == "done":
                cache.put(job, value)
            else:
                troubles.append(f"{name(job)}: {str(value).strip().splitlines()[-1]}")
            bar.update(reached - made[task])
            made[task] = reached
            left -= kind in ("done", "failed")
            bar.set_description_str(f"{left} to go")
    return troubles


def drive_once(config: DriveConfig, report: Callable[[float], None]) -> Summary:
    """Do one drive, in one thread; reports the simulated seconds driven so far."""
    import torch

    from ndtorch_robot.drive import drive

    torch.set_num_threads(1)
    reported = time.monotonic()

    def tell(step: Step) -> None:
        nonlocal reported
        now, made = time.monotonic(), (step.number + 1) / config.rate
        if now - reported > REPORT_EVERY or made >= config.seconds:
            reported = now
            report(made)

    unseen = {"full_frames": False, "rrd": None, "view": False}
    return drive(config.model_copy(update=unseen), [tell]).summary
