"""Pictures of a run, made beside it in a thread: enhanced images, or the frame with the objects in sight."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ndtorch.binding import Attention, BoundObject
from ndtorch.run.result import Moment, Picture, Pixels, Watcher
from ndtorch.scenes.base import FrameSource
from ndtorch.vision import FilterState
from ndtorch.vision.frames import as_float, check_frames

MOMENT_S = 3.0
"""A moment is kept for this long before a less clear but more recent one may take its place."""


class PictureMaker:
    """Makes pictures one after the other, and keeps the clearest recent one of every winner.

    Args:
        model: whose objects to show; with a table of owners, its feature images make the enhanced image.
        source: of the frames.
        dt: seconds between pictures.
        watchers: who gets the pictures.

    Attributes:
        moments: by number of the winning neuron.
    """

    def __init__(self, model: Any, source: FrameSource, dt: float, watchers: Sequence[Watcher]) -> None:
        self.model, self.source, self.watchers = model, source, watchers
        self.attention = None if model.tracks else Attention(dt, model.config.normalise.tau_sums)
        self.moments: dict[int, Moment] = {}
        self._state: FilterState | None = None
        self._thread = ThreadPoolExecutor(1, "pictures")
        self._last: Future[None] | None = None

    def take(self, time: float, frame: Tensor, signals: Any, state: Any, numbers: Objects) -> None:
        """Make a picture of a frame `[3, H, W]`, signals and state right after it; waits for the one before."""
        self.wait()
        if self.model.tracks:
            things = [self._placed(one) for one in numbers.numbered(self.model.visible_objects(state))]
            large = self.source.latest()
            picture = Picture(time, to_pixels(shown(frame)) if large is None else large, objects=tuple(things))
            self._last = self._thread.submit(self._show, picture)
        else:
            table = self.model.table(state)
            self._last = self._thread.submit(self._enhance, time, frame.clone(), signals, state, table)

    def wait(self) -> None:
        """Wait for the picture that is being made; raises what it raised."""
        if self._last is not None:
            self._last.result()

    def _placed(self, thing: BoundObject) -> BoundObject:
        """An object with its latest place and box alone, in pixels of the source."""
        to = self.source.pixel_map.points
        place = None if thing.place is None else tuple(to(thing.place).tolist())
        return replace(thing, place=place, boxes=() if thing.box is None else (tuple(to(thing.box).tolist()),))

    def _show(self, picture: Picture) -> None:
        for watcher in self.watchers:
            watcher.picture(picture)

    @torch.inference_mode()
    def _enhance(self, time: float, frame: Tensor, signals: Any, state: Any, table: Any) -> None:
        assert self.attention is not None
        images = self.model.features.images_at(frame, state.motion)
        frame = shown(frame)
        enhanced, self._state = self.attention(
            frame[None], images[None], signals.outputs[-1:], signals.scale[-1:], table, self._state
        )
        k = int(enhanced.winner[0])
        picture = Picture(time, to_pixels(frame), to_pixels(enhanced.frames[0]), k)
        if k >= 0 and picture.enhanced is not None:
            best = signals.outputs[-1][table.owners].sort(descending=True).values.tolist()
            margin = best[0] - best[1] if len(best) > 1 else best[0]
            kept = self.moments.get(k)
            if kept is None or margin >= kept.margin or time - kept.time > MOMENT_S:
                self.moments[k] = Moment(time, k, margin, picture.frame, picture.enhanced)
        self._show(picture)


MAX_DETECTIONS = 200_000
"""A run keeps closed objects up to this many detections; of a longer run they are the latest."""


class Objects:
    """The objects of a run that were lost, the latest of them in bounded memory, and the numbers of all.

    Args:
        model: whose states they are taken from.
        watchers: who gets them at once.

    Attributes:
        earlier: how many are no longer kept.
    """

    def __init__(self, model: Any, watchers: Sequence[Watcher]) -> None:
        self.model, self.watchers, self.earlier = model, watchers, 0
        self.tables: list[Any] = []
        self.detections = 0
        self.numbers: dict[int | None, int] = {}

    def take(self, signals: Any, state: Any) -> Any:
        """The state without the objects that were lost; those that appeared in a chunk get their numbers."""
        if hasattr(signals, "mask") and len(signals.time):
            shown = np.unique(signals.labels.numpy()[signals.mask.numpy() > 0])
            for track in (shown - 1).tolist():
                self.numbers.setdefault(track, len(self.numbers) + 1)
        things, after = self.model.take_closed(state)
        if things:
            self.tell(things)
            self.tables.append(state.closed)
            self.detections += len(state.closed.path)
        while self.detections > MAX_DETECTIONS and len(self.tables) > 1:
            oldest = self.tables.pop(0)
            self.detections -= len(oldest.path)
            self.earlier += len(oldest.number)
        return after

    def numbered(self, things: Sequence[BoundObject]) -> list[BoundObject]:
        """The objects of a model with tracks with their numbers, in that order; new ones get the next ones."""
        if not self.model.tracks:
            return list(things)
        for one in sorted(things, key=lambda thing: (thing.first_seen or 0.0, thing.track or 0)):
            self.numbers.setdefault(one.track, len(self.numbers) + 1)
        own = [replace(one, number=self.numbers[one.track]) for one in things]
        return sorted(own, key=lambda one: one.number or 0)

    def tell(self, things: Sequence[BoundObject]) -> None:
        """Hand objects to the watchers."""
        for watcher in self.watchers:
            watcher.objects(self.numbered(things))

    def restored(self, state: Any) -> Any:
        """A state with those that were kept."""
        return self.model.restore_closed(state, self.tables) if self.tables else state


def shown(frame: Tensor) -> Tensor:
    """A frame `[C, H, W]` as `[3, H, W]` in 0..1."""
    return as_float(check_frames(frame.unsqueeze(0))[0])


def to_pixels(image: Tensor) -> Pixels:
    """`[3, H, W]` in 0..1 -> `[H, W, 3]` uint8."""
    pixels: Pixels = (image.clamp(0, 1) * 255 + 0.5).byte().permute(1, 2, 0).contiguous().cpu().numpy()
    return pixels
