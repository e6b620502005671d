"""What a run found, in formats that other programs read; `FORMATS` names them.

Every format speaks the language of the source: pixels of its frames (upright, before they are made smaller), the number
of a frame as a reader of the source counts, from 1, and the source's own time stamps.
"""

from __future__ import annotations

import csv
import json
import logging
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ndtorch.binding import BoundObject
from ndtorch.report.source_tracks import Placed, SourceTracks, source_tracks
from ndtorch.run.result import RunResult
from ndtorch.vision.features import FEATURES

log = logging.getLogger(__name__)


def write_exports(result: RunResult, folder: Path, tracks: SourceTracks | None = None) -> None:
    """Write the file of every format, of models whose objects have boxes."""
    if not result.has_boxes:
        return
    tracks = source_tracks(result) if tracks is None else tracks
    for name, write in FORMATS.items():
        if name.endswith(".parquet") and find_spec("pyarrow") is None:
            log.info("%s is not written: pyarrow is not installed; pip install 'ndtorch[parquet]'", name)
            continue
        write(tracks, folder / name)


def write_coco(tracks: SourceTracks, path: Path) -> None:
    """coco.json, which pycocotools, CVAT and FiftyOne read: images (those without objects too), annotations, tracks."""
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


def write_mot(tracks: SourceTracks, path: Path) -> None:
    """mot.txt, which motmetrics and TrackEval read: frame and object from 1, left, top, width, height, confidence."""
    lines = [
        f"{frame},{track},{left:.2f},{top:.2f},{right - left:.2f},{bottom - top:.2f},{sure:.3f},-1,-1,-1\n"
        for frame, track, (left, top, right, bottom), sure in zip(
            tracks.frame.tolist(), tracks.track.tolist(), tracks.box.tolist(), tracks.confidence.tolist(), strict=True
        )
    ]
    path.write_text("".join(lines), encoding="utf-8")


def columns(tracks: SourceTracks) -> dict[str, Any]:
    """Frame, time, track, box, center, area, speed, confidence, and the features of the object, a column each."""
    left, top, right, bottom = tracks.box.T
    found: dict[str, Any] = {
        "frame": tracks.frame,
        "time": tracks.time,
        "track": tracks.track,
        "left": left,
        "top": top,
        "width": right - left,
        "height": bottom - top,
        "center_x": tracks.center[:, 0],
        "center_y": tracks.center[:, 1],
        "area": tracks.area,
        "speed": tracks.speed,
        "confidence": tracks.confidence,
    }
    for name in FEATURES:
        own = [tracks.objects[number].features.get(name, 0.0) for number in tracks.track.tolist()]
        found["feature_" + name.replace("°", "deg")] = np.array(own, np.float64)  # `left` is a side of the box
    return found


def write_csv(tracks: SourceTracks, path: Path) -> None:
    """tracks.csv, for spreadsheets: a row a box, with four decimals."""
    table = columns(tracks)
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(table)
        for row in zip(*(column.tolist() for column in table.values()), strict=True):
            writer.writerow([f"{value:.4f}" if isinstance(value, float) else value for value in row])


def write_parquet(tracks: SourceTracks, path: Path) -> None:
    """tracks.parquet, for pandas, polars, R and DuckDB: the table of tracks.csv with its types."""
    import pyarrow
    import pyarrow.parquet

    pyarrow.parquet.write_table(pyarrow.table(columns(tracks)), path)


FORMATS: dict[str, Callable[[SourceTracks, Path], None]] = {
    "coco.json": write_coco,
    "mot.txt": write_mot,
    "tracks.csv": write_csv,
    "tracks.parquet": write_parquet,
}
"""What writes each file; for another format add its function here."""


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
