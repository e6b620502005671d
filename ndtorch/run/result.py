"""What a binding run knows when it ends, and who may look on while it goes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from torch import Tensor

from ndtorch.binding import BoundObject, ObjectTable, Verdict
from ndtorch.scenes.base import SAME_PIXELS, PixelMap
from ndtorch.scenes.video import SourceFrames

Floats = npt.NDArray[np.float32]
Pixels = npt.NDArray[np.uint8]


class Picture(NamedTuple):
    """One frame and what the model makes of it.

    Attributes:
        time: seconds since the first frame.
        frame: as the model saw it, `[H, W, 3]` uint8.
        enhanced: the image of visual attention, of models whose neurons own objects; None of those with tracks.
        winner: number of the neuron attended to, -1 for none.
        objects: those in sight, of models with tracks.
    """

    time: float
    frame: Pixels
    enhanced: Pixels | None = None
    winner: int = -1
    objects: tuple[BoundObject, ...] = ()


class Watcher:
    """Somebody who wants to see a run as it goes; `picture` is called from another thread than the rest."""

    def picture(self, picture: Picture) -> None:
        """A frame, a few times a second."""

    def objects(self, things: Sequence[BoundObject]) -> None:
        """Objects that were lost, as they are lost, and at the end of the run all others.

        An object that stays in sight for long comes in parts with the same `track`.
        """

    def signals(self, signals: Any, weights: Tensor, state: Any) -> None:
        """The model's signals of one chunk of frames, its weights `[10, 10]` and its state after it."""

    def close(self) -> None:
        """The run has ended."""


class Trace:
    """Samples over time, thinned by three whenever there are more than `most` of them.

    So a run of any length keeps between `most / 3` and `most` samples, evenly spaced: enough for a figure. Three,
    because an even stride would hide outputs that flip sign from step to step.

    Args:
        shape: shape of one sample.
        most: largest number of samples kept.
    """

    def __init__(self, shape: tuple[int, ...], most: int = 4096) -> None:
        self.shape, self.most, self.stride = shape, most, 1
        self._count = 0
        self._kept: list[tuple[float, Floats]] = []

    def add(self, time: float, sample: Tensor) -> None:
        """Take the sample of that time in seconds, if its turn has come."""
        if self._count % self.stride == 0:
            self._kept.append((time, sample.detach().cpu().numpy().astype(np.float32)))
            if len(self._kept) > self.most:
                self._kept = self._kept[::3]
                self.stride *= 3
        self._count += 1

    @property
    def times(self) -> npt.NDArray[np.float64]:
        """Seconds since the first frame, `[n]`."""
        return np.array([time for time, _ in self._kept], dtype=np.float64)

    @property
    def samples(self) -> Floats:
        """`[n, *shape]`."""
        return np.array([sample for _, sample in self._kept], dtype=np.float32).reshape(-1, *self.shape)


class Moment(NamedTuple):
    """A frame at which an object was attended to.

    Attributes:
        time: seconds since the first frame.
        neuron: number of the winning neuron, 0 to 9.
        margin: its output minus the next best owner's (or its output, if it is alone).
        frame, enhanced: `[H, W, 3]` uint8, the input and the enhanced image.
    """

    time: float
    neuron: int
    margin: float
    frame: Pixels
    enhanced: Pixels


@dataclass
class RunResult:
    """Everything a finished (or interrupted) run of a binding model knows.

    Attributes:
        source: name of the scene, or the video as it was given.
        model: name of the model.
        size: height and width of the frames that it saw.
        objects, verdict: what was found and what that is worth.
        table: the objects of models whose neurons own them; None of models with tracks.
        state: the model's state at the end.
        settle: seconds before learning began.
        simulated_seconds: how much of the source was seen; wall_seconds: how long that took.
        frames: number of frames seen.
        outputs: of the network, `[10]` a sample; with many fields, the largest of each neuron.
        weights: `[10, 10]` a sample.
        final_weights: at the end, `[10, 10]`.
        moments: the clearest recent moment of each winning neuron.
        interrupted: whether Ctrl-C ended the run early.
        cuts: when a new scene began, seconds; of models that notice.
        earlier: how many parts of objects the run did not keep because it was long; watchers got them.
        full_size: height and width of the frames of the source, which it may have made smaller.
        pixel_map: from the pixels of objects to those.
        fps: frames a second that the model got.
        step_frames: frames from one step of the model to the next.
        first_frame: frames that an earlier run had, which this one went on from.
        source_frames: the frames of the source and when they were delivered; None where every frame is one of it.
        masks: of tracks, of models that have them.
        silent: why a camera or stream ended by itself.
        confidence: probability that the number of objects is right; None of models that do not say.
    """

    source: str
    model: str
    size: tuple[int, int]
    objects: list[BoundObject]
    verdict: Verdict
    table: ObjectTable | None
    state: Any
    settle: float
    simulated_seconds: float
    wall_seconds: float
    frames: int
    outputs: Trace
    weights: Trace
    final_weights: Floats
    moments: dict[int, Moment]
    interrupted: bool = False
    cuts: tuple[float, ...] = ()
    earlier: int = 0
    full_size: tuple[int, int] = (1, 1)
    pixel_map: PixelMap = SAME_PIXELS
    fps: float = 1.0
    step_frames: float = 1.0
    first_frame: int = 0
    source_frames: SourceFrames | None = None
    masks: Any = None
    silent: str = ""
    confidence: float | None = None


def over_fields(outputs: Tensor) -> Tensor:
    """Outputs `[T', 10]` as they are, `[T', R, C, 10]` as the largest of every neuron, `[T', 10]`."""
    return outputs if outputs.ndim == 2 else outputs.flatten(1, -2).amax(1)


def one_matrix(weights: Tensor) -> Tensor:
    """Weights `[10, 10]` as they are; of models with a matrix a window, `[K, 10, 10]`, the largest of each."""
    return weights if weights.ndim == 2 else weights.amax(0)
