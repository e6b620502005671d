"""The record of tracks: a row for every object in every frame of the source in which it was seen.

List, timeline, overlay, CSV, parquet, MOT, COCO, JSON and report are written from it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ndtorch.binding import BoundObject
from ndtorch.run.result import Placed, RunResult

Floats = npt.NDArray[np.float64]
Whole = npt.NDArray[np.int64]


class TrackRecord(NamedTuple):
    """N rows of objects in M frames of a source, in the order of frames, then of objects.

    Attributes:
        name: of the source.
        size: height and width of its frames, pixels.
        frames: number of every frame that was looked at, from 1, `[M]`.
        times: its time stamp, s, `[M]`.
        files: its file name, of a folder; else None.
        objects: by their numbers.
        boxed: whether the objects have boxes.
        frame, time: number and time stamp of the frame of every row, `[N]`.
        clock: end of the model's step that the frame was in, seconds since the first frame, `[N]`.
        track: number of the object, `[N]`.
        state: "measured", "predicted" in a blob that it shares, "stationary", or "tentative" before it was known to be
            an object, `[N]`.
        box: left, top, right and bottom, pixels, `[N, 4]`; of objects without boxes its place twice.
        center: column and row of its place, pixels, `[N, 2]`.
        speed: pixels a second, `[N]`.
        area: pixels of its mask, else of its box, `[N]`.
        masks: of every row; None where there is none.
    """

    name: str
    size: tuple[int, int]
    frames: Whole
    times: Floats
    files: Sequence[str] | None
    objects: dict[int, BoundObject]
    boxed: bool
    frame: Whole
    time: Floats
    clock: Floats
    track: Whole
    state: npt.NDArray[np.str_]
    box: Floats
    center: Floats
    speed: Floats
    area: Floats
    masks: Sequence[Placed | None]

    def rows_of(self, track: int, gap: float = 0.0) -> list[int]:
        """Numbers of the rows of an object, at least `gap` seconds apart."""
        rows: list[int] = []
        for k in np.flatnonzero(self.track == track).tolist():
            if not rows or self.time[k] - self.time[rows[-1]] >= gap - 1e-6:
                rows.append(k)
        return rows

    def rows_at(self, clock: float) -> list[int]:
        """Numbers of the rows of the last frame of the model's step that ended at this time."""
        (rows,) = np.nonzero(np.abs(self.clock - clock) < 1e-6)
        return list(rows[self.frame[rows] == self.frame[rows].max(initial=0)])


def track_record(result: RunResult) -> TrackRecord:
    """The tracks of a run. Each frame of a source has what the step of the model that it was in has measured."""
    source, seen = result.source.decoded, result.first_frame + result.frames
    if source is None:
        frames, files = np.arange(1, seen + 1), None
        times, index = (frames - 1) / result.source.fps, np.arange(seen)
    else:
        (which,) = np.nonzero(source.tick < seen)  # NaN is not
        frames, times = which.astype(np.int64) + 1, source.stamp[which]
        files = None if source.names is None else [source.names[k] for k in which.tolist()]
        (shown,) = np.nonzero(source.tick[which] % 1 == 0)  # others were left out
        index = np.full(seen, -1)
        index[source.tick[which][shown].astype(int)] = shown
    rows = [row for thing in result.objects for row in rows_of(thing, result, index)]
    rows.sort(key=lambda row: (row[0], row[2]))
    which_frame, clock, track, state, box, center, speed, masks = zip(*rows, strict=True) if rows else [()] * 8
    at, boxes = np.array(which_frame, np.int64), np.array(box, np.float64).reshape(-1, 4)
    objects = {thing.number or 0: thing for thing in result.objects}
    whole = (boxes[:, 2:] - boxes[:, :2]).prod(1).tolist()
    area = [a if mask is None else float(mask.pixels.sum()) for mask, a in zip(masks, whole, strict=True)]
    return TrackRecord(
        name=result.source.name,
        size=result.source.full_size,
        frames=frames,
        times=times,
        files=files,
        objects=objects,
        boxed=any(thing.boxes for thing in result.objects),
        frame=frames[at],
        time=times[at],
        clock=np.array(clock, np.float64),
        track=np.array(track, np.int64),
        state=np.array(state, np.str_),
        box=boxes,
        center=np.array(center, np.float64).reshape(-1, 2),
        speed=np.array(speed, np.float64),
        area=np.array(area, np.float64),
        masks=masks,
    )


def rows_of(thing: BoundObject, result: RunResult, index: Whole) -> list[tuple[Any, ...]]:
    """Index of the frame, end of the step, number, state, box, center, speed and mask of an object in every frame."""
    if not thing.path:
        return []
    source, path = result.source, np.array(thing.path, np.float64)
    (height, width), to = source.full_size, source.pixel_map
    centers = to.points(path[:, 1:])
    boxes = np.tile(centers, 2) if not thing.boxes else to.points(np.array(thing.boxes, np.float64))
    boxes = np.clip(boxes, 0, [width, height] * 2)
    speed = np.zeros(len(path))
    if len(path) > 1:
        speed = np.hypot(*(np.gradient(column, path[:, 0]) for column in centers.T))
    rows, step = list[tuple[Any, ...]](), round(result.model.dt * source.fps)
    for k, last in enumerate(np.round(path[:, 0] * source.fps).astype(int).tolist()):
        mask = mask_of(result, thing, path[k, 0])
        state = thing.states[k] if thing.states else "measured"
        for tick in range(max(0, last - step + 1), last + 1):
            if tick < len(index) and index[tick] >= 0:
                row = path[k, 0], thing.number, state, boxes[k], centers[k], speed[k], mask
                rows.append((index[tick], *row))
    return rows


def mask_of(result: RunResult, thing: BoundObject, time: float) -> Placed | None:
    """The mask of an object at a step of the model in pixels of the source."""
    store, source = result.masks, result.source
    kept = None if thing.track is None else store.find(thing.track, time)
    if kept is None:
        return None
    import cv2

    to, (height, width) = source.pixel_map, source.full_size
    scale = source.size[0] / store.size[0] * to.scale_y, source.size[1] / store.size[1] * to.scale_x
    # A rim of nothing, so that interpolation rounds the corners of pixels at the edge too.
    padded = np.pad(kept.pixels, 1).astype(np.uint8) * np.uint8(255)
    top, left = (kept.top - 1) * scale[0] + to.top, (kept.left - 1) * scale[1] + to.left
    y, x = round(top), round(left)
    size = max(1, round(left + padded.shape[1] * scale[1]) - x), max(1, round(top + padded.shape[0] * scale[0]) - y)
    wide = np.asarray(cv2.resize(padded, size, interpolation=cv2.INTER_LINEAR)) > 127
    inside = wide[max(0, -y) : max(0, height - y), max(0, -x) : max(0, width - x)]
    return Placed(max(0, y), max(0, x), inside) if inside.any() else None
