"""tracks.csv: a row a box, for spreadsheets, pandas and R; the columns are those of tracks.parquet too."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np

from ndtorch.report.exports.source_tracks import SourceTracks
from ndtorch.vision.features import FEATURES

FILE = "tracks.csv"


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


def write(tracks: SourceTracks, path: Path) -> None:
    """Write the columns, with four decimals."""
    table = columns(tracks)
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(table)
        for row in zip(*(column.tolist() for column in table.values()), strict=True):
            writer.writerow([f"{value:.4f}" if isinstance(value, float) else value for value in row])
