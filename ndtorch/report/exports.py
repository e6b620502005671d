"""Objects and responses of a run in formats that other programs read; `FORMATS` names those of tracks.

Every format has the terms of the source: pixels of its frames (upright, before they are made smaller), the number of a
frame as a reader of the source counts, from 1, and the source's own time stamps.
"""

from __future__ import annotations

import csv
import json
import logging
import math
from collections.abc import Callable, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from torch import Tensor

from ndtorch.binding import BindingModel
from ndtorch.report.summary import words
from ndtorch.report.tracks import TrackRecord
from ndtorch.run.result import Placed, Watcher
from ndtorch.vision.features import FEATURES

log = logging.getLogger(__name__)

Array = np.ndarray[Any, Any]


def write_coco(tracks: TrackRecord, path: Path) -> None:
    """coco.json, which pycocotools, CVAT and FiftyOne read: images (those without objects too), annotations, tracks."""
    height, width = tracks.size
    files = [f"{n:06d}.jpg" for n in tracks.frames.tolist()] if tracks.files is None else tracks.files
    images = [
        {"id": n, "frame_id": n, "width": width, "height": height, "file_name": file, "time": round(time, 6)}
        for n, time, file in zip(tracks.frames.tolist(), tracks.times.tolist(), files, strict=True)
    ]
    annotations = []
    for k, (left, top, right, bottom) in enumerate(tracks.box.tolist()):
        whole = np.ones((max(1, round(bottom - top)), max(1, round(right - left))), bool)
        mask = tracks.masks[k] or Placed(round(top), round(left), whole)
        annotations.append(
            {
                **{"id": k + 1, "image_id": int(tracks.frame[k]), "category_id": 1, "iscrowd": 0},
                **{"track_id": int(tracks.track[k]), "state": str(tracks.state[k])},
                **{"area": round(float(tracks.area[k]), 2), "score": 1.0},
                "bbox": [round(side, 2) for side in (left, top, right - left, bottom - top)],
                "segmentation": {"size": [height, width], "counts": run_lengths(mask, height, width)},
            }
        )
    about = {"info": {"description": tracks.name}, "images": images, "annotations": annotations}
    path.write_text(json.dumps({**about, "categories": [{"id": 1, "name": "object"}]}), encoding="utf-8")


def run_lengths(mask: Placed, height: int, width: int) -> str:
    """Lengths of the runs of 0 and 1 of a mask, column after column, as the text that COCO packs them into: differences
    to the run before last, five bits a letter.
    """
    crop = mask.pixels[: height - mask.top, : width - mask.left]
    columns = np.zeros((crop.shape[1], height), np.int8)
    columns[:, mask.top : mask.top + len(crop)] = crop.T
    edges = np.flatnonzero(np.diff(np.pad(columns.ravel(), 1))) + mask.left * height
    counts = np.diff([0, *edges.tolist(), height * width]).tolist()
    letters = []
    for k, count in enumerate(counts if counts[-1] else counts[:-1]):
        value, more = count - counts[k - 2] if k > 2 else count, True
        while more:
            low, value = value & 31, value >> 5
            more = value != (-1 if low & 16 else 0)
            letters.append(chr(low + 32 * more + 48))
    return "".join(letters)


STATES = ("tentative", "measured", "predicted", "stationary")
"""States by their number in mot.txt."""


def write_mot(tracks: TrackRecord, path: Path) -> None:
    """mot.txt, which motmetrics and TrackEval read: frame, object, left, top, width, height, confidence (1), -1, -1,
    number of the state."""
    columns = (tracks.frame, tracks.track, tracks.box, tracks.state)
    lines = [
        f"{frame},{track},{left:.2f},{top:.2f},{right - left:.2f},{bottom - top:.2f},1,-1,-1,{STATES.index(state)}\n"
        for frame, track, (left, top, right, bottom), state in zip(*(c.tolist() for c in columns), strict=True)
    ]
    path.write_text("".join(lines), encoding="utf-8")


def table(tracks: TrackRecord) -> dict[str, Any]:
    """A column each for frame, time, track, state, box, center, area, speed, features of the object."""
    left, top, right, bottom = tracks.box.T
    columns: dict[str, Any] = {
        **{name: getattr(tracks, name) for name in ("frame", "time", "track", "state")},
        **{"left": left, "top": top, "width": right - left, "height": bottom - top},
        **{"center_x": tracks.center[:, 0], "center_y": tracks.center[:, 1]},
        **{name: getattr(tracks, name) for name in ("area", "speed")},
    }
    for name in FEATURES:
        own = [tracks.objects[number].features.get(name, 0.0) for number in tracks.track.tolist()]
        columns["feature_" + name.replace("°", "deg")] = np.array(own, np.float64)  # `left` is a side of the box
    return columns


def write_table(columns: Mapping[str, Sequence[Any]], path: Path, digits: str = "") -> None:
    """Columns of one length as .csv, for spreadsheets, or .parquet with their types, for pandas, polars, R and DuckDB.

    Without pyarrow there is no .parquet, and the log says so.

    Args:
        digits: format of the floats in .csv.
    """
    if path.suffix == ".csv":
        with path.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(columns)
            for row in zip(*(np.asarray(column).tolist() for column in columns.values()), strict=True):
                writer.writerow([format(value, digits) if isinstance(value, float) else value for value in row])
    elif find_spec("pyarrow") is None:
        log.info("%s is not written: pyarrow is not installed; pip install 'ndtorch[parquet]'", path.name)
    else:
        import pyarrow
        import pyarrow.parquet

        arrays = {name: arrow(column) for name, column in columns.items()}
        pyarrow.parquet.write_table(pyarrow.table(arrays), path)


FORMATS: dict[str, Callable[[TrackRecord, Path], None]] = {
    "coco.json": write_coco,
    "mot.txt": write_mot,
    "tracks.csv": lambda tracks, path: write_table(table(tracks), path, ".4f"),
    "tracks.parquet": lambda tracks, path: write_table(table(tracks), path),
}
"""What writes each file; for another format add its function here."""


def arrow(values: Any, valid: Array | None = None) -> Any:
    """Numbers or texts as an array of pyarrow, without its conversions, which import pandas: one or two seconds.

    Args:
        valid: which are not null; None for all.
    """
    import pyarrow

    values = np.asarray(values)
    kind, parts, length = values.dtype.name, [values], values.size
    if values.dtype.kind == "U":
        texts = [text.encode() for text in values.tolist()]
        offsets = np.cumsum([0, *map(len, texts)], dtype=np.int32)
        kind, parts = "string", [offsets, np.frombuffer(b"".join(texts), np.uint8)]
    bits = None if valid is None else np.packbits(valid, bitorder="little")
    buffers = [None if part is None else pyarrow.py_buffer(np.ascontiguousarray(part)) for part in (bits, *parts)]
    return pyarrow.Array.from_buffers(getattr(pyarrow, kind)(), length, buffers)


class ResponseFile(Watcher):
    """responses.parquet: time, ten inputs, ten outputs, objects (count, confidence and words, read once a second) and,
    once a chunk of frames, weights `[100]`, row after row.

    With many receptive fields, inputs and outputs are the largest of all. It needs pyarrow.
    """

    def __init__(self, path: Path, model: BindingModel) -> None:
        import pyarrow
        import pyarrow.parquet

        single, names = pyarrow.float32(), [name.replace("°", "deg") for name in FEATURES]
        fields = [(f"{kind}_{name}", single) for kind in ("input", "output") for name in names]
        fields += [("count", pyarrow.int32()), ("confidence", pyarrow.float64()), ("objects", pyarrow.string())]
        self.model, self.read_at = model, -math.inf
        self.found: tuple[int, float | None, str] = (0, None, "")
        self.schema = pyarrow.schema([("time", pyarrow.float64()), *fields, ("weights", pyarrow.list_(single, 100))])
        self.writer = pyarrow.parquet.ParquetWriter(path, self.schema)

    def signals(self, signals: Any, weights: Tensor, state: Any) -> None:
        import pyarrow

        if steps := len(signals.time):
            times, columns = signals.time.cpu().double().numpy(), list[Array]()
            for values in (getattr(signals, "inputs", None), signals.outputs):
                each = signals.fields if values is None else values
                whole = each if each.ndim == 2 else each.flatten(1, -2).amax(1)
                columns += list(whole.cpu().float().numpy().T)
            arrays = [arrow(times), *map(arrow, columns)]
            if times[-1] >= self.read_at + 1.0:  # it takes milliseconds
                things = self.model.visible_objects(state)
                self.found = len(things), self.model.confidence(state), "; ".join(map(words, things))
                self.read_at = times[-1]
            count, sure, text = self.found
            arrays += [
                arrow(np.full(steps, count, np.int32)),
                arrow(np.full(steps, sure or 0.0), np.full(steps, sure is not None)),
                arrow([text] * steps),
            ]
            matrices = np.zeros((steps, 100), np.float32)
            matrices[-1] = weights.cpu().float().flatten().numpy()
            last = np.packbits(np.arange(steps) == steps - 1, bitorder="little")
            nested, single = self.schema.types[-1], arrow(matrices)
            arrays.append(pyarrow.Array.from_buffers(nested, steps, [pyarrow.py_buffer(last)], children=[single]))
            self.writer.write_table(pyarrow.Table.from_arrays(arrays, schema=self.schema))

    def close(self) -> None:
        self.writer.close()
