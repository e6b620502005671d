"""The model foreground: each object in the foreground of a static camera's video becomes a receptive field."""

from __future__ import annotations

import math
from typing import Any, Literal, NamedTuple

import numpy as np
import torch
from pydantic import Field
from torch import Tensor

from ndtorch.arguments import check_dense, check_state
from ndtorch.binding.models.base import BindingModel, Nested, Verdict
from ndtorch.binding.network import InhibitoryNetwork, NetworkState
from ndtorch.binding.normalise import divide, group_max, spread_groups
from ndtorch.binding.objects import BoundObject, features_by_group
from ndtorch.binding.rules import TAU_BOOST, ScaleFreeRule
from ndtorch.config import ModelConfig, Size, constant
from ndtorch.errors import InputError
from ndtorch.foreground._kernels import NETWORK
from ndtorch.foreground.background import (
    BackgroundParams,
    BackgroundState,
    downscale,
    learn,
    segment,
    start_background,
)
from ndtorch.foreground.colors import color_name
from ndtorch.foreground.tracker import (
    BOX,
    MAX_PATH,
    NUMBER,
    PLACE,
    STATUS,
    TIME,
    Status,
    TrackingParams,
    Tracks,
    flags,
    joined,
    kept_from_background,
    no_tracks,
    replace_ghosts,
    update,
    with_values,
)
from ndtorch.utils.tensors import safe_state
from ndtorch.vision.features import FEATURES, GROUPS
from ndtorch.vision.frames import check_frames
from ndtorch.vision.masked_features import MAX_OBJECTS, MaskedFeatures, Measured
from ndtorch.vision.motion import MotionState

MEMORY_S, FLOOR = 20.0, 0.02
"""Signals are divided by the largest of their group in so many seconds, and by at least this compressed contrast."""
NETWORK_S = 0.15
"""The weights of the network change after so many seconds."""
MIN_FLUCTUATION = 0.05
"""Fluctuations of the signals below this change nothing in the network."""


class ForegroundConfig(ModelConfig):
    """Constants of the model."""

    model: Literal["foreground"] = constant("foreground", "Kind of the model.")
    size: Size = constant((224, 398), "Height and width of the frames, pixels.")
    fps: float = constant(30.0, "Frames a second.", gt=0, le=100_000)
    max_fps: float = constant(30.5, "Successive frames are averaged to at most this many a second.", gt=0)
    learn: bool = constant(True, "The weights of the network stay zero if this is false.")
    background: BackgroundParams = Field(default_factory=BackgroundParams)
    tracking: TrackingParams = Field(default_factory=TrackingParams)


class ForegroundSignals(NamedTuple):
    """What the model computed, one row a time step.

    Attributes:
        inputs: normalised signals of every receptive field, that of track n in field n % K, `[..., T', K, 10]`.
        outputs: of the network, likewise.
        labels: number of the track of every pixel of the working image plus one, 0 for none, `[..., T', h, w]` int32.
        mask: 1 where an object is, 0 elsewhere, `[..., T', h, w]` uint8.
        time: seconds since the first frame, `[T']` float64.
        cut: whether a new scene begins, `[T']` bool: nothing of it is known yet, and nothing is foreground.
    """

    inputs: Tensor
    outputs: Tensor
    labels: Tensor
    mask: Tensor
    time: Tensor
    cut: Tensor


@safe_state
class SceneState(NamedTuple):
    """Background model, tracks that go on, the number of tracks begun, and motion detectors."""

    background: BackgroundState
    tracks: Tracks
    count: Any
    features: MotionState


@safe_state
class ForegroundState(NamedTuple):
    """State of the model.

    Attributes:
        scene: None before the first time step.
        waiting: sum of the frames of an unfinished group, `[3, h, w]`.
        frames: frames seen, int64 scalar.
        level: group maxima `[3]`.
        network: of all fields, None before the first time step.
        closed: objects that were lost, and earlier parts of long paths, until `take_closed`.
        time: of the latest step, seconds, float64 scalar.
    """

    scene: SceneState | None
    waiting: Tensor
    frames: Tensor
    level: Tensor
    network: NetworkState | None
    closed: Tracks
    time: Tensor


class ForegroundStep(NamedTuple):
    """One time step: measured features, None where a new scene begins, labels, numbers of the objects that were seen,
    and tracks that ended."""

    time: float
    measured: Measured | None
    labels: Any
    reported: Any
    ended: Tracks


def as_tensors(tree: Any) -> Any:
    """A nested tuple of arrays as one of tensors."""
    if isinstance(tree, tuple):
        return type(tree)(*map(as_tensors, tree))
    return torch.from_numpy(tree) if isinstance(tree, np.ndarray) else tree


def as_arrays(tree: Any) -> Any:
    """A nested tuple of tensors as one of arrays of their own."""
    return type(tree)(*map(as_arrays, tree)) if isinstance(tree, tuple) else tree.numpy().copy()


class ForegroundModel(BindingModel):
    """Objects over time, with places, boxes and masks, in video of a static camera.

    Once a track is confirmed, it is reported from its first detection on, and what was reported stays. A batch of
    films goes through one after the other; its state is a tuple of their states.

    Args:
        config: constants.

    Shapes:
        frames `[..., T, C, H, W]` -> `ForegroundSignals`, `ForegroundState`.
    """

    name = "foreground"
    exportable = False  # blobs are found outside torch
    kernels_only = True
    config_type = ForegroundConfig
    tracks = True
    trained = False
    config: ForegroundConfig

    def __init__(self, config: ForegroundConfig | None = None) -> None:
        super().__init__()
        c = self.config = config or ForegroundConfig()
        self.group = max(1, math.ceil(c.fps / c.max_fps))
        self.dt, self.settle = self.group / c.fps, 0.0
        # Shrinking by a whole number is quick, and the mean of 2 x 2 pixels has half the noise.
        most = c.background.max_height_px
        shrink = max(math.ceil(c.size[0] / most), 2 if c.size[0] >= 0.75 * most else 1)
        self.small = (max(16, c.size[0] // shrink // 4 * 4), max(16, c.size[1] // shrink // 4 * 4))
        self.features = MaskedFeatures(self.small, self.dt)
        rule = ScaleFreeRule(gamma=0.2 if c.learn else 0.0)
        self.network = InhibitoryNetwork.scale_free(
            10, self.dt, rule, shared=True, settle=self.settle, every=NETWORK_S, faint=MIN_FLUCTUATION
        )

    @classmethod
    def build(cls, config: ForegroundConfig, first_stage: Tensor | None) -> ForegroundModel:
        return cls(config)

    def check_own(self, state: Any) -> None:
        for one in state if type(state) in (list, tuple) else (state,):
            check_state(one, ForegroundState)

    def forward(self, frames: Tensor, state: Any = None) -> tuple[ForegroundSignals, Any]:
        check_dense("frames", frames)
        if frames.ndim > 4:
            states = [None] * len(frames) if state is None else state
            if type(states) not in (list, tuple) or len(states) != len(frames):
                raise InputError(
                    f"state must be {len(frames)} states, one for each film, or None, got {type(state).__name__}"
                )
            parts = [self(film, own) for film, own in zip(frames, states, strict=True)]
            stacked = ForegroundSignals(*map(torch.stack, zip(*(signals for signals, _ in parts), strict=True)))
            return stacked._replace(time=stacked.time[0]), tuple(own for _, own in parts)
        if frames.ndim != 4:
            raise InputError(f"frames must have shape [T, C, H, W], got {tuple(frames.shape)}")
        frames = check_frames(frames, self.size)
        if frames.requires_grad and torch.is_grad_enabled():
            raise InputError("foreground has no gradients: detach the frames")
        self.check_own(state)
        if state is None:
            count, start = torch.zeros((), dtype=torch.int64), torch.zeros((), dtype=torch.float64)
            none, black = as_tensors(no_tracks()), torch.zeros(3, *self.small)
            state = ForegroundState(None, black, count, torch.zeros(3), None, none, start)
        scene, closed = None if state.scene is None else as_arrays(state.scene), list[Tracks]()
        waiting, counted, time = state.waiting, int(state.frames), float(state.time)
        steps, masks = list[ForegroundStep](), list[Any]()
        for k, frame in enumerate(frames):
            image = downscale(frame, self.small)
            if self.group > 1:
                waiting = waiting + torch.from_numpy(image)
                if (counted + k + 1) % self.group:
                    continue
                image, waiting = (waiting / self.group).numpy(), torch.zeros_like(waiting)
            time = (counted + k) / self.fps
            scene = self._begin(image, 0) if scene is None else scene
            scene, step = self._step(image, scene, time)
            steps.append(step)
            masks.append(with_values(flags(scene.tracks, scene.tracks.confirmed), step.labels))
            if len(step.ended.path):
                closed.append(step.ended)
        inputs = outputs = torch.zeros(0, MAX_OBJECTS, 10)
        level, network, labels = state.level, state.network, [step.labels for step in steps]
        if scene is not None and steps:
            signals = self.features.signals([step.measured for step in steps], labels)
            levels, keep = [], math.exp(-self.dt / MEMORY_S)
            for largest in group_max(signals).amax(1):
                level = torch.maximum(keep * level, largest)
                levels.append(level)
            inputs = divide(signals, spread_groups(torch.stack(levels).clamp_min(FLOOR).unsqueeze(1)))
            outputs, network = self.network(inputs, network)
            # What the network took and gave is added to the objects that were reported at each step.
            both, row = torch.cat([inputs, outputs], -1).double().numpy(), dict[int, Any]()
            for table in (scene.tracks, *closed):
                row |= zip(table.number.tolist(), table.rows, strict=True)
            for step, values in zip(steps, both, strict=True):
                for number in step.reported.tolist():
                    row[number][NETWORK:] += values[number % MAX_OBJECTS]
        if scene is not None and len(scene.tracks.path) > MAX_PATH:
            path = scene.tracks.path
            early, part = path[:, TIME] < path[-MAX_PATH // 2, TIME], scene.tracks.take(scene.tracks.confirmed)
            closed.append(part._replace(path=part.path[part.path[:, TIME] < path[-MAX_PATH // 2, TIME]]))
            scene = scene._replace(tracks=scene.tracks._replace(path=path[~early]))
        after = ForegroundState(
            as_tensors(scene),
            waiting,
            state.frames + len(frames),
            level,
            network,
            as_tensors(joined(as_arrays(state.closed), *closed)) if closed else state.closed,
            torch.tensor(time, dtype=torch.float64),
        )
        none = np.zeros((0, *self.small), np.int32)
        numbers = torch.from_numpy(np.stack(labels) if labels else none)
        mask = torch.from_numpy(np.stack(masks)) if masks else numbers.to(torch.uint8)
        at = torch.tensor([step.time for step in steps], dtype=torch.float64)
        cut_at = torch.tensor([step.measured is None for step in steps], dtype=torch.bool)
        return ForegroundSignals(inputs, outputs, numbers, mask, at, cut_at), after

    def _begin(self, image: Any, count: int) -> SceneState:
        """A scene that begins with an image."""
        background = start_background(image, self.config.background)
        features = self.features.start(image, background.mean, np.zeros(self.small, np.int32))
        return SceneState(background, no_tracks(), np.array(count, np.int64), features)

    def _step(self, image: Any, scene: SceneState, time: float) -> tuple[SceneState, ForegroundStep]:
        """One image `[3, h, w]`."""
        c, background = self.config, scene.background
        seen = segment(image, background, self.dt, c.background)
        if seen.cut:
            ended, none = scene.tracks.take(scene.tracks.confirmed), np.zeros(0, np.int64)
            begun = self._begin(image, int(scene.count))
            return begun, ForegroundStep(time, None, np.zeros(self.small, np.int32), none, ended)
        seen_for = float(background.frames) * self.dt
        tracks, ended, labels = update(scene.tracks, int(scene.count), seen, time, seen_for, self.dt, c.tracking)
        count = max(int(scene.count), int(tracks.number.max(initial=-1)) + 1)
        measured = self.features.measure(seen.image, background.mean, labels, scene.features)
        kept = kept_from_background(tracks, labels, time, c.tracking)
        learn(seen, kept, background, self.dt, c.background)
        replace_ghosts(tracks, labels, seen, background, c.background.static_after_s, c.tracking)
        reported = tracks.number[tracks.confirmed & (tracks.seen == time)].astype(np.int64)
        after = SceneState(background, tracks, np.array(count, np.int64), scene.features)
        return after, ForegroundStep(time, measured, labels, reported, ended)

    def objects_batch(self, state: Any) -> Nested:
        """The objects so far, in the order in which they appeared, without those that `take_closed` took."""
        if not isinstance(state, ForegroundState):
            return [self.objects_batch(own) for own in state]
        live = no_tracks() if state.scene is None else as_arrays(state.scene.tracks)
        return self._bound(joined(as_arrays(state.closed), live), state)

    def take_closed(self, state: Any) -> tuple[list[BoundObject], Any]:
        if not isinstance(state, ForegroundState):
            raise InputError("the state is that of a batch: take_closed is for the state of one film")
        return self._bound(as_arrays(state.closed), state), state._replace(closed=as_tensors(no_tracks()))

    def visible_objects(self, state: Any) -> list[BoundObject]:
        """The objects of one film that were seen at the latest time step, with their latest box alone."""
        if not isinstance(state, ForegroundState):
            raise InputError("the state is that of a batch: use objects_batch(state)")
        if state.scene is None:
            return []
        tracks = as_arrays(state.scene.tracks)
        return self._bound(tracks._replace(path=tracks.path[tracks.path[:, TIME] == float(state.time)]), state)

    def verdict(self, state: Any) -> Nested:
        """`static` before any foreground, `learning` while the network learns fast, `stable` then."""
        if not isinstance(state, ForegroundState):
            return [self.verdict(own) for own in state]
        word: Verdict = "stable"
        if state.network is None or state.scene is None or int(state.scene.count) == 0:
            word = "static"
        elif self.config.learn and float(state.network.clock) * self.dt < TAU_BOOST:
            word = "learning"
        return word

    def weights(self, state: Any) -> Tensor:
        if not isinstance(state, ForegroundState):
            return torch.stack([self.weights(own) for own in state])
        return torch.zeros(10, 10) if state.network is None else state.network.weights

    def _bound(self, tracks: Tracks, state: ForegroundState) -> list[BoundObject]:
        """The objects of a table whose paths have rows, in the order of their numbers, in pixels of the frames."""
        down = self.size[0]
        scale = np.array([down * self.size[1] / (down * self.small[1] / self.small[0]), down])
        background = None if state.scene is None else state.scene.background.mean.numpy()
        found = []
        for number in np.unique(tracks.path[:, NUMBER]).astype(int).tolist():
            k = int(np.flatnonzero(tracks.number == number)[-1])
            if not tracks.confirmed[k]:
                continue
            path = tracks.path[tracks.path[:, NUMBER] == number]
            places, boxes = path[:, PLACE] * scale, path[:, BOX] * np.tile(scale, 2)
            name = None if background is None else color_name(tracks.color[k], background)
            grey = FEATURES[GROUPS["color"]] if name in ("white", "grey", "black") else ()
            row = features_by_group(torch.from_numpy(tracks.inputs[k])).tolist()
            index = int(tracks.outputs[k].argmax())
            found.append(
                BoundObject(
                    FEATURES[index],
                    index,
                    {one: value for one, value in zip(FEATURES, row, strict=True) if value > 0 and one not in grey},
                    place=tuple(places[-1].tolist()),
                    velocity=tuple((tracks.velocity[k] * scale).tolist()),
                    first_seen=float(path[0, TIME]),
                    last_seen=float(path[-1, TIME]),
                    track=number,
                    heading=tuple(((tracks.place[k] - tracks.start[k]) * scale).tolist()),
                    path=tuple(map(tuple, np.column_stack([path[:, TIME], places]).tolist())),
                    color_name=name,
                    boxes=tuple(map(tuple, boxes.tolist())),
                    states=tuple(Status(int(one)).name.lower() for one in path[:, STATUS]),
                )
            )
        return found
