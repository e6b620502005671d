"""Enhanced images of a run, made beside it: the run goes on while a thread works on the last picture."""

from __future__ import annotations

import queue
import threading
from types import TracebackType
from typing import NamedTuple, Protocol, Self

import torch
from torch import Tensor

from ndtorch.binding import Attention, BindingSignals, ObjectTable, VisualBinding
from ndtorch.run.result import Moment, Pixels
from ndtorch.vision import FilterState, MotionState
from ndtorch.vision.frames import as_float, check_frames

# A moment is kept for this long before a less clear but more recent one may take its place.
MOMENT_SECONDS = 3.0


class Picture(NamedTuple):
    """One frame beside what attention makes of it: `[H, W, 3]` uint8 each, and the winner (-1 for none)."""

    time: float
    frame: Pixels
    enhanced: Pixels
    winner: int


class Watcher(Protocol):
    """Somebody who wants to see a run as it goes: a video file, a recording.

    The two methods are called from two threads.
    """

    def picture(self, picture: Picture) -> None:
        """A frame and its enhanced image, a few times a second."""

    def signals(self, signals: BindingSignals, weights: Tensor) -> None:
        """The signals of one chunk of frames, and the second-stage weights after it."""


class Glimpse(NamedTuple):
    """What a picture is made from: a frame `[3, H, W]`, the state right after it, and the table of objects."""

    frame: Tensor
    motion: MotionState
    signals: BindingSignals
    table: ObjectTable


class PictureMaker:
    """Makes pictures in a thread of its own, in order, and keeps the clearest recent one of every winner.

    States are values that nobody changes, so the thread needs no locks. If pictures take longer than the run
    gives, `look` waits. An error in the thread is raised by the next `look` or at the end.

    Args:
        model: whose feature images to use.
        dt: seconds between pictures.
        watchers: who gets the pictures.
    """

    def __init__(self, model: VisualBinding, dt: float, watchers: tuple[Watcher, ...] = ()) -> None:
        self.model, self.watchers = model, watchers
        self.attention = Attention(dt, model.config.tau_in)
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
                        self._make(glimpse)
                    except Exception as error:
                        self._error = error

    def _make(self, glimpse: Glimpse) -> None:
        frame, motion, signals, table = glimpse
        images = self.model.features.images_at(frame, motion)
        shown = as_float(check_frames(frame.unsqueeze(0))[0])
        enhanced, self._state = self.attention(
            shown[None], images[None], signals.outputs[-1:], signals.scale[-1:], table, self._state
        )
        k = int(enhanced.winner[0])
        picture = Picture(float(signals.time[-1]), to_pixels(shown), to_pixels(enhanced.frames[0]), k)
        if k >= 0:
            self._keep(picture, signals.outputs[-1], table)
        for watcher in self.watchers:
            watcher.picture(picture)

    def _keep(self, picture: Picture, outputs: Tensor, table: ObjectTable) -> None:
        rivals = outputs[table.owners].sort(descending=True).values
        margin = float(rivals[0] - rivals[1]) if len(rivals) > 1 else float(rivals[0])
        kept = self.moments.get(picture.winner)
        if kept is None or margin >= kept.margin or picture.time - kept.time > MOMENT_SECONDS:
            moment = Moment(picture.time, picture.winner, margin, picture.frame, picture.enhanced)
            self.moments[picture.winner] = moment


def to_pixels(image: Tensor) -> Pixels:
    """`[3, H, W]` in 0..1 -> `[H, W, 3]` uint8."""
    pixels: Pixels = (image.clamp(0, 1) * 255 + 0.5).byte().permute(1, 2, 0).contiguous().cpu().numpy()
    return pixels
