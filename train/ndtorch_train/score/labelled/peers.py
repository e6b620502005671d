"""What people use: stock background subtraction, opening and contours, and a tracker of boxes."""

from __future__ import annotations

from typing import Any, Protocol

import cv2
import numpy as np

from ndtorch_train.score.labelled.sight import Box, Mask, Pixels, Sight
from ndtorch_train.score.labelled.truth import SMALLEST

OPENING = 3
"""Pixels of the square with which masks are opened."""
REACH = 1.0
"""Norfair: largest distance of a detection from where a track is expected, in sizes of the box."""


class BoxTracker(Protocol):
    """Boxes of one frame after the other -> boxes with identities."""

    def __call__(self, boxes: list[Box]) -> list[Sight]: ...


class Subtraction:
    """MOG2 or KNN as they come, opening with a small square, contours of at least the smallest area.

    Args:
        kind: "mog2" or "knn".
    """

    def __init__(self, kind: str) -> None:
        self.model: Any = (
            cv2.createBackgroundSubtractorMOG2() if kind == "mog2" else cv2.createBackgroundSubtractorKNN()
        )
        self.square = np.ones((OPENING, OPENING), np.uint8)

    def __call__(self, frame: Pixels) -> tuple[Mask, list[Box]]:
        """The mask, shadows left out, and its boxes."""
        mask = (self.model.apply(frame) == 255).astype(np.uint8)
        mask = np.asarray(cv2.morphologyEx(mask, cv2.MORPH_OPEN, self.square), np.uint8)
        contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        found = []
        for contour in contours:
            if cv2.contourArea(contour) >= SMALLEST * mask.size:
                left, top, width, height = cv2.boundingRect(contour)
                found.append(Box(left, top, left + width, top + height))
        return mask > 0, found


class Norfair:
    """Norfair's tracker over centers, distance in sizes of the box; only tracks seen in this very frame are said."""

    def __init__(self, fps: float) -> None:
        from norfair import Tracker

        def apart(seen: Any, track: Any) -> float:
            return float(np.linalg.norm(seen.points[0] - track.estimate[0]) / seen.data[1])

        # A track is kept for half a second.
        self.tracker = Tracker(apart, REACH, hit_counter_max=max(2, round(fps / 2)))

    def __call__(self, boxes: list[Box]) -> list[Sight]:
        from norfair import Detection

        seen = [
            Detection(np.array([middle(box)]), data=(box, max(box.right - box.left, box.bottom - box.top)))
            for box in boxes
        ]
        tracks = self.tracker.update(seen)
        # Norfair copies detections, but not what they carry.
        now = {id(one.data) for one in seen}
        out = []
        for track in tracks:
            if id(track.last_detection.data) in now and track.id is not None:
                box = track.last_detection.data[0]
                out.append(Sight(int(track.id), middle(box), box))
        return out


class ByteTrack:
    """ByteTrack as the supervision package has it."""

    def __init__(self, fps: float) -> None:
        import warnings

        import supervision

        self.detections = supervision.Detections
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            self.tracker = supervision.ByteTrack(frame_rate=max(1, round(fps)))

    def __call__(self, boxes: list[Box]) -> list[Sight]:
        places = np.array(boxes, np.float64).reshape(-1, 4)
        seen = self.detections(
            xyxy=places, confidence=np.ones(len(boxes), np.float32), class_id=np.zeros(len(boxes), int)
        )
        found = self.tracker.update_with_detections(seen)
        out = []
        numbers = [] if found.tracker_id is None else found.tracker_id.tolist()
        for number, row in zip(numbers, found.xyxy.tolist(), strict=True):
            box = Box(*row)
            out.append(Sight(int(number), middle(box), box))
        return out


def middle(box: Box) -> tuple[float, float]:
    """Column and row of a box's middle."""
    return (box.left + box.right) / 2, (box.top + box.bottom) / 2
