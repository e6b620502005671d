"""coco.json: every frame, boxes and masks as run lengths, which pycocotools, CVAT and FiftyOne read."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ndtorch.report.exports.source_tracks import Placed, SourceTracks

FILE = "coco.json"


def write(tracks: SourceTracks, path: Path) -> None:
    """Images, one category, and annotations with `track_id`; frames without objects are listed too."""
    height, width = tracks.size
    files = [f"{n:06d}.jpg" for n in tracks.frames.tolist()] if tracks.files is None else tracks.files
    images = [
        {"id": n, "frame_id": n, "width": width, "height": height, "file_name": file, "time": round(time, 6)}
        for n, time, file in zip(tracks.frames.tolist(), tracks.times.tolist(), files, strict=True)
    ]
    annotations = [annotation(tracks, k) for k in range(len(tracks.frame))]
    about = {
        "info": {"description": tracks.name},
        "images": images,
        "categories": [{"id": 1, "name": "object"}],
        "annotations": annotations,
    }
    path.write_text(json.dumps(about), encoding="utf-8")


def annotation(tracks: SourceTracks, k: int) -> dict[str, Any]:
    """Box number k."""
    left, top, right, bottom = tracks.box[k].tolist()
    mask = tracks.mask(k)
    if mask is None:
        mask = Placed(
            round(top), round(left), np.ones((max(1, round(bottom - top)), max(1, round(right - left))), bool)
        )
    return {
        "id": k + 1,
        "image_id": int(tracks.frame[k]),
        "category_id": 1,
        "track_id": int(tracks.track[k]),
        "bbox": [round(side, 2) for side in (left, top, right - left, bottom - top)],
        "segmentation": {"size": list(tracks.size), "counts": encode(run_lengths(mask, *tracks.size))},
        "area": round(float(tracks.area[k]), 2),
        "score": round(float(tracks.confidence[k]), 3),
        "iscrowd": 0,
    }


def run_lengths(mask: Placed, height: int, width: int) -> npt.NDArray[np.int64]:
    """Lengths of the runs of 0 and 1 of a mask, column after column, beginning with 0.

    >>> run_lengths(Placed(1, 1, np.ones((2, 1), bool)), 3, 3).tolist()
    [4, 2, 3]
    """
    crop = mask.pixels[: height - mask.top, : width - mask.left]
    edges = np.diff(np.pad(crop.astype(np.int8), ((1, 1), (0, 0))), axis=0).T
    columns, rows = np.nonzero(edges)
    places = (mask.left + columns) * height + mask.top + rows
    # A run that ends where the next begins goes on: columns that are full to the edge.
    same = np.nonzero(np.diff(places) == 0)[0]
    places = np.delete(places, np.concatenate([same, same + 1]))
    lengths = np.diff(np.concatenate([[0], places, [height * width]]))
    return lengths if lengths[-1] else lengths[:-1]


def encode(counts: npt.NDArray[np.int64]) -> str:
    """Run lengths as the text that COCO packs them into: differences to the run before last, five bits a letter."""
    values = counts.copy()
    values[3:] -= counts[1:-2]
    letters = np.zeros((len(values), 13), np.int64)
    used = np.zeros(letters.shape, bool)
    going = np.ones(len(values), bool)
    for k in range(letters.shape[1]):
        low = values & 31
        values = values >> 5
        more = np.where(low & 16, values != -1, values != 0)
        letters[:, k], used[:, k] = low + 32 * more + 48, going
        going = going & more
        if not going.any():
            break
    return bytes(letters[used].astype(np.uint8)).decode("ascii")
