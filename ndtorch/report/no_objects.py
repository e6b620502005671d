"""Why a run found no objects, and what can be done."""

from __future__ import annotations

from ndtorch.report.camera_motion import CameraMotion
from ndtorch.report.mask_store import MaskStore
from ndtorch.run.result import RunResult

SHORTEST_S = 1.5
"""Seconds that a video needs: half a second for the background, and an object has to be followed for a second."""


def advice(result: RunResult, camera: CameraMotion, masks: MaskStore) -> tuple[str, ...]:
    """What is to be said of a run of a model with tracks, a line each: reasons for no objects, or a moving camera."""
    lines = [line for line in [camera.advice()] if line is not None]
    if result.objects:
        return tuple(lines)
    seconds = result.simulated_seconds
    if seconds < SHORTEST_S:
        lines.append(
            f"the video is {seconds:.1f} s long: the background takes half a second to learn, and an object must be "
            "followed for about a second; use a longer video"
        )
    regions, largest, travel = masks.summary()
    scale = result.full_size[0] / max(1, masks.size[0])
    if regions:
        lines.append(
            f"{regions} region{'s' * (regions != 1)} differed from the background, the largest {largest * scale:.0f} "
            f"pixels wide, and none travelled far enough to be an object (at most {travel * scale:.0f} pixels); "
            "use a longer video, or lower tracking.min_travel_sizes in the config.toml of a copy of the model"
        )
    elif camera.largest_region > 0 and camera.since is None:
        side = camera.largest_region**0.5
        lines.append(
            f"everything that moved is smaller than the model takes, or too brief (about {side:.0f} x {side:.0f} of "
            f"{result.full_size[1]} x {result.full_size[0]} pixels): use a camera that is nearer, or crop the video"
        )
    elif not lines:
        lines.append(
            "nothing moved: no region differed from the background; check that the video shows what you look for "
            "(--start, --stop, --seconds)"
        )
    return tuple(lines)
