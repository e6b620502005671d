"""Simulated drives as arrays, and maps made of their rows with other numbers of features or other beams."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from ndtorch.navigation import FeatureParams, Grid, GridMap, MatchParams, Pose, Ranges, StereoRanging, StereoRig

RATE = 30.0
Arrays = dict[str, npt.NDArray[Any]]


class Recorded(NamedTuple):
    """A drive as arrays, frames first.

    Attributes:
        arena, seed: where.
        summary: as `ndtorch_robot.drive` gives it.
        time: s. pose, believed: x, y, heading. command: speed, curvature. sides, difference: what the controller saw.
        mode: of the controller. rows: grey rows `[T', 2, W]` uint8 of the first half minute.
        cells: the map; bounds: left, right, bottom, top of it, m.
        collisions: `[n, 3]`, time and place. stops: times. placed: frames before which the car was carried.
        profiles: of the walls' brightness, for the score.
    """

    arena: str
    seed: int
    summary: dict[str, Any]
    time: npt.NDArray[np.float64]
    pose: npt.NDArray[np.float64]
    believed: npt.NDArray[np.float64]
    command: npt.NDArray[np.float64]
    sides: npt.NDArray[np.float64]
    difference: npt.NDArray[np.float64]
    mode: npt.NDArray[np.float64]
    rows: npt.NDArray[np.uint8]
    cells: npt.NDArray[np.float32]
    bounds: npt.NDArray[np.float64]
    collisions: npt.NDArray[np.float64]
    stops: npt.NDArray[np.float64]
    placed: npt.NDArray[np.int64]
    profiles: list[npt.NDArray[np.float64]]
    rig: StereoRig

    @property
    def grid(self) -> Grid:
        """Where the map's cells are."""
        return Grid(*(float(side) for side in self.bounds))

    def line(self) -> npt.NDArray[np.float64]:
        """The true path with gaps where the car was carried."""
        found = self.pose[:, :2].copy()
        found[self.placed[1:]] = np.nan
        return found


def record_drive(options: Mapping[str, Any]) -> Arrays:
    """Drive and keep the drive as arrays; `options` are fields of `ndtorch_robot.config.DriveConfig`."""
    from ndtorch_robot.config import DriveConfig
    from ndtorch_robot.drive import drive

    result = drive(DriveConfig(**options))
    record, grid, world = result.record, result.plan.grid(), result.simulation.world
    names = ("time", "pose", "believed", "sides", "difference", "mode")
    return {
        **{name: record.array(name) for name in names},
        "command": record.array("command")[:, :2],
        "rows": np.stack(record.rows),
        "cells": result.cells.numpy(),
        "bounds": np.array([grid.left, grid.right, grid.bottom, grid.top]),
        "collisions": np.array([(h.time, h.x, h.y) for h in result.simulation.collisions]).reshape(-1, 3),
        "stops": np.array(result.stops),
        "placed": np.array(record.placed, dtype=np.int64),
        "profile_values": np.concatenate(world.profiles),
        "profile_sizes": np.array([len(p) for p in world.profiles]),
        "summary_json": np.array(json.dumps(result.summary)),
    }


def from_arrays(arrays: Arrays, arena: str, seed: int) -> Recorded:
    """What `record_drive` gave, with its names."""
    from ndtorch_robot.sim.simulation import RIG

    sizes = arrays["profile_sizes"].cumsum()[:-1]
    parts: dict[str, Any] = {name: arrays[name] for name in Recorded._fields if name in arrays}
    return Recorded(
        **parts,
        arena=arena,
        seed=seed,
        summary=json.loads(str(arrays["summary_json"])),
        profiles=np.split(arrays["profile_values"], sizes),
        rig=RIG,
    )


def ranges_of(
    seen: Recorded, features: FeatureParams, matching: MatchParams | None = None, angle: str = "atan"
) -> Ranges:
    """Ranges `[T', n]` computed again from the recorded rows, which were rounded to whole grey levels."""
    left, right = torch.from_numpy(seen.rows).unbind(1)
    ranging = StereoRanging(seen.rig, 1 / RATE, features, matching, angle)  # type: ignore[arg-type]
    found: Ranges
    with torch.inference_mode():
        found, _ = ranging(left[:, None, None, :], right[:, None, None, :])
    return found


def map_of(seen: Recorded, ranges: Ranges, reach: float) -> Tensor:
    """The map of those ranges at the believed poses, over its largest."""
    pose = Pose(*torch.from_numpy(seen.believed[: len(seen.rows)]).float().unbind(-1))
    with torch.inference_mode():
        cells, _ = GridMap(seen.rig, seen.grid, reach)(ranges, pose)
    return GridMap.normalise(cells.clone())


def score_of(seen: Recorded, cells: Tensor) -> dict[str, float | None]:
    """Precision, recall, position and spacing error of a map of the drive's first half minute."""
    from ndtorch_robot.evaluation.metrics import score_map
    from ndtorch_robot.sim.arenas import load_arena

    plan = load_arena(seen.arena, seen.seed)
    poses = seen.pose[: len(seen.rows) : 5]
    return score_map(cells, seen.grid, plan, seen.profiles, poses, seen.rig)._asdict()


def quality(score: Mapping[str, float | None]) -> float:
    """Harmonic mean of a map's precision and recall, 0..1."""
    p, r = score["precision"] or 0.0, score["recall"] or 0.0
    return 2 * p * r / (p + r) if p + r else 0.0
