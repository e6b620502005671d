"""One drive of an evaluation: what it is called, where its result is kept, and how it is done."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable
from itertools import product
from pathlib import Path

from ndtorch.utils.files import write_text
from ndtorch.utils.packages import code_digest
from ndtorch_robot.config import DriveConfig
from ndtorch_robot.ports import Step

NOT_THE_DRIVE = {"out", "rrd", "view", "full_frames"}
"""Keys that do not change what happens in a drive."""

CODE = ("ndtorch", "ndtorch_robot")
"""The code that a drive runs through."""

PACKAGES = ("torch", "mujoco", "numpy")
"""What else draws and counts in it."""

TELL_EVERY = 0.5
"""Seconds between two reports of a worker."""

Summary = dict[str, object]


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
    values = config.model_dump(mode="json", exclude=NOT_THE_DRIVE)
    text = Path(config.arena).read_text(encoding="utf-8") if config.arena.endswith(".toml") else ""
    return hashlib.sha256(json.dumps([values, text, code], sort_keys=True).encode()).hexdigest()[:16]


class Cache:
    """Summaries of finished drives, one file each, so that an evaluation can go on where it was stopped."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.code = folder, code_digest(CODE, PACKAGES)

    def file(self, config: DriveConfig) -> Path:
        """Where the summary of a drive is or will be."""
        return self.folder / f"{key_of(config, self.code)}.json"

    def get(self, config: DriveConfig) -> Summary | None:
        """The summary of a drive that was done before, or None."""
        try:
            found = json.loads(self.file(config).read_text())
        except (FileNotFoundError, ValueError, RecursionError):
            return None
        return found if isinstance(found, dict) else None

    def put(self, config: DriveConfig, summary: Summary) -> None:
        """Keep a summary. Written beside and moved, so that there is never half a file."""
        file = self.file(config)
        file.parent.mkdir(parents=True, exist_ok=True)
        write_text(file, json.dumps(summary) + "\n")


def drive_once(config: DriveConfig, report: Callable[[float], None]) -> Summary:
    """Do one drive, in one thread; tells the simulated seconds driven so far."""
    import torch

    from ndtorch_robot.drive import drive

    torch.set_num_threads(1)
    told = time.monotonic()

    def tell(step: Step) -> None:
        nonlocal told
        now, made = time.monotonic(), (step.number + 1) / config.rate
        if now - told > TELL_EVERY or made >= config.seconds:
            told = now
            report(made)

    unseen = {"full_frames": False, "rrd": None, "view": False}
    return drive(config.model_copy(update=unseen), [tell]).summary
