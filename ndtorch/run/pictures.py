"""Pictures of a run: enhanced images, made beside it in a thread, or the frame with the objects in sight."""

from __future__ import annotations

import queue
import threading
from collections.abc import Sequence
from dataclasses import replace
from types import TracebackType
from typing import Any, NamedTuple, Self

import numpy as np
import torch
from torch import Tensor

from ndtorch.binding import Attention, BoundObject, ObjectTable
from ndtorch.run.result import Moment
from ndtorch.run.watchers import Picture, Pixels, Watcher
from ndtorch.scenes.base import SAME_PIXELS, PixelMap
from ndtorch.vision import FilterState
from ndtorch.vision.frames import as_float, check_frames

MARKED_S, NUMBERED_S = 0.3, 1.0
"""Seconds that an object has to last before it is marked, and before it has a number: until then it may turn out to be
a part of another."""
MOMENT_SECONDS = 3.0
"""A moment is kept for this long before a less clear but more recent one may take its place."""


class Glimpse(NamedTuple):
    """What a picture is made from: time of the model's latest step, a frame `[3, H, W]`, signals and state right after
    it, the table of objects, None of models with tracks, and the frame as large as the source has it.
    """

    time: float
    frame: Tensor
    signals: Any
    state: Any
    table: ObjectTable | None
    large: Pixels | None = None


def age(one: BoundObject) -> float:
    """Seconds since an object was first seen."""
    return (one.last_seen or 0.0) - (one.first_seen or 0.0)


class PictureMaker:
    """Makes pictures in a thread of its own, in order, and keeps the clearest recent one of every winner.

    States are values that nobody changes, so the thread needs no locks. If pictures take longer than the run
    gives, `look` waits. An error in the thread is raised by the next `look` or at the end.

    Args:
        model: whose objects to show; with a table of owners, its feature images make the enhanced image.
        dt: seconds between pictures.
        watchers: who gets the pictures.
        pixel_map: from pixels of the frames to those of the source.
    """

    def __init__(
        self, model: Any, dt: float, watchers: Sequence[Watcher] = (), pixel_map: PixelMap = SAME_PIXELS
    ) -> None:
        self.model, self.watchers, self.pixel_map = model, watchers, pixel_map
        self.numbers: dict[int | None, int] = {}
        self._since: dict[int, float] = {}
        self._lock = threading.Lock()
        self.attention = None if model.tracks else Attention(dt, model.config.normalise.tau_sums)
        self.moments: dict[int, Moment] = {}
        self._state: FilterState | None = None
        self._glimpses: queue.Queue[Glimpse | None] = queue.Queue(maxsize=4)
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._work, name="pictures", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._glimpses.put(None)
        self._thread.join()
        if error is None and self._error is not None:
            raise self._error

    def look(self, glimpse: Glimpse) -> None:
        """Hand over the next picture's material."""
        if self._error is not None:
            raise self._error
        self._glimpses.put(glimpse)

    def _work(self) -> None:
        with torch.inference_mode():
            while (glimpse := self._glimpses.get()) is not None:
                # After an error the queue is still emptied, so that nobody waits for ever.
                if self._error is None:
                    try:
                        picture = self._tracked(glimpse) if self.attention is None else self._enhanced(glimpse)
                        for watcher in self.watchers:
                            watcher.picture(picture)
                    except Exception as error:
                        self._error = error

    def _tracked(self, glimpse: Glimpse) -> Picture:
        """The frame and the objects in sight."""
        seen = [one for one in self.model.visible_objects(glimpse.state) if age(one) >= MARKED_S]
        old = self.numbered([one for one in seen if age(one) >= NUMBERED_S])
        young = [replace(one, number=self.numbers.get(one.track)) for one in seen if age(one) < NUMBERED_S]
        things = [moved(one, self.pixel_map) for one in (*old, *young)]
        frame = to_pixels(shown(glimpse.frame)) if glimpse.large is None else glimpse.large
        return Picture(glimpse.time, frame, objects=tuple(things))

    def appeared(self, signals: Any) -> None:
        """Number the tracks of a chunk that have been objects for `NUMBERED_S`, of models whose signals show them."""
        if hasattr(signals, "mask") and len(signals.time):
            found, time = np.unique(signals.labels.numpy()[signals.mask.numpy() > 0]), float(signals.time[-1])
            with self._lock:
                new = [track for track in (found - 1).tolist() if track not in self.numbers]
                self._since = {track: self._since.get(track, time) for track in new}
                for track, since in self._since.items():
                    if time - since >= NUMBERED_S:
                        self.numbers[track] = len(self.numbers) + 1

    def numbered(self, things: Sequence[BoundObject]) -> list[BoundObject]:
        """The objects with their numbers, in the order of these; who has none yet gets the next, by time of birth."""
        with self._lock:
            for one in sorted(things, key=lambda thing: (thing.first_seen or 0.0, thing.track or 0)):
                self.numbers.setdefault(one.track, len(self.numbers) + 1)
        own = [replace(one, number=self.numbers[one.track]) for one in things]
        return sorted(own, key=lambda one: one.number or 0)

    def _enhanced(self, glimpse: Glimpse) -> Picture:
        assert self.attention is not None
        assert glimpse.table is not None
        signals = glimpse.signals
        images = self.model.features.images_at(glimpse.frame, glimpse.state.motion)
        frame = shown(glimpse.frame)
        enhanced, self._state = self.attention(
            frame[None], images[None], signals.outputs[-1:], signals.scale[-1:], glimpse.table, self._state
        )
        k = int(enhanced.winner[0])
        picture = Picture(glimpse.time, to_pixels(frame), to_pixels(enhanced.frames[0]), k)
        if k >= 0:
            self._keep(picture, signals.outputs[-1], glimpse.table)
        return picture

    def _keep(self, picture: Picture, outputs: Tensor, table: ObjectTable) -> None:
        assert picture.enhanced is not None
        rivals = outputs[table.owners].sort(descending=True).values
        margin = float(rivals[0] - rivals[1]) if len(rivals) > 1 else float(rivals[0])
        kept = self.moments.get(picture.winner)
        if kept is None or margin >= kept.margin or picture.time - kept.time > MOMENT_SECONDS:
            moment = Moment(picture.time, picture.winner, margin, picture.frame, picture.enhanced)
            self.moments[picture.winner] = moment


def moved(thing: BoundObject, to: PixelMap) -> BoundObject:
    """An object with its latest place and box in pixels of the source."""
    place = None if thing.place is None else tuple(to.points(thing.place).tolist())
    boxes = () if thing.box is None else (tuple(to.points(thing.box).tolist()),)
    return replace(thing, place=place, boxes=boxes)


def shown(frame: Tensor) -> Tensor:
    """A frame `[C, H, W]` as `[3, H, W]` in 0..1."""
    return as_float(check_frames(frame.unsqueeze(0))[0])


def to_pixels(image: Tensor) -> Pixels:
    """`[3, H, W]` in 0..1 -> `[H, W, 3]` uint8."""
    pixels: Pixels = (image.clamp(0, 1) * 255 + 0.5).byte().permute(1, 2, 0).contiguous().cpu().numpy()
    return pixels
