"""Boxes of objects in formats that other programs read: MOT challenge text, and COCO with tracks."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ndtorch.binding import BoundObject
from ndtorch.report.words import numbered
from ndtorch.run.result import RunResult

Row = tuple[int, int, float, float, float, float]
"""Frame from 1, number of the object, left, top, width and height in pixels."""


def box_rows(things: list[BoundObject], fps: float) -> Iterator[Row]:
    """Boxes of every sighting, in the order of frames."""
    rows = [
        (round(time * fps) + 1, number, left, top, right - left, bottom - top)
        for number, thing in numbered(things)
        for (time, *_), (left, top, right, bottom) in zip(thing.path, thing.boxes, strict=False)
    ]
    return iter(sorted(rows))


def write_exports(result: RunResult, folder: Path) -> None:
    """mot.txt and coco.json, of models whose objects have boxes; coordinates are pixels of the frames that it saw."""
    if not any(thing.boxes for thing in result.objects):
        return
    rows = list(box_rows(result.objects, result.frames / result.simulated_seconds))
    lines = [f"{f},{n},{x:.2f},{y:.2f},{w:.2f},{h:.2f},1,-1,-1,-1\n" for f, n, x, y, w, h in rows]
    (folder / "mot.txt").write_text("".join(lines), encoding="utf-8")
    (folder / "coco.json").write_text(json.dumps(coco(rows, result)), encoding="utf-8")


def coco(rows: list[Row], result: RunResult) -> dict[str, Any]:
    """Images, one category and annotations with track numbers."""
    height, width = result.size
    images = [
        {"id": frame, "frame_id": frame, "width": width, "height": height, "file_name": f"{frame:06d}"}
        for frame in sorted({row[0] for row in rows})
    ]
    annotations = [
        {
            "id": k,
            "image_id": frame,
            "category_id": 1,
            "track_id": number,
            "bbox": [round(side, 2) for side in (left, top, w, h)],
            "area": round(w * h, 2),
            "iscrowd": 0,
        }
        for k, (frame, number, left, top, w, h) in enumerate(rows, 1)
    ]
    category = {"id": 1, "name": "object"}
    return {
        "info": {"description": result.source},
        "images": images,
        "categories": [category],
        "annotations": annotations,
    }
