"""Simulated drives that several experiments look at, made once."""

from __future__ import annotations

from typing import Any

from ndtorch_train.recorded import Recorded, from_arrays, record_drive
from ndtorch_train.reproduce.context import Arrays, Context

DRIVES = ("ndtorch.vision", "ndtorch.navigation", "ndtorch_robot", "ndtorch_train.recorded")
"""Code that a drive depends on."""

PUBLISHED = {"controller": "published", "features": 5, "feature_position": "motion"}
"""What is printed in place of the defaults of `ndtorch drive`."""


def recorded(
    context: Context, arena: str, seed: int, seconds: float, share: tuple[float, float] = (0.0, 1.0), **options: Any
) -> Recorded:
    """Drive with the published controller, or look up the drive.

    Args:
        share: where this drive begins and ends within the experiment, for the progress.
        options: other fields of `robot.config.DriveConfig`.
    """
    key = {"arena": arena, "seed": seed, "seconds": seconds, **PUBLISHED, **options}

    def report(made: int, total: int) -> None:
        if made % 30 == 0:
            context.report(share[0] + (share[1] - share[0]) * made / total)

    def make() -> Arrays:
        return record_drive(key, report)

    return from_arrays(context.stored("drive", key, DRIVES, make), arena, seed)
