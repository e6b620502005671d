"""The model foreground: each object in the foreground of a static camera's video becomes a receptive field."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
import torch
from pydantic import Field
from torch import Tensor

from ndtorch.arguments import check_dense, check_state
from ndtorch.binding.learning import NetworkState
from ndtorch.binding.models.base import BindingModel, Nested, Verdict, states_of
from ndtorch.binding.models.scale_free import RuleConstants
from ndtorch.binding.network import InhibitoryNetwork
from ndtorch.binding.normalise import FieldInputs
from ndtorch.binding.objects import BoundObject
from ndtorch.binding.readout.owners import features_by_group
from ndtorch.config import Constants, ModelConfig, Size, constant
from ndtorch.errors import InputError
from ndtorch.foreground.arrays import Bytes, Floats, aligned, aligned_copy
from ndtorch.foreground.background import (
    BackgroundModel,
    BackgroundParams,
    BackgroundState,
    replace_background,
    update_background,
)
from ndtorch.foreground.downscale import downscale
from ndtorch.foreground.segmentation import segment
from ndtorch.tracking.blobs import detect_blobs
from ndtorch.tracking.color_names import ColorParams, WhiteBalance, achromatic_name
from ndtorch.tracking.params import TrackingParams
from ndtorch.tracking.rigid_motion import confidence
from ndtorch.tracking.track import Track, TrackTable, joined_parts, table_from_tracks, tracks_from_table
from ndtorch.tracking.tracker import Tracker, TrackerState
from ndtorch.utils.tensors import mapped
from ndtorch.vision.features import FEATURES, GROUPS
from ndtorch.vision.frames import check_frames
from ndtorch.vision.masked_features import FeatureParams, FeatureState, MaskedFeatures, Measured


class FieldNormalise(Constants):
    """Signals over the largest of their group in any field lately."""

    memory: float = constant(20.0, "The group maxima are remembered with this time constant in seconds.", gt=0)
    floor: float = constant(0.02, "Signals are divided by at least this compressed contrast.", gt=0)


class SharedNetwork(RuleConstants):
    """One scale-free network shared by all fields. Its clock stops while nothing happens."""

    learn: bool = constant(True, "The weights stay zero if this is false.")
    min_fluctuation: float = constant(0.05, "Fluctuations below this change nothing.", ge=0)


class ForegroundConfig(ModelConfig):
    """Constants of the model."""

    model: Literal["foreground"] = constant("foreground", "kind of the model")
    size: Size = constant((224, 398), "height and width of the frames, pixels")
    fps: float = constant(30.0, "frames a second", gt=0, le=100_000)
    max_fps: float = constant(30.5, "Successive frames are averaged to at most this many a second.", gt=0)
    background: BackgroundParams = Field(default_factory=BackgroundParams)
    features: FeatureParams = Field(default_factory=FeatureParams)
    normalise: FieldNormalise = Field(default_factory=FieldNormalise)
    network: SharedNetwork = Field(default_factory=SharedNetwork)
    tracking: TrackingParams = Field(default_factory=TrackingParams)
    colors: ColorParams = Field(default_factory=ColorParams)


class ForegroundSignals(NamedTuple):
    """What the model computed, one row a time step.

    Attributes:
        inputs: normalised signals of every receptive field, that of track n in field n % K, `[..., T', K, 10]`.
        outputs: of the network, likewise.
        labels: number of the track of every pixel of the working image plus one, 0 for none, `[..., T', h, w]` int32.
        mask: 1 where a track is that was an object by then, 0 elsewhere, `[..., T', h, w]` uint8.
        time: seconds since the first frame, `[T']` float64.
        cut: whether a new scene begins, `[T']` bool: nothing of it is known yet, and nothing is foreground.
    """

    inputs: Tensor
    outputs: Tensor
    labels: Tensor
    mask: Tensor
    time: Tensor
    cut: Tensor


class SegmentationState(NamedTuple):
    """First image `[3, h, w]`, background model, where it is not learned `[h, w]`, tracker, and motion detectors: None
    before any blob."""

    first: Tensor
    background: BackgroundState
    kept: Tensor
    tracker: TrackerState
    features: FeatureState | None


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

    scene: SegmentationState | None
    waiting: Tensor
    frames: Tensor
    level: Tensor
    network: NetworkState | None
    closed: TrackTable
    time: Tensor


class Step(NamedTuple):
    """What one step gives: measured features, mask of the objects, objects that were lost or part of whose path is
    closed, and whether a scene began."""

    measured: Measured | None
    mask: Bytes
    closed: list[Track]
    cut: bool


@dataclass
class WorkBuffers:
    """A `SegmentationState` in arrays of its own, which every step of a call changes in place."""

    first: Floats
    background: BackgroundModel
    kept: Floats
    tracker: Tracker
    features: FeatureState | None

    def state(self) -> SegmentationState:
        """The state at the end of a call. It shares the memory, which is not changed any more."""
        state = SegmentationState(self.first, self.background.state(), self.kept, self.tracker.state(), self.features)  # type: ignore[arg-type]
        return as_tensors(state)  # type: ignore[no-any-return]


def as_tensors(tree: Any) -> Any:
    """A nested tuple of arrays as one of tensors, which share their memory."""
    if isinstance(tree, np.ndarray):
        return torch.from_numpy(tree)
    return type(tree)(*map(as_tensors, tree)) if isinstance(tree, tuple) else tree


def joined_tables(tables: Sequence[TrackTable]) -> TrackTable:
    """Tables of tensors, one after the other."""
    return TrackTable(*map(torch.cat, zip(*tables, strict=True)))


class ForegroundModel(BindingModel):
    """Objects over time, with places, boxes and masks, in video of a static camera.

    A batch of films goes through one after the other; its state is a tuple of their states.

    Args:
        config: constants.

    Shapes:
        frames `[..., T, C, H, W]` -> `ForegroundSignals`, `ForegroundState`.
    """

    name = "foreground"
    state_types = (ForegroundState,)
    one_by_one = True
    exportable = False  # blobs are found outside torch
    kernels_only = True
    config_type = ForegroundConfig
    tracks = True
    trained = False
    config: ForegroundConfig

    def __init__(self, config: ForegroundConfig | None = None) -> None:
        super().__init__()
        c = self.config = config or ForegroundConfig()
        n = c.network
        self.group = max(1, math.ceil(c.fps / c.max_fps))
        self.dt, self.settle = self.group / c.fps, 0.0
        # Shrinking by a whole number is quick.
        shrink = math.ceil(c.size[0] / c.background.max_height_px)
        self.small = (max(16, c.size[0] // shrink // 4 * 4), max(16, c.size[1] // shrink // 4 * 4))
        self.features = MaskedFeatures(self.small, self.dt, c.features)
        self.normalise = FieldInputs(self.dt, c.normalise.memory, c.normalise.floor)
        self.network = InhibitoryNetwork(
            10,
            self.dt,
            n.learning_rule() if n.learn else None,
            "settled",
            shared=True,
            tau_in=math.inf,
            tau_out=n.tau_out,
            tau_power=n.tau_power,
            settle=self.settle,
            faint=n.min_fluctuation,
        )

    @classmethod
    def build(cls, config: ForegroundConfig, first_stage: Tensor | None) -> ForegroundModel:
        return cls(config)

    def forward(self, frames: Tensor, state: Any = None) -> tuple[ForegroundSignals, Any]:
        check_dense("frames", frames)
        if frames.ndim > 4:
            return self._each(frames, state)
        if frames.ndim != 4:
            raise InputError(f"frames must have shape [T, C, H, W], got {tuple(frames.shape)}")
        frames = check_frames(frames, self.size)
        if frames.requires_grad and torch.is_grad_enabled():
            raise InputError("foreground has no gradients: detach the frames")
        check_state(state, ForegroundState)
        state = self._start() if state is None else state
        work, ended = None if state.scene is None else self._resume(state.scene), list[Track]()
        waiting, counted, time = state.waiting, int(state.frames), float(state.time)
        steps, labels, times, seen = list[Step](), list[Any](), list[float](), list[list[Track]]()
        for k, frame in enumerate(frames):
            image = downscale(frame, self.small)
            if self.group > 1:
                waiting = waiting + torch.from_numpy(image)
                if (counted + k + 1) % self.group:
                    continue
                image, waiting = (waiting / self.group).numpy(), torch.zeros_like(waiting)
            time = (counted + k) / self.fps
            work = self._begin(image) if work is None else work
            step = self._step(image, work, time)
            ended += step.closed
            steps.append(step)
            labels.append(work.tracker.labels)
            times.append(time)
            seen.append([track for track in work.tracker.tracks if track.last_seen == time])
        inputs = outputs = torch.zeros(0, self.config.features.max_objects, 10)
        level, network = state.level, state.network
        if steps:
            inputs, level = self.normalise(self.features.signals([step.measured for step in steps], labels), level)
            outputs, network = self.network(inputs, network)
            self._bind(seen, inputs, outputs)
        closed = joined_tables([state.closed, as_tensors(table_from_tracks(ended))]) if ended else state.closed
        after = ForegroundState(
            None if work is None else work.state(),
            waiting,
            state.frames + len(frames),
            level,
            network,
            closed,
            torch.tensor(time, dtype=torch.float64),
        )
        none = np.zeros((0, *self.small), np.int32)
        numbers = torch.from_numpy(np.stack(labels) if labels else none)
        masks = torch.from_numpy(np.stack([step.mask for step in steps])) if steps else numbers.to(torch.uint8)
        at, cuts = torch.tensor(times, dtype=torch.float64), torch.tensor([step.cut for step in steps]).bool()
        return ForegroundSignals(inputs, outputs, numbers, masks, at, cuts), after

    def _start(self) -> ForegroundState:
        """The state before the first frame."""
        zero, time, closed = torch.zeros((), dtype=torch.int64), torch.zeros(()).double(), table_from_tracks([])
        waiting = torch.zeros(3, *self.small)
        return ForegroundState(None, waiting, zero, torch.zeros(3), None, as_tensors(closed), time)

    def _begin(self, image: Floats) -> WorkBuffers:
        """A scene that begins with an image."""
        c = self.config
        tracker = Tracker(Tracker.start(*self.small), self.dt, c.tracking)
        kept = np.zeros(self.small, np.float32)
        return WorkBuffers(image.copy(), BackgroundModel.start(image, c.background), kept, tracker, None)

    def _resume(self, scene: SegmentationState) -> WorkBuffers:
        """A scene that goes on; the state is left as it is."""
        tracker = Tracker(scene.tracker, self.dt, self.config.tracking)
        features: Any = mapped(scene.features, lambda _, part: aligned_copy(part))  # type: ignore[arg-type, return-value]
        # No step reads where the background was not learned at the one before.
        first, kept = aligned_copy(scene.first), aligned(*self.small)
        return WorkBuffers(first, BackgroundModel.of(scene.background), kept, tracker, features)

    def _step(self, image: Floats, work: WorkBuffers, time: float) -> Step:
        """One image `[3, h, w]`; the buffers are changed."""
        c, background, tracker = self.config, work.background, work.tracker
        seen = segment(image, background, self.dt, c.background)
        if seen.scene_cut:
            return self._new_scene(image, work)
        moving = tracker.moving(time)
        blobs, ghosts = detect_blobs(
            seen, background, tracker.tracks, tracker.labels, moving, time, c.background, c.tracking
        )
        light = WhiteBalance(seen.image, seen.background, c.colors)
        tracker.update(blobs, seen, light, time, background.frames * self.dt)
        if work.features is None:
            work.features = self.features.start(seen.image, seen.background, tracker.labels)
        measured = self.features.measure(seen.image, seen.background, tracker.labels, work.features)
        # What a moving object has just covered must not be learned: at one frame a second that is a tenth of it.
        mask = tracker.object_mask(time, work.kept)
        tracker.trace_back(ghosts, work.first, seen, time, background.frames * self.dt)
        update_background(background, seen.image, seen.noise, work.kept, self.dt, c.background)
        if ghosts is not None:
            replace_background(background, seen.image, ghosts)
        return Step(measured, mask, tracker.closed, False)

    def _new_scene(self, image: Floats, work: WorkBuffers) -> Step:
        """Everything that was followed is lost; a new scene begins as a film does."""
        lost, tracker = work.tracker.end_all(), work.tracker
        vars(work).update(vars(self._begin(image)) | {"tracker": tracker})
        return Step(None, np.zeros(self.small, np.uint8), lost, True)

    def _bind(self, seen: list[list[Track]], inputs: Tensor, outputs: Tensor) -> None:
        """Add what the network took and gave to the tracks that were seen at each step."""
        own, through = inputs.double().numpy(), outputs.double().numpy()
        for k, tracks in enumerate(seen):
            for track in tracks:
                slot = track.number % self.config.features.max_objects
                track.inputs, track.outputs = track.inputs + own[k, slot], track.outputs + through[k, slot]

    def _each(self, frames: Tensor, state: Any) -> tuple[ForegroundSignals, Any]:
        """One film after the other."""
        states = states_of(state, len(frames))
        parts = [self(film, own) for film, own in zip(frames, states, strict=True)]
        columns = zip(*(signals for signals, _ in parts), strict=True)
        stacked = ForegroundSignals(*(torch.stack(column) for column in columns))
        return stacked._replace(time=stacked.time[0]), tuple(own for _, own in parts)

    def objects_batch(self, state: Any) -> Nested:
        """The objects so far, in the order in which they appeared, without those that `take_closed` took."""
        if not isinstance(state, ForegroundState):
            return [self.objects_batch(own) for own in state]
        every = tracks_from_table(state.closed)
        if state.scene is not None:
            every += tracks_from_table(state.scene.tracker.tracks)
        return [self._bound(one) for one in joined_parts([one for one in every if one.is_object])]

    def take_closed(self, state: Any) -> tuple[list[BoundObject], Any]:
        if not isinstance(state, ForegroundState):
            raise InputError("the state is that of a batch: take_closed is for the state of one film")
        closed, known = tracks_from_table(state.closed), dict[int, Track]()
        if closed and state.scene is not None:
            known = {one.number: one for one in tracks_from_table(state.scene.tracker.tracks)}
        parts = joined_parts(closed)
        for one in parts:
            live = known.get(one.number, one)
            one.inputs, one.outputs = live.inputs, live.outputs
        return [self._bound(one) for one in parts], state._replace(closed=as_tensors(table_from_tracks([])))

    def restore_closed(self, state: Any, closed: Sequence[Any]) -> Any:
        return state._replace(closed=joined_tables([*closed, state.closed]))

    def visible_objects(self, state: Any) -> list[BoundObject]:
        if not isinstance(state, ForegroundState):
            raise InputError("the state is that of a batch: use objects_batch(state)")
        if state.scene is None:
            return []
        now, tracks = float(state.time), tracks_from_table(state.scene.tracker.tracks)
        return [self._bound(one) for one in tracks if one.is_object and one.last_seen == now]

    def verdict(self, state: Any) -> Nested:
        """`static` before any foreground, `learning` while the network learns fast, `stable` then."""
        if not isinstance(state, ForegroundState):
            return [self.verdict(own) for own in state]
        word: Verdict = "stable"
        if state.network is None or state.scene is None or int(state.scene.tracker.count) == 0:
            word = "static"
        elif self.config.network.learn and float(state.network.clock) * self.dt < self.config.network.tau_boost:
            word = "learning"
        return word

    def weights(self, state: Any) -> Tensor:
        if not isinstance(state, ForegroundState):
            return torch.stack([self.weights(own) for own in state])
        return torch.zeros(10, 10) if state.network is None else state.network.weights

    def _bound(self, one: Track) -> BoundObject:
        """A track as an object, in pixels of the frames."""
        height = self.size[0]
        across = self.size[1] / (height * self.small[1] / self.small[0])
        path, boxes = [], []
        for time, row, column, top, left, bottom, right, *_ in (*one.before(self.dt), *one.path.tolist()):
            path.append((time, column * height * across, row * height))
            boxes.append((left * height * across, top * height, right * height * across, bottom * height))
        _, x, y = path[-1]
        index = int(one.outputs.argmax())
        row, shade = features_by_group(torch.from_numpy(one.inputs)).tolist(), achromatic_name(one.shades)
        hues = () if shade is None else FEATURES[GROUPS["color"]]
        return BoundObject(
            FEATURES[index],
            index,
            {name: value for name, value in zip(FEATURES, row, strict=True) if value > 0 and name not in hues},
            place=(x, y),
            velocity=(float(one.velocity[1]) * height * across, float(one.velocity[0]) * height),
            first_seen=path[0][0],
            last_seen=one.last_seen,
            track=one.number,
            heading=(x - path[0][1], y - path[0][2]),
            path=tuple(path),
            shade=shade,
            boxes=tuple(boxes),
            confidence=round(confidence(one), 3),
        )
