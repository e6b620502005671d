"""`ndtorch bind` on ordinary video: front end, fields with a shared scale-free network, objects over time."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

from ndtorch.binding.models.whole_field import WholeField
from ndtorch.binding.network import InhibitoryNetwork, NetworkState
from ndtorch.binding.normalise import FieldInputs
from ndtorch.binding.rules import ScaleFreeRule
from ndtorch.binding.tracking.detections import Sighting
from ndtorch.binding.tracking.tracks import ObjectFile, ObjectFiles
from ndtorch.errors import InputError
from ndtorch.scenes import FrameSource
from ndtorch.vision.camera.front_end import FrontEnd, OrdinaryState, OrdinaryVideo

ROWS = 224
"""Height to which frames are brought as soon as they are decoded: four pixels for one of the front end's."""

PARTS = ("exposure", "background", "noise-floor", "color-inhibition", "scale", "compression", "fields", "network")
"""What can be switched off by name."""


class VideoWatcher(Protocol):
    """Somebody who wants to see a run as it goes: an overlay video."""

    def picture(self, frame: Tensor, time: float, in_sight: list[tuple[ObjectFile, Sighting]]) -> None:
        """A frame `[3, H, W]` uint8, a few times a second, and the objects in it."""


@dataclass
class VideoResult:
    """What a run over a video found.

    Attributes:
        source: name of the video.
        objects: in the order of their appearance.
        weights: T at the end, `[10, 10]`.
        frames, seconds, wall_seconds: how much was seen and how long that took.
        aspect: width of the picture over its height.
        interrupted: whether Ctrl-C ended it.
    """

    source: str
    objects: list[ObjectFile]
    weights: Tensor
    frames: int
    seconds: float
    wall_seconds: float
    aspect: float
    interrupted: bool = False


def front_end(without: Sequence[str] = ()) -> FrontEnd:
    """The front end less the parts named; "network" is not its business.

    Raises:
        InputError: a part that is not among `PARTS`.
    """
    for name in without:
        if name not in PARTS:
            raise InputError(f"without must name parts among {', '.join(PARTS)}; got {name!r}")
    return FrontEnd(
        exposure="exposure" not in without,
        background="background" not in without,
        noise_floor="noise-floor" not in without,
        color_inhibition="color-inhibition" not in without,
        scale=0 if "scale" in without else None,
        compression="compression" not in without,
        grid=(1, 1) if "fields" in without else FrontEnd.grid,
    )


def run_video(
    source: FrameSource,
    without: Sequence[str] = (),
    pictures_per_second: float = 0.0,
    watchers: tuple[VideoWatcher, ...] = (),
    progress: Callable[[int], None] | None = None,
) -> VideoResult:
    """Look at a video from its beginning to its end, or to Ctrl-C, which keeps what was seen so far.

    Args:
        source: frames `[T, 3, H, W]`; H of `ROWS` is quickest.
        without: parts to switch off, among `PARTS`.
        pictures_per_second: how often watchers get a picture.
        watchers: who gets them.
        progress: called with the number of frames of each chunk.

    Raises:
        InputError: a source without frames, or an unknown part.
    """
    vision = OrdinaryVideo(source.size, source.fps, front_end(without))
    normalise = FieldInputs(vision.dt)
    network = InhibitoryNetwork.of_fields(10, vision.dt, None if "network" in without else ScaleFreeRule())
    aspect = source.size[1] / source.size[0]
    files = ObjectFiles(vision.dt, aspect)
    whole = "fields" in without
    sums: list[tuple[Tensor, Tensor]] = []
    every = max(1, round(source.fps / pictures_per_second)) if pictures_per_second > 0 else 8
    length = next(n for n in range(min(every, 12), 0, -1) if every % n == 0)
    seen: OrdinaryState | None = None
    level: Tensor | None = None
    learned: NetworkState | None = None
    frames_seen, interrupted = 0, False
    began = time.perf_counter()
    in_sight: list[tuple[ObjectFile, Sighting]] = []
    try:
        with torch.inference_mode():
            for frames in source.chunks(length):
                fields, seen = vision(frames, seen)
                frames_seen += len(frames)
                if len(fields.time):
                    inputs, level = normalise(fields.signals.flatten(1, 2), level)
                    outputs, learned = network(inputs, learned)
                    if whole:
                        sums.append((inputs[:, 0], fields.time))
                    else:
                        in_sight = files.add(fields, inputs, outputs)[-1]
                if pictures_per_second > 0 and frames_seen % every == 0:
                    for watcher in watchers:
                        watcher.picture(frames[-1], (frames_seen - 1) / source.fps, in_sight)
                if progress is not None:
                    progress(len(frames))
    except KeyboardInterrupt:
        if frames_seen == 0:
            raise
        interrupted = True
    if frames_seen == 0:
        raise InputError(f"{source.name}: no frames")
    objects = files.objects()
    if whole and sums:
        signals, times = (torch.cat(part) for part in zip(*sums, strict=True))
        with torch.inference_mode():
            objects = WholeField(vision.dt)(signals, times)
    return VideoResult(
        source=source.name,
        objects=objects,
        weights=torch.zeros(10, 10) if learned is None else learned.weights,
        frames=frames_seen,
        seconds=frames_seen / source.fps,
        wall_seconds=time.perf_counter() - began,
        aspect=aspect,
        interrupted=interrupted,
    )
