"""Every method by its name: a clip in, what it sees out, with the processor time that took."""

from __future__ import annotations

import time
import zlib
from collections.abc import Callable, Iterator
from typing import Any

import cv2
import numpy as np
import torch

import ndtorch
from ndtorch.loading import model_kind
from ndtorch.run.opening import CAMERA_MODELS
from ndtorch.scenes.video import reduced
from ndtorch_train.score.labelled.peers import BoxTracker, ByteTrack, Norfair, Subtraction
from ndtorch_train.score.labelled.sight import Box, Clip, Packed, Pixels, Seen, Sight

TRACKERS: dict[str, Callable[[float], BoxTracker]] = {"norfair": Norfair, "bytetrack": ByteTrack}


def see(method: str, clip: Clip, rows: int = 0) -> Seen:
    """Run a method over a clip.

    Args:
        method: one of `LABELLED`, or the path of a model's folder.
        clip: the clip.
        rows: height to which every method gets the frames; 0 for their own.
    """
    kind, _, tracker = method.partition("-")
    if tracker in TRACKERS:
        return see_peer(kind, TRACKERS[tracker](clip.fps), clip, rows)
    return see_model(method, clip, rows)


def shrunk(clip: Clip, rows: int) -> Iterator[Pixels]:
    """The frames at that height."""
    size = (rows, max(8, round(rows * clip.size[1] / clip.size[0] / 8) * 8))
    for frame in clip.frames:
        yield reduced(frame, size) if rows else frame


def see_peer(kind: str, tracker: BoxTracker, clip: Clip, rows: int) -> Seen:
    """Background subtraction and a tracker of boxes."""
    subtract, seen = Subtraction(kind), Seen()
    height, width = clip.size
    for frame in shrunk(clip, rows):
        began = time.process_time()
        mask, boxes = subtract(frame)
        sights = tracker(boxes)
        seen.seconds += time.process_time() - began
        across, down = width / frame.shape[1], height / frame.shape[0]
        seen.sights.append([scaled(sight, across, down) for sight in sights])
        seen.masks.append(packed(mask, (height, width)))
    return seen


def scaled(sight: Sight, across: float, down: float) -> Sight:
    """A sight in pixels of the clip."""
    box = Box(sight.box.left * across, sight.box.top * down, sight.box.right * across, sight.box.bottom * down)
    return Sight(sight.track, (sight.place[0] * across, sight.place[1] * down), box)


def packed(mask: Any, size: tuple[int, int]) -> Packed:
    """A mask at the size of the clip."""
    mask = np.asarray(mask, np.uint8)
    if mask.shape != size:
        mask = np.asarray(cv2.resize(mask, size[::-1], interpolation=cv2.INTER_NEAREST), np.uint8)
    return Packed(mask > 0)


def see_model(name: str, clip: Clip, rows: int) -> Seen:
    """A model with tracks: objects are said from their first sighting on, once they are known to be objects."""
    seen = Seen()
    # As `ndtorch bind` gives them.
    most = CAMERA_MODELS.get(model_kind(name), clip.size[0])
    frames = list(shrunk(clip, min(rows or clip.size[0], most)))
    height, width = frames[0].shape[:2]
    model, state = ndtorch.load(name, size=(height, width), fps=clip.fps), None
    shapes: list[Any] = []
    with torch.inference_mode():
        for start in range(0, len(frames), 8):
            chunk = np.stack([frame[..., ::-1] for frame in frames[start : start + 8]])
            began = time.process_time()
            signals, state = model(torch.from_numpy(chunk).permute(0, 3, 1, 2), state)
            seen.seconds += time.process_time() - began
            if hasattr(signals, "silhouettes"):
                shapes += [zlib.compress(one.numpy().tobytes(), 1) for one in signals.silhouettes]
                form = tuple(signals.silhouettes.shape[1:])
        things = model.objects(state)
    across, down = clip.size[1] / width, clip.size[0] / height
    seen.sights = [[] for _ in frames]
    for thing in things:
        for k, (at, column, row) in enumerate(thing.path):
            number = round(at * clip.fps)
            box = Box(*thing.boxes[k]) if thing.boxes else Box(column, row, column, row)
            seen.sights[number].append(scaled(Sight(thing.track or 0, (column, row), box), across, down))
    known = [(thing.track or 0) + 1 for thing in things]
    for one in shapes:
        names = np.frombuffer(zlib.decompress(one), np.int32).reshape(form)
        image = np.isin(names, known).astype(np.uint8) * 255
        wide = cv2.resize(image, clip.size[::-1], interpolation=cv2.INTER_LINEAR)
        seen.masks.append(Packed(np.asarray(wide) > 127))
    return seen
