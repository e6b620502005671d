"""What a binding run knows when it ends, and who may look on while it goes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from torch import Tensor

from ndtorch.binding import BoundObject, Verdict
from ndtorch.binding.labelled import signal_dataset
from ndtorch.scenes.base import FrameSource

Floats = npt.NDArray[np.float32]
Pixels = npt.NDArray[np.uint8]

MAX_MASKS = 200_000
"""Number of masks that a run keeps, the latest."""


class Picture(NamedTuple):
    """One frame and what the model makes of it.

    Attributes:
        time: seconds since the first frame.
        frame: `[H, W, 3]` uint8, as the model saw it; of models with tracks as large as the source has it.
        enhanced: the image of visual attention, of models whose neurons own objects; None of those with tracks.
        winner: number of the neuron attended to, -1 for none.
    """

    time: float
    frame: Pixels
    enhanced: Pixels | None = None
    winner: int = -1


class Watcher:
    """Somebody who wants to see a run as it goes; `picture` is called from another thread than the rest."""

    def picture(self, picture: Picture) -> None:
        """A frame, a few times a second."""

    def signals(self, signals: Any, weights: Tensor, state: Any) -> None:
        """The model's signals of one chunk of frames, its weights `[10, 10]` and its state after it."""

    def close(self) -> None:
        """The run has ended."""


class Placed(NamedTuple):
    """A mask in the picture: row and column of its first pixel, and its pixels `[h, w]`."""

    top: int
    left: int
    pixels: npt.NDArray[np.bool_]


class MaskStore:
    """The mask of every track at every step of the model, in its working image; the latest `MAX_MASKS` of them."""

    def __init__(self) -> None:
        self.size = (1, 1)
        self._packed: dict[tuple[int, int], tuple[int, int, int, int, bytes]] = {}

    def add(self, times: Tensor, labels: Tensor) -> None:
        """Keep the masks of times `[T]` and labels `[T, h, w]`, number of the track plus one."""
        for time, image in zip(times.tolist(), labels.cpu().numpy(), strict=True):
            self.size = image.shape
            for number in np.unique(image[image > 0]).tolist():
                rows, columns = np.nonzero(image == number)
                top, left = int(rows.min()), int(columns.min())
                part = image[top : rows.max() + 1, left : columns.max() + 1] == number
                self._packed[number - 1, round(1e4 * time)] = (top, left, *part.shape, np.packbits(part).tobytes())
        while len(self._packed) > MAX_MASKS:
            del self._packed[next(iter(self._packed))]

    def find(self, track: int, time: float) -> Placed | None:
        """The mask of a track at a step; None where it has none."""
        kept = self._packed.get((track, round(1e4 * time)))
        if kept is None:
            return None
        top, left, height, width, bits = kept
        pixels = np.unpackbits(np.frombuffer(bits, np.uint8), count=height * width).reshape(height, width)
        return Placed(top, left, pixels.astype(bool))


class Trace(NamedTuple):
    """Outputs over time: seconds since the first frame, `[n]` float64, and samples, `[n, 10]` float32."""

    times: npt.NDArray[np.float64] = np.zeros(0)
    samples: Floats = np.zeros((0, 10), np.float32)

    def to_xarray(self) -> Any:
        """An `xarray.DataArray` with the dimensions time (s) and signal; needs `ndtorch[xarray]`."""
        return signal_dataset(self.times, {"outputs": self.samples}, {}).outputs


class Moment(NamedTuple):
    """The clearest picture at which an object was attended to, and its margin: the winner's output minus the next best
    owner's (or its output, if it is alone)."""

    picture: Picture
    margin: float


@dataclass
class RunResult:
    """Everything a finished (or interrupted) run of a binding model knows.

    Attributes:
        model, source: that ran; state: of the model at the end.
        objects, verdict: what was found, numbered from 1, and what that is worth.
        frames: number of frames seen; first_frame: those of an earlier run, which this one went on from.
        wall_seconds: how long that took.
        outputs: of the network; with many fields, the largest of each neuron.
        final_weights: at the end, `[10, 10]`.
        moments: the clearest recent moment of each winning neuron.
        masks: of tracks.
        interrupted: whether Ctrl-C ended the run early.
        cuts: when a new scene began, seconds; of models that notice.
        confidence: probability that the number of objects is right; None of models that do not say.
    """

    model: Any
    source: FrameSource
    state: Any
    objects: list[BoundObject]
    verdict: Verdict
    frames: int
    first_frame: int
    wall_seconds: float
    outputs: Trace
    final_weights: Floats
    moments: dict[int, Moment]
    masks: MaskStore
    interrupted: bool = False
    cuts: tuple[float, ...] = ()
    confidence: float | None = None

    @property
    def simulated_seconds(self) -> float:
        """How much of the source was seen."""
        return self.frames / self.source.fps
