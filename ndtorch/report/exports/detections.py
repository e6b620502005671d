"""Objects in the arrays of `supervision.Detections`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ndtorch.binding import BoundObject


def to_detections(objects: Sequence[BoundObject]) -> dict[str, Any]:
    """The boxes of objects as the arguments of `supervision.Detections`; objects without a box are left out.

    Args:
        objects: as `model.visible_objects(state)` gives them at a frame.

    Returns:
        `xyxy` `[N, 4]` float32 in pixels of the frames that the model got, `confidence` `[N]` float32, `class_id` and
        `tracker_id` `[N]` int64.

    >>> from ndtorch.binding import BoundObject
    >>> car = BoundObject("red", 7, {"red": 1.0}, track=2, boxes=((1.0, 2.0, 5.0, 6.0),))
    >>> to_detections([car])["xyxy"].tolist()
    [[1.0, 2.0, 5.0, 6.0]]
    """
    boxed = [thing for thing in objects if thing.box is not None]
    numbers = [0 if thing.track is None else thing.track + 1 for thing in boxed]
    return {
        "xyxy": np.array([thing.box for thing in boxed], np.float32).reshape(-1, 4),
        "confidence": np.array([1.0 if thing.confidence is None else thing.confidence for thing in boxed], np.float32),
        "class_id": np.zeros(len(boxed), np.int64),
        "tracker_id": np.array(numbers, np.int64),
    }
