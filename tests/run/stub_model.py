"""A model that does next to nothing, and a source that counts: to see what the loop does."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import torch
from torch import Tensor, nn

from ndtorch.binding import BoundObject, ObjectTable
from ndtorch.scenes import FrameSource


class StubSignals(NamedTuple):
    outputs: Tensor
    time: Tensor


class StubState(NamedTuple):
    frames: Tensor


class StubModel(nn.Module):
    """Tracks one object along the columns, a pixel a frame; its outputs become NaN in frame `breaks`."""

    name, tracks, settle = "stub", True, 0.0

    def __init__(self, fps: float = 10.0, breaks: int | None = None) -> None:
        super().__init__()
        self.fps, self.dt, self.size, self.breaks = fps, 1 / fps, (16, 16), breaks
        self.chunks: list[int] = []

    def forward(self, frames: Tensor, state: Any = None) -> tuple[StubSignals, StubState]:
        done = 0 if state is None else int(state.frames)
        self.chunks.append(len(frames))
        numbers = torch.arange(done, done + len(frames))
        outputs = numbers[:, None, None, None] * torch.ones(len(frames), 2, 3, 10)
        if self.breaks is not None:
            outputs[numbers >= self.breaks] = torch.nan
        return StubSignals(outputs, numbers.double() / self.fps), StubState(torch.tensor(done + len(frames)))

    def objects(self, state: StubState) -> list[BoundObject]:
        last = int(state.frames) - 1
        path = tuple((n / self.fps, float(n), 4.0) for n in range(last + 1))
        seen = {"first_seen": 0.0, "last_seen": last / self.fps, "track": 0, "heading": (1.0, 0.0)}
        return [BoundObject("red", 7, {"red": 1.0}, (float(last), 4.0), (self.fps, 0.0), path=path, **seen)]  # type: ignore[arg-type]

    def visible_objects(self, state: StubState) -> list[BoundObject]:
        return self.objects(state)

    def take_closed(self, state: StubState) -> tuple[list[BoundObject], StubState]:
        return [], state

    def table(self, state: StubState) -> ObjectTable:
        raise AssertionError("of models with owners only")

    def verdict(self, state: StubState) -> str:
        return "stable"

    def confidence(self, state: StubState) -> None:
        return None

    def weights(self, state: StubState) -> Tensor:
        return torch.full((10, 10), float(state.frames))


class Count(FrameSource):
    """Frames whose brightness is their number; after `broken` of them somebody presses Ctrl-C."""

    def __init__(self, length: int, fps: float = 10.0, broken: int | None = None) -> None:
        self.name, self.fps, self.size, self.length, self.broken = "count", fps, (16, 16), length, broken

    def chunks(self, frames: int = 8, start: int = 0) -> Iterator[Tensor]:
        for first in range(start, self.length or 0, frames):
            if self.broken is not None and first >= self.broken:
                raise KeyboardInterrupt
            numbers = torch.arange(first, min(first + frames, self.length or 0), dtype=torch.uint8)
            yield numbers[:, None, None, None].expand(-1, 3, 16, 16).clone()
