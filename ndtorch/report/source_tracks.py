"""The tracks of a run in the language of its source: its frame numbers, time stamps and pixels."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ndtorch.binding import BoundObject
from ndtorch.report.mask_store import MaskStore
from ndtorch.report.words import numbered
from ndtorch.run.result import RunResult
from ndtorch.scenes.base import PixelMap

Floats = npt.NDArray[np.float64]
Whole = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]


class Placed(NamedTuple):
    """A mask in the picture: row and column of its first pixel, and its pixels `[h, w]`."""

    top: int
    left: int
    pixels: Mask


class SourceTracks(NamedTuple):
    """N boxes of objects in M frames of a source.

    Attributes:
        name: of the source.
        size: height and width of its frames, pixels.
        frames: number of every frame that was looked at, from 1, `[M]`.
        times: its time stamp, s, `[M]`.
        files: its file name, of a folder; else None.
        frame: number of the frame of every box, `[N]`; boxes are in the order of frames, then of objects.
        time: its time stamp, s, `[N]`.
        track: number of its object, from 1 in the order in which they appeared, `[N]`.
        box: left, top, right and bottom, pixels, `[N, 4]`.
        center: column and row of the middle of its mask, pixels, `[N, 2]`.
        speed: pixels a second, `[N]`.
        confidence: of its object, 0 to 1, `[N]`; 1 of models that do not say.
        objects: by their numbers.
        mask: gives that of a box by its place here, None where there is none.
        area: pixels of its mask, else of its box, `[N]`.
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
    objects: dict[int, BoundObject]
    mask: Callable[[int], Placed | None]
    area: Floats


def source_tracks(result: RunResult) -> SourceTracks:
    """The objects of a run at every frame of its source at which they were seen.

    Between two steps of the model, which takes the mean of several frames of a quick camera and leaves frames out that
    come too often, boxes are interpolated; masks are those of the nearer step, moved along.
    """
    frames, times, ticks, files = frames_of(result)
    rows = list[tuple[Any, ...]]()
    for number, thing in numbered(result.objects):
        if thing.boxes:
            rows += track_rows(number, thing, ticks, times, frames, result)
    rows.sort(key=lambda row: (row[0], row[2]))
    columns = list(zip(*rows, strict=True)) if rows else [()] * 8
    frame, time, track, box, center, speed, source, area = columns
    sure = {n: 1.0 if one.confidence is None else one.confidence for n, one in numbered(result.objects)}
    return SourceTracks(
        result.source,
        result.full_size,
        frames,
        times,
        files,
        np.array(frame, np.int64),
        np.array(time, np.float64),
        np.array(track, np.int64),
        np.array(box, np.float64).reshape(-1, 4),
        np.array(center, np.float64).reshape(-1, 2),
        np.array(speed, np.float64),
        np.array([sure[number] for number in track], np.float64),
        dict(numbered(result.objects)),
        lambda k: mask_of(result, *source[k]),
        np.array(area, np.float64),
    )


def frames_of(result: RunResult) -> tuple[Whole, Floats, Floats, Sequence[str] | None]:
    """Numbers, time stamps, ticks and file names of the frames that a run looked at."""
    seen = result.first_frame + result.frames
    source = result.source_frames
    if source is None:
        ticks = np.arange(seen, dtype=np.float64)
        return np.arange(1, seen + 1), ticks / result.fps, ticks, None
    (which,) = np.nonzero(source.tick < seen)  # NaN is not
    files = None if source.names is None else [source.names[k] for k in which.tolist()]
    return which.astype(np.int64) + 1, source.stamp[which], source.tick[which], files


def track_rows(
    number: int, thing: BoundObject, ticks: Floats, times: Floats, frames: Whole, result: RunResult
) -> list[tuple[Any, ...]]:
    """Frame, time, number, box, center, speed, what its mask is of, and area, at every frame that shows an object."""
    path = np.array(thing.path, np.float64)
    # The mean of several frames shows an object where it was in the middle of them.
    own = path[:, 0] * result.fps - (result.step_frames - 1) / 2
    values = np.concatenate([np.array(thing.boxes, np.float64), path[:, 1:]], 1)
    before = np.searchsorted(own, ticks + 1e-6, side="right") - 1
    after = np.minimum(before + 1, len(own) - 1)
    base = np.maximum(before, 0)
    gap = own[after] - own[base]
    exact = np.abs(ticks - own[base]) < 1e-5
    between = (gap > 0) & (gap <= 1.5 * result.step_frames) & (ticks <= own[after])
    (which,) = np.nonzero((before >= 0) & (exact | between))
    if len(which) == 0:
        return []
    base, after = base[which], after[which]
    share = np.where(exact[which], 0.0, (ticks[which] - own[base]) / np.maximum(gap[which], 1e-9))[:, None]
    at = values[base] + share * (values[after] - values[base])
    to = result.pixel_map
    boxes, centers = to.points(at[:, :4]), to.points(at[:, 4:])
    height, width = result.full_size
    boxes = np.clip(boxes, 0, [width, height, width, height])
    stamps = times[which]
    near = np.where(share[:, 0] < 0.5, base, after)
    rows = list[tuple[Any, ...]]()
    for k, speed in enumerate(speeds(stamps, centers)):
        moved = centers[k] - to.points(values[near[k] : near[k] + 1, 4:])[0]
        source = (thing, float(path[near[k], 0]), moved)
        mask = mask_of(result, *source)
        left, top, right, bottom = boxes[k]
        area = (right - left) * (bottom - top) if mask is None else float(mask.pixels.sum())
        rows.append((frames[which[k]], stamps[k], number, boxes[k], centers[k], speed, source, area))
    return rows


def speeds(times: Floats, centers: Floats) -> Floats:
    """Pixels a second along a path, from the places before and after."""
    if len(times) < 2:
        return np.zeros(len(times))
    first = np.maximum(np.arange(len(times)) - 1, 0)
    last = np.minimum(np.arange(len(times)) + 1, len(times) - 1)
    span = times[last] - times[first]
    away = np.hypot(*(centers[last] - centers[first]).T)
    return np.asarray(np.divide(away, span, out=np.zeros(len(times)), where=span > 0), dtype=np.float64)


def mask_of(result: RunResult, thing: BoundObject, time: float, moved: Floats) -> Placed | None:
    """The mask of an object at a step of the model, in pixels of the source, moved by columns and rows."""
    store: MaskStore | None = result.masks
    found = None if store is None or thing.track is None else store.find(thing.track, time)
    if found is None or store is None:
        return None
    top, left, crop = found
    return enlarged(top, left, crop, store.size, result.size, result.pixel_map, moved, result.full_size)


def enlarged(
    top: int,
    left: int,
    crop: Mask,
    small: tuple[int, int],
    size: tuple[int, int],
    to: PixelMap,
    moved: Floats,
    full: tuple[int, int],
) -> Placed | None:
    """A mask of the working image, `small`, in pixels of the source, moved by columns and rows; None where nothing is
    inside the picture. `to` leads from frames of `size` to those of the source, `full`.
    """
    import cv2

    scale = size[0] / small[0] * to.scale_y, size[1] / small[1] * to.scale_x
    # A rim of nothing, so that interpolation rounds the corners of pixels at the edge too.
    padded = np.pad(crop, 1).astype(np.uint8) * np.uint8(255)
    first = (top - 1) * scale[0] + to.top + moved[1], (left - 1) * scale[1] + to.left + moved[0]
    last = first[0] + padded.shape[0] * scale[0], first[1] + padded.shape[1] * scale[1]
    (y, x), (bottom, right) = (round(first[0]), round(first[1])), (round(last[0]), round(last[1]))
    wide = np.asarray(cv2.resize(padded, (max(1, right - x), max(1, bottom - y)), interpolation=cv2.INTER_LINEAR)) > 127
    inside = wide[max(0, -y) : max(0, full[0] - y), max(0, -x) : max(0, full[1] - x)]
    return Placed(max(0, y), max(0, x), inside) if inside.any() else None
