"""What the model `figures` remembers, as arrays of its own that every step of a call changes in place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from ndtorch.binding.models.figures_state import SeenState
from ndtorch.binding.tracking.figures import Numbers
from ndtorch.binding.tracking.many import COMING, Comings
from ndtorch.binding.tracking.regions import Floats, Labels
from ndtorch.binding.tracking.restless import at_rest
from ndtorch.vision.camera.figure_signals import FieldsState
from ndtorch.vision.camera.ground import Ground, copied
from ndtorch.vision.motion import MotionState


@dataclass
class Memory:
    """A `SeenState` as arrays; the attributes are those of the state. Ground, `kept` and the filters are changed in
    place, the others are replaced by new ones."""

    ground: Ground
    silhouettes: Labels
    kept: Floats
    gone: Floats
    come: Numbers
    filters: tuple[Floats, Floats] | None = None

    @classmethod
    def blank(cls, ground: Ground) -> Memory:
        """The memory before anything was seen on a ground."""
        shape = ground.quiet.shape
        none = np.zeros((0, COMING))
        return cls(ground, np.zeros(shape, np.int32), np.zeros(shape, np.float32), at_rest(*shape), none)

    @classmethod
    def of(cls, state: SeenState) -> Memory:
        """That of a state, which is left as it is."""
        filters = None
        if state.fields is not None:
            filters = copied(state.fields.motion.slow), copied(state.fields.motion.delayed)
        silhouettes, gone, come = state.silhouettes.numpy(), state.gone.numpy(), state.come.rows.numpy()
        return cls(Ground.of(state.ground), silhouettes, copied(state.kept), gone, come, filters)

    def state(self) -> SeenState:
        """The state at the end of a call. It shares this memory, which is not to be changed any more."""
        fields = None
        if self.filters is not None:
            fields = FieldsState(MotionState(*map(torch.from_numpy, self.filters)))
        silhouettes, kept, gone = (torch.from_numpy(part) for part in (self.silhouettes, self.kept, self.gone))
        return SeenState(self.ground.state(), silhouettes, kept, gone, Comings(torch.from_numpy(self.come)), fields)
