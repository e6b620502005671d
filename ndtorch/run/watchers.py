"""Who may look on while a model runs: films, recordings, tests."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from torch import Tensor

from ndtorch.binding import BoundObject

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
    """Somebody who wants to see a run as it goes; by itself it looks away.

    `picture` is called from another thread than `signals`.
    """

    def picture(self, picture: Picture) -> None:
        """A frame, a few times a second."""

    def objects(self, things: Sequence[BoundObject]) -> None:
        """Objects that were lost, as they are lost, and at the end of the run all others.

        An object that stays in sight for long comes in parts with the same `track`.
        """

    def signals(self, signals: Any, weights: Tensor, state: Any) -> None:
        """The model's signals of one chunk of frames, its weights `[10, 10]` and its state after it."""
