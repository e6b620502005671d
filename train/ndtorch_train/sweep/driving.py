"""Trials of driving: a simulated drive, and maps of its rows with other features, beams and matching."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

from ndtorch.navigation import AvoidanceParams, FeatureParams, MatchParams, controller_names
from ndtorch_robot.sim.arenas import arenas
from ndtorch_train.recorded import Recorded, from_arrays, map_of, quality, ranges_of, record_drive, score_of
from ndtorch_train.sweep.parameters import Parameter, Trial

_A, _F, _M = AvoidanceParams(), FeatureParams(), MatchParams()

PARAMETERS: Mapping[str, Parameter] = {
    "arena": Parameter("hallway", words=tuple(arenas(test=False))),
    "seed": Parameter(0, 0, 2**31 - 1),
    "controller": Parameter("published", words=controller_names()),
    "seconds": Parameter(30.0, 1, 86400),
    "walls": Parameter("textured", words=("textured", "blank")),
    "odometry": Parameter("true", words=("true", "noisy")),
    "turn_threshold": Parameter(_A.turn_threshold, 0),
    "high_threshold": Parameter(_A.high_threshold, 0),
    "low_threshold": Parameter(_A.low_threshold, 0),
    "features": Parameter(_F.count, 1, 64),
    "reach": Parameter(3.0, 1e-3),
    "min_motion": Parameter(_F.min_motion, 0),
    "min_difference": Parameter(_F.min_difference, 0),
    "min_disparity": Parameter(_M.min_disparity_px, 0),
    "max_disparity": Parameter(_M.max_disparity_px, 0),
    "angle": Parameter("atan", words=("atan", "linear")),
}
"""Options of `ndtorch drive`, thresholds of the published controller, and what a map is made with: features a
frame, R_b of the beams (m), T_min, T_sim, disparities (px), and the angle of a pixel."""

THRESHOLDS = ("turn_threshold", "high_threshold", "low_threshold")
DRIVE = ("arena", "seed", "controller", "seconds", "walls", "odometry", *THRESHOLDS)
"""Parameters that need a drive of their own; all others make maps of the same rows."""
RANGING = ("features", "min_motion", "min_difference", "min_disparity", "max_disparity", "angle")
"""Parameters that need ranges of their own; a map for another R_b does not."""

RESULTS: tuple[str, ...] = (
    "quality", "precision", "recall", "position_error_cm", "spacing_error_percent", "ranges_a_frame",
    "collisions", "stops", "turns", "distance_m", "free_area_passed",
)  # fmt: skip
"""Results. Maps are of the first half minute of a drive, of which the rows are kept."""

USES = (
    "ndtorch.vision",
    "ndtorch.navigation",
    "ndtorch_robot",
    "ndtorch_train.recorded",
    "ndtorch_train.sweep.driving",
)
"""Code that a trial depends on."""


def blocks(trials: Sequence[Trial], jobs: int, batch: int = 512) -> list[list[Trial]]:
    """Trials of the same drive."""
    groups: dict[tuple[Any, ...], list[Trial]] = defaultdict(list)
    for trial in trials:
        groups[tuple(trial[key] for key in DRIVE)].append(trial)
    return [group[k : k + batch] for group in groups.values() for k in range(0, len(group), batch)]


def run_block(trials: Sequence[Trial], device: str = "cpu") -> list[dict[str, Any]]:
    """Results of trials of one drive: it is driven once, ranged for every set of features, mapped for every R_b."""
    seen = drive(trials[0])
    summary = seen.summary
    common = {
        "collisions": len(seen.collisions),
        "stops": len(seen.stops),
        "turns": summary["turns"],
        "distance_m": summary["distance_m"],
        "free_area_passed": summary["free_area_passed"],
    }
    ranged: dict[tuple[Any, ...], Any] = {}
    found = []
    for trial in trials:
        key = tuple(trial[name] for name in RANGING)
        if key not in ranged:
            features = FeatureParams(
                count=int(trial["features"]),
                min_motion=float(trial["min_motion"]),
                min_difference=float(trial["min_difference"]),
            )
            matching = MatchParams(float(trial["min_disparity"]), float(trial["max_disparity"]))
            ranged[key] = ranges_of(seen, features, matching, str(trial["angle"]))
        score = score_of(seen, map_of(seen, ranged[key], float(trial["reach"])))
        rate = float(ranged[key].valid.double().sum(-1).mean())
        found.append({"quality": quality(score), **score, "ranges_a_frame": rate, **common})
    return found


def drive(trial: Trial) -> Recorded:
    """The drive of a trial."""
    options = {key: trial[key] for key in ("arena", "seed", "controller", "seconds", "walls", "odometry")}
    changed = {key: float(trial[key]) for key in THRESHOLDS if trial[key] != PARAMETERS[key].default}
    return from_arrays(record_drive(options, thresholds=changed), str(trial["arena"]), int(trial["seed"]))
