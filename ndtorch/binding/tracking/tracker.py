"""Field signals -> tracks, one time step after the other, with everything that changes in a state."""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

import torch
from torch import Tensor

from ndtorch.binding.tracking.detections import detections, strengths
from ndtorch.binding.tracking.params import TrackParams
from ndtorch.binding.tracking.tracks import Track, TrackTable, follow, standing, stands, table_of, tracks_of


class Tracked(Protocol):
    """Signals of T time steps of one film: see `VideoSignals`."""

    @property
    def inputs(self) -> Tensor: ...
    @property
    def outputs(self) -> Tensor: ...
    @property
    def motion(self) -> Tensor: ...
    @property
    def presence(self) -> Tensor: ...
    @property
    def noise(self) -> Tensor: ...
    @property
    def time(self) -> Tensor: ...
    @property
    def cut(self) -> Tensor: ...
    @property
    def shades(self) -> Tensor: ...


class TrackerState(NamedTuple):
    """State of `Tracker`.

    Attributes:
        motion: averaged motion, `[R, C, 2]`.
        strongest: the largest strength lately, float64 scalar.
        time: of the latest step, seconds, float64 scalar.
        scene: when the latest scene began, float64 scalar.
        began: tracks begun so far, int64 scalar.
        open: tracks that may be in sight.
        closed: tracks of objects that are gone.
    """

    motion: Tensor
    strongest: Tensor
    time: Tensor
    scene: Tensor
    began: Tensor
    open: TrackTable
    closed: TrackTable


class Tracker:
    """Follows what moves over a grid of fields. No gradients go through tracks.

    Args:
        dt: seconds between time steps.
        aspect: width of the picture over its height.
        params: constants.
    """

    def __init__(self, dt: float, aspect: float, params: TrackParams | None = None) -> None:
        self.dt, self.aspect, self.params = dt, aspect, params or TrackParams()

    def __call__(self, fields: Tracked, state: TrackerState | None = None) -> TrackerState:
        """Take a stretch of signals of one film."""
        size = fields.motion.shape[1] * fields.motion.shape[2]
        if state is None:
            zero, none = torch.zeros((), dtype=torch.float64), table_of([], size)
            state = TrackerState(
                fields.motion[0].detach().cpu(), zero, zero, zero, torch.zeros((), dtype=torch.int64), none, none
            )
        motion, strongest = state.motion, float(state.strongest)
        began, time, scene = int(state.began), float(state.time), float(state.scene)
        open_, closing = tracks_of(state.open), list[Track]()
        share = self.dt / (self.params.tau_motion + self.dt)
        keep = math.exp(-self.dt / self.params.tau_strongest)
        numbers = zip(fields.noise.tolist(), fields.time.tolist(), fields.cut.tolist(), strict=True)
        shades = fields.shades.to(fields.inputs.dtype)
        inputs, outputs = (torch.cat([part, shades], -1).flatten(1, 2) for part in (fields.inputs, fields.outputs))
        parts = (part.detach().cpu().double().numpy() for part in (inputs, outputs, fields.presence))
        for moved, y, o, presence, (noise, time, cut) in zip(
            fields.motion.detach().cpu(), *parts, numbers, strict=True
        ):
            motion = torch.lerp(motion, moved, share)
            if cut:
                # Nothing goes on from one scene to the next.
                closing += [track for track in open_ if stands(track, self.dt, self.aspect, self.params)]
                open_, motion, strongest, scene = [], moved, 0.0, time
            if time - scene < self.params.warm_up:
                continue
            now = motion.double().numpy()
            strongest = max(strongest * keep, float(strengths(now).max()))
            seen = detections(now, y, o, presence, noise, strongest, self.params)
            open_, late = follow(open_, time, seen, began, self.aspect, self.params)
            began = max([began, *(track.number + 1 for track in open_)])
            # A track that was never one of an object will never be.
            closing += [track for track in late if stands(track, self.dt, self.aspect, self.params)]
        closed = table_of([*tracks_of(state.closed), *closing], size) if closing else state.closed
        return TrackerState(
            motion,
            torch.tensor(strongest, dtype=torch.float64),
            torch.tensor(time, dtype=torch.float64),
            torch.tensor(scene, dtype=torch.float64),
            torch.tensor(began, dtype=torch.int64),
            table_of(open_, size),
            closed,
        )

    def objects(self, state: TrackerState) -> list[Track]:
        """The tracks of objects so far, in the order in which they appeared."""
        return standing([*tracks_of(state.closed), *tracks_of(state.open)], self.dt, self.aspect, self.params)

    def in_sight(self, state: TrackerState) -> list[Track]:
        """The tracks with a detection at the latest time step, of objects or not."""
        return [track for track in tracks_of(state.open) if track.last_seen == float(state.time)]
