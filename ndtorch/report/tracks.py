"""The tracks of a run in the terms of its source, frame numbers, time stamps and pixels: what every export is of."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from torch import Tensor

from ndtorch.binding import BoundObject
from ndtorch.report.summary import numbered
from ndtorch.run.pictures import MAX_DETECTIONS
from ndtorch.run.result import RunResult, Watcher

Floats = npt.NDArray[np.float64]
Whole = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]


class Placed(NamedTuple):
    """A mask in the picture: row and column of its first pixel, and its pixels `[h, w]`."""

    top: int
    left: int
    pixels: Mask


class MaskStore(Watcher):
    """The mask of every track at every step of the model, in its working image; the latest `MAX_DETECTIONS` of them."""

    def __init__(self) -> None:
        self.size = (1, 1)
        self._packed: dict[tuple[int, int], tuple[int, int, int, int, bytes]] = {}

    def signals(self, signals: Any, weights: Tensor, state: Any) -> None:
        if not hasattr(signals, "labels"):
            return
        for time, labels in zip(signals.time.tolist(), signals.labels.cpu().numpy(), strict=True):
            self.size = labels.shape
            rows, columns = np.nonzero(labels)
            owner = labels[rows, columns]
            for number in np.unique(owner).tolist():
                own = owner == number
                top, left = int(rows[own].min()), int(columns[own].min())
                part = labels[top : rows[own].max() + 1, left : columns[own].max() + 1] == number
                self._packed[number - 1, round(1e4 * time)] = (top, left, *part.shape, np.packbits(part).tobytes())
        while len(self._packed) > MAX_DETECTIONS:
            del self._packed[next(iter(self._packed))]

    def find(self, track: int, time: float) -> Placed | None:
        """The mask of a track at a step; None where it has none."""
        kept = self._packed.get((track, round(1e4 * time)))
        if kept is None:
            return None
        top, left, height, width, bits = kept
        pixels = np.unpackbits(np.frombuffer(bits, np.uint8), count=height * width).reshape(height, width)
        return Placed(top, left, pixels.astype(bool))


class SourceTracks(NamedTuple):
    """N boxes of objects in M frames of a source, in the order of frames, then of objects.

    Attributes:
        name: of the source.
        size: height and width of its frames, pixels.
        frames: number of every frame that was looked at, from 1, `[M]`.
        times: its time stamp, s, `[M]`.
        files: its file name, of a folder; else None.
        frame, time: number and time stamp of the frame of every box, `[N]`.
        track: number of its object, from 1 in the order in which they appeared, `[N]`.
        box: left, top, right and bottom, pixels, `[N, 4]`.
        center: column and row of the middle of its mask, pixels, `[N, 2]`.
        speed: pixels a second, `[N]`.
        confidence: of its object, 0 to 1, `[N]`; 1 of models that do not say.
        area: pixels of its mask, else of its box, `[N]`.
        masks: of every box; None where there is none.
        objects: by their numbers.
    """

    name: str
    size: tuple[int, int]
    frames: Whole
    times: Floats
    files: Sequence[str] | None
    frame: Whole
    time: Floats
    track: Whole
    box: Floats
    center: Floats
    speed: Floats
    confidence: Floats
    area: Floats
    masks: Sequence[Placed | None]
    objects: dict[int, BoundObject]


def source_tracks(result: RunResult) -> SourceTracks:
    """The objects of a run at every frame of its source at which they were seen.

    Between two steps of a model that averages several frames, boxes are interpolated; masks are those of the nearer
    step, moved along.
    """
    source, seen = result.source_frames, result.first_frame + result.frames
    if source is None:
        ticks, files = np.arange(seen, dtype=np.float64), None
        frames, times = np.arange(1, seen + 1), ticks / result.fps
    else:
        (which,) = np.nonzero(source.tick < seen)  # NaN is not
        ticks, frames, times = source.tick[which], which.astype(np.int64) + 1, source.stamp[which]
        files = None if source.names is None else [source.names[k] for k in which.tolist()]
    objects = dict(numbered(result.objects))
    rows = [
        (int(frames[k]), float(times[k]), number, *row)
        for number, thing in objects.items()
        if thing.boxes
        for k, *row in track_rows(thing, ticks, times, result)
    ]
    rows.sort(key=lambda row: (row[0], row[2]))
    frame, time, track, box, center, speed, mask = zip(*rows, strict=True) if rows else [()] * 7
    boxes = np.array(box, np.float64).reshape(-1, 4)
    sides = boxes[:, 2:] - boxes[:, :2]
    sure = [objects[number].confidence for number in track]
    area = [a if one is None else one.pixels.sum() for one, a in zip(mask, sides.prod(1).tolist(), strict=True)]
    return SourceTracks(
        result.source,
        result.full_size,
        frames,
        times,
        files,
        np.array(frame, np.int64),
        np.array(time, np.float64),
        np.array(track, np.int64),
        boxes,
        np.array(center, np.float64).reshape(-1, 2),
        np.array(speed, np.float64),
        np.array([1.0 if one is None else one for one in sure], np.float64),
        np.array(area, np.float64),
        mask,
        objects,
    )


def track_rows(thing: BoundObject, ticks: Floats, times: Floats, result: RunResult) -> list[tuple[Any, ...]]:
    """Index of the frame, box, center, speed and mask of an object at every frame that shows it."""
    path = np.array(thing.path, np.float64)
    # The mean of several frames shows an object where it was in the middle of them.
    own = path[:, 0] * result.fps - (result.step_frames - 1) / 2
    values = np.concatenate([np.array(thing.boxes, np.float64), path[:, 1:]], 1)
    after = np.clip(np.searchsorted(own, ticks - 1e-5), 0, len(own) - 1)
    before = np.maximum(after - 1, 0)
    exact = np.abs(ticks - own[after]) < 1e-5
    between = (own[before] < ticks) & (ticks < own[after]) & (own[after] - own[before] <= 1.5 * result.step_frames)
    (which,) = np.nonzero(exact | between)
    if not len(which):
        return []
    at = np.stack([np.interp(ticks[which], own, column) for column in values.T], 1)
    height, width = result.full_size
    to = result.pixel_map
    boxes, centers = np.clip(to.points(at[:, :4]), 0, [width, height] * 2), to.points(at[:, 4:])
    speed = np.zeros(len(which))
    if len(which) > 1:
        speed = np.hypot(*(np.gradient(column, times[which]) for column in centers.T))
    nearer = ticks[which] - own[before[which]] < own[after[which]] - ticks[which]
    near = np.where(~exact[which] & nearer, before[which], after[which])
    moved = centers - to.points(values[near, 4:])
    masks = [mask_of(result, thing, path[n, 0], shift) for n, shift in zip(near, moved, strict=True)]
    return list(zip(which.tolist(), boxes, centers, speed, masks, strict=True))


def mask_of(result: RunResult, thing: BoundObject, time: float, moved: Floats) -> Placed | None:
    """The mask of an object at a step of the model in pixels of the source, moved by columns and rows."""
    store: MaskStore | None = result.masks
    kept = None if store is None or thing.track is None else store.find(thing.track, time)
    if kept is None or store is None:
        return None
    import cv2

    to, (height, width) = result.pixel_map, result.full_size
    scale = result.size[0] / store.size[0] * to.scale_y, result.size[1] / store.size[1] * to.scale_x
    # A rim of nothing, so that interpolation rounds the corners of pixels at the edge too.
    padded = np.pad(kept.pixels, 1).astype(np.uint8) * np.uint8(255)
    top = (kept.top - 1) * scale[0] + to.top + moved[1]
    left = (kept.left - 1) * scale[1] + to.left + moved[0]
    y, x = round(top), round(left)
    size = max(1, round(left + padded.shape[1] * scale[1]) - x), max(1, round(top + padded.shape[0] * scale[0]) - y)
    wide = np.asarray(cv2.resize(padded, size, interpolation=cv2.INTER_LINEAR)) > 127
    inside = wide[max(0, -y) : max(0, height - y), max(0, -x) : max(0, width - x)]
    return Placed(max(0, y), max(0, x), inside) if inside.any() else None
