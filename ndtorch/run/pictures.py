"""Pictures of a run, made beside it in a thread: frames, and enhanced images of models whose neurons own objects."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import torch
from torch import Tensor

from ndtorch.binding import Attention
from ndtorch.run.result import Moment, Picture, Pixels, Watcher
from ndtorch.scenes.base import FrameSource
from ndtorch.vision import FilterState
from ndtorch.vision.frames import as_float, check_frames

MOMENT_S = 3.0
"""A moment is kept for this long before a less clear but more recent one may take its place."""


class PictureMaker:
    """Makes pictures one after the other, and keeps the clearest recent one of every winner.

    Args:
        model: with a table of owners, its feature images make the enhanced image.
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

    def show(self, frames: Tensor, first: int, every: int) -> None:
        """Make a picture of every n-th of the frames `[T, 3, H, W]`, the first of which has this number."""
        due = [k for k in range(len(frames)) if (first + k + 1) % every == 0]
        if due:
            self.wait()
            large = self.source.latest()
            pixels = large or [to_pixels(shown(frame)) for frame in frames]
            pictures = [Picture((first + k) / self.source.fps, pixels[k]) for k in due]
            self._last = self._thread.submit(self._show, *pictures)

    def take(self, time: float, frame: Tensor, signals: Any, state: Any) -> None:
        """Enhance a frame `[3, H, W]`, of signals and state right after it; waits for the one before."""
        self.wait()
        table = self.model.table(state)
        self._last = self._thread.submit(self._enhance, time, frame.clone(), signals, state, table)

    def wait(self) -> None:
        """Wait for the picture that is being made; raises what it raised."""
        if self._last is not None:
            self._last.result()

    def _show(self, *pictures: Picture) -> None:
        for picture in pictures:
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
        if k >= 0:
            best = signals.outputs[-1][table.owners].sort(descending=True).values.tolist()
            margin = best[0] - best[1] if len(best) > 1 else best[0]
            kept = self.moments.get(k)
            if kept is None or margin >= kept.margin or time - kept.picture.time > MOMENT_S:
                self.moments[k] = Moment(picture, margin)
        self._show(picture)


def shown(frame: Tensor) -> Tensor:
    """A frame `[C, H, W]` as `[3, H, W]` in 0..1."""
    return as_float(check_frames(frame.unsqueeze(0))[0])


def to_pixels(image: Tensor) -> Pixels:
    """`[3, H, W]` in 0..1 -> `[H, W, 3]` uint8."""
    pixels: Pixels = torch.stack((image.clamp(0, 1) * 255 + 0.5).byte().unbind(), -1).cpu().numpy()
    return pixels
