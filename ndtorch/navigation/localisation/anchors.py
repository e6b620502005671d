"""Frames that move with the parts of the building, and where the car is in them."""

from __future__ import annotations

import numpy as np
import torch

from ndtorch.navigation.localisation.graph import carried, seen_from
from ndtorch.navigation.localisation.parts import frames_of
from ndtorch.navigation.localisation.state import LocaliserState, floats
from ndtorch.navigation.sights import Anchor, Frames

KNOWN_MAP = -1.0
"""Number of the frame of a known map, which is never moved."""


def anchor_of(state: LocaliserState) -> Anchor | None:
    """Where the car is in a frame that is moved with its part of the building; None while it looks for itself."""
    if state.hunt is not None:
        return None
    pose = floats(state.pose)
    if state.parts is None:
        return Anchor(KNOWN_MAP, pose)
    frame, base = float(state.parts.begun[-1]), state.parts.poses[-1].numpy()
    if state.trail is not None and len(state.parts.scans):
        # What is seen now will be gone through again, and then each scan moves by itself.
        frame, part, *at = state.parts.scans[-1].tolist()
        base = carried(state.parts.poses[int(part)].numpy(), np.array(at))
    x, y, heading = seen_from(base, np.array(pose)).tolist()
    return Anchor(frame, (x, y, heading))


def located_frames(state: LocaliserState) -> Frames:
    """Where all frames of `anchor_of` are now."""
    if state.parts is not None:
        return frames_of(state.parts)
    return Frames(torch.tensor([KNOWN_MAP], dtype=torch.float64), torch.zeros(1, 3, dtype=torch.float64))
