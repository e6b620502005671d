"""What a binding run found and what it keeps for its pictures, in bounded memory."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
from torch import Tensor

from ndtorch.binding import BindingModel, BoundObject, ObjectTable, Verdict
from ndtorch.run.watchers import Pixels, Watcher
from ndtorch.scenes.base import SAME_PIXELS, PixelMap
from ndtorch.scenes.video import SourceFrames

Floats = npt.NDArray[np.float32]


MAX_DETECTIONS = 200_000
"""A run keeps closed objects up to this many detections; of a longer run they are the latest."""


class ClosedObjects:
    """The objects that were lost in a run, the latest of them, in bounded memory.

    Args:
        model: whose states they are taken from.
        watchers: who gets them at once.
        numbered: gives objects their numbers.
    """

    def __init__(
        self,
        model: BindingModel,
        watchers: Sequence[Watcher],
        numbered: Callable[[Sequence[BoundObject]], list[BoundObject]],
    ) -> None:
        self.model, self.watchers, self.numbered, self.earlier = model, watchers, numbered, 0
        self.tables: list[Any] = []
        self.detections = 0

    def take(self, state: Any) -> Any:
        """Take them out of a state."""
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

    def tell(self, things: Sequence[BoundObject]) -> None:
        """Hand objects to the watchers."""
        things = self.numbered(things) if self.model.tracks else things
        for watcher in self.watchers:
            watcher.objects(things)

    def restored(self, state: Any) -> Any:
        """A state with those that were kept."""
        return self.model.restore_closed(state, self.tables) if self.tables else state


class Trace:
    """Samples over time, thinned by three whenever there are more than `most` of them.

    So a run of any length keeps between `most / 3` and `most` samples, evenly spaced: enough for a figure. Three,
    because an even stride would hide outputs that flip sign from step to step.

    Args:
        shape: shape of one sample.
        most: largest number of samples kept.
    """

    def __init__(self, shape: tuple[int, ...], most: int = 4096) -> None:
        self.most = most
        self.stride = 1
        self._seen = 0
        self._times: list[float] = []
        self._samples: list[Floats] = []
        self.shape = shape

    def add(self, time: float, sample: Tensor) -> None:
        """Take the sample of that time in seconds, if its turn has come."""
        if self._seen % self.stride == 0:
            self._times.append(time)
            self._samples.append(sample.detach().cpu().numpy().astype(np.float32))
            if len(self._times) > self.most:
                self._times, self._samples = self._times[::3], self._samples[::3]
                self.stride *= 3
        self._seen += 1

    @property
    def times(self) -> npt.NDArray[np.float64]:
        """Seconds since the first frame, `[n]`."""
        return np.array(self._times, dtype=np.float64)

    @property
    def samples(self) -> Floats:
        """`[n, *shape]`."""
        return np.array(self._samples, dtype=np.float32).reshape(-1, *self.shape)


@dataclass
class Moment:
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
        confidence: probability that their number is right; None of models that do not say.
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
        advice: why nothing was found, or that the camera moves, and what can be done, a line each.
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
    moments: dict[int, Moment] = field(default_factory=dict)
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
    advice: tuple[str, ...] = ()
    confidence: float | None = None

    @property
    def has_boxes(self) -> bool:
        """Whether its objects have boxes."""
        return any(thing.boxes for thing in self.objects)


def over_fields(outputs: Tensor) -> Tensor:
    """Outputs `[T', 10]` as they are, `[T', R, C, 10]` as the largest of every neuron, `[T', 10]`."""
    return outputs if outputs.ndim == 2 else outputs.flatten(1, -2).amax(1)


def one_matrix(weights: Tensor) -> Tensor:
    """Weights `[10, 10]` as they are; of models with a matrix a window, `[K, 10, 10]`, the largest of each."""
    return weights if weights.ndim == 2 else weights.amax(0)
