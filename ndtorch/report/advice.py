"""Why a run found no objects, and whether its camera moves."""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np

from ndtorch.report.mask_store import MaskStore
from ndtorch.run.result import RunResult
from ndtorch.run.watchers import Picture, Pixels, Watcher

SIDE = 192
"""Longest side of the pictures that are compared, pixels."""
BLUR_PX = 1.5
"""Pictures are blurred by this deviation first: a plain ground has faint texture under the noise."""
POINTS, DISTANCE_PX, QUALITY = 200, 8, 0.001
"""Corners that are tracked from picture to picture, their smallest distance, and the weakest against the strongest."""
INLIER_PX, MIN_INLIER_RATIO = 0.7, 0.5
"""All of the image moved if one similarity transform is within so many pixels of this share of the points (RANSAC)."""
CELLS, MIN_CELLS = 4, 8
"""Those points must lie in so many of the square cells, of which there are this many across and down."""
MIN_SHIFT_PX = 0.5
"""The mean shift of those points of an image that moved, pixels."""
RECENT, MIN_RECENT = 8, 6
"""The camera moves once all of the image moved in so many of the latest comparisons."""
CHANGED_LEVELS = 25
"""Difference of a pixel from the picture before, levels of 255, that is motion."""


class CameraMotion(Watcher):
    """Compares each picture of a model with tracks with the one before.

    Attributes:
        since: time of the picture from which on the camera moved, seconds; None if it does not.
        shifted, compared: number of pictures in which all of the image moved, and of all.
        largest_region: largest region that changed between two pictures, pixels of the source.
    """

    def __init__(self) -> None:
        self.since: float | None = None
        self.shifted = self.compared = 0
        self.largest_region = 0.0
        self._before: Pixels | None = None
        self._recent = deque[tuple[float, bool]](maxlen=RECENT)

    def picture(self, picture: Picture) -> None:
        if picture.enhanced is not None:
            return
        import cv2

        height, width = picture.frame.shape[:2]
        scale = min(1.0, SIDE / max(height, width))
        size = max(1, round(width * scale)), max(1, round(height * scale))
        grey = cv2.cvtColor(np.ascontiguousarray(picture.frame), cv2.COLOR_RGB2GRAY)
        small = np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), np.uint8)
        before, self._before = self._before, small
        if before is None or before.shape != small.shape:
            return
        moved = global_shift(before, small) >= MIN_SHIFT_PX
        self.compared += 1
        self.shifted += moved
        self._recent.append((picture.time, moved))
        if self.since is None and sum(one for _, one in self._recent) >= MIN_RECENT:
            self.since = next(time for time, one in self._recent if one)
        changed = (cv2.absdiff(before, small) > CHANGED_LEVELS).astype(np.uint8)
        if changed.any():
            areas = cv2.connectedComponentsWithStats(changed)[2][1:, cv2.CC_STAT_AREA]
            self.largest_region = max(self.largest_region, float(areas.max()) / scale**2)

    def advice(self) -> str | None:
        """What is to be said of a camera that moves; None if it does not."""
        if self.since is None:
            return None
        return (
            f"the camera moves, from {self.since:.1f} s on (all of the image moved in {self.shifted} of "
            f"{self.compared} pictures): the model needs a fixed camera, and its objects are not to be trusted; "
            "stabilise the video first, or take a part in which the camera stands (--start, --stop)"
        )


def global_shift(before: Pixels, after: Pixels) -> float:
    """Mean shift in pixels between two grey images of what moves as one, if that is most of the image; else 0.

    Corners are tracked (Lucas and Kanade 1981), and a similarity transform is fitted by RANSAC.
    """
    import cv2

    before, after = (np.asarray(cv2.GaussianBlur(one, (0, 0), BLUR_PX), np.uint8) for one in (before, after))
    corners = cv2.goodFeaturesToTrack(before, POINTS, QUALITY, DISTANCE_PX)
    if corners is None or len(corners) < MIN_CELLS:
        return 0.0
    there, found, _ = cv2.calcOpticalFlowPyrLK(before, after, corners, np.empty_like(corners))
    start, end = corners.reshape(-1, 2)[found.ravel() > 0], there.reshape(-1, 2)[found.ravel() > 0]
    if len(start) < MIN_CELLS:
        return 0.0
    # OpenCV gives None where it finds no transform.
    fit: Any = cv2.estimateAffinePartial2D(start, end, method=cv2.RANSAC, ransacReprojThreshold=INLIER_PX)
    if fit[1] is None:
        return 0.0
    same = fit[1].ravel() > 0
    cells = np.floor(start[same] * CELLS / before.shape[::-1]).astype(int)
    if same.sum() < MIN_INLIER_RATIO * len(corners) or len(np.unique(cells, axis=0)) < MIN_CELLS:
        return 0.0
    return float(np.hypot(*(end - start)[same].T).mean())


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
