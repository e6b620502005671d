"""What a binding run found and what it keeps for its pictures, in bounded memory."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from torch import Tensor

from ndtorch.binding import BindingState, BoundObject, ObjectTable, Verdict

Floats = npt.NDArray[np.float32]
Pixels = npt.NDArray[np.uint8]


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
class BindResult:
    """Everything a finished (or interrupted) run of `ndtorch bind` knows.

    Attributes:
        source: name of the scene, or the video as it was given.
        objects, verdict: the table and what it is worth.
        state: the model's state at the end.
        settle: seconds before learning began.
        simulated_seconds: how much of the source was seen; wall_seconds: how long that took.
        frames: number of frames seen.
        outputs: second-stage outputs, `[10]` a sample.
        weights: second-stage weights, `[10, 10]` a sample.
        moments: the clearest recent moment of each winning neuron.
        table: of the objects at the end, whatever the verdict; None for that of the final weights.
        interrupted: whether Ctrl-C ended the run early.
    """

    source: str
    objects: list[BoundObject]
    verdict: Verdict
    state: BindingState
    settle: float
    simulated_seconds: float
    wall_seconds: float
    frames: int
    outputs: Trace
    weights: Trace
    moments: dict[int, Moment] = field(default_factory=dict)
    table: ObjectTable | None = None
    interrupted: bool = False

    @property
    def final_weights(self) -> Floats:
        """Second-stage weights at the end, `[10, 10]`."""
        array: Floats = self.state.second.weights.detach().cpu().numpy().astype(np.float32)
        return array
