"""The video model: camera front end, fields with one shared network, tracks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import torch
from pydantic import Field
from torch import Tensor

from ndtorch.arguments import check_dense, check_state
from ndtorch.binding.learning import NetworkState
from ndtorch.binding.models.contract import BindingModel, Nested, Verdict, states_of
from ndtorch.binding.models.scale_free import RuleConstants
from ndtorch.binding.network import InhibitoryNetwork
from ndtorch.binding.normalise import FieldInputs
from ndtorch.binding.objects import BoundObject
from ndtorch.binding.tracking.params import TrackParams
from ndtorch.binding.tracking.tracker import Tracker, TrackerState
from ndtorch.binding.tracking.tracks import Track
from ndtorch.config import Constants, ModelConfig, Size
from ndtorch.errors import InputError
from ndtorch.vision.camera.front_end import CameraFrontEnd, CameraState
from ndtorch.vision.camera.params import CameraParams
from ndtorch.vision.features import FEATURES


class FieldNormalise(Constants):
    """Signals over the largest of their group in any field lately."""

    memory: float = Field(20.0, gt=0, description="of the group maxima")
    floor: float = Field(0.02, gt=0, description="smallest divisor: compressed contrast")


class SharedNetwork(RuleConstants):
    """One scale-free network shared by all fields. Its clock stands still while nothing happens."""

    learn: bool = Field(True, description="false keeps the weights at zero: what is the network worth?")
    quiet: float = Field(0.05, ge=0, description="fluctuations below which nothing happens")


class VideoConfig(ModelConfig):
    """Constants of the model."""

    model: Literal["video"] = Field("video", description="kind of the model")
    size: Size = Field((224, 398), description="height and width of the frames, pixels; 224 rows are quickest")
    fps: float = Field(30.0, gt=0, le=100_000, description="frames a second")
    camera: CameraParams = Field(default_factory=CameraParams)
    normalise: FieldNormalise = Field(default_factory=FieldNormalise)
    network: SharedNetwork = Field(default_factory=SharedNetwork)
    tracking: TrackParams = Field(default_factory=TrackParams)


SWITCHES: dict[str, dict[str, Any]] = {
    "exposure": {"exposure": False},
    "background": {"background": False},
    "noise-floor": {"noise_floor": False},
    "color-inhibition": {"color_inhibition": False},
    "scale": {"scale": 0},
    "compression": {"compression": False},
    "fields": {"grid": (1, 1)},
    "network": {"learn": False},
}
"""What can be switched off by name, and the options that do it."""


def switched_off(parts: Sequence[str]) -> dict[str, Any]:
    """The options that switch parts off.

    Raises:
        InputError: a part that is not among `SWITCHES`.
    """
    options: dict[str, Any] = {}
    for name in parts:
        if name not in SWITCHES:
            raise InputError(f"without must name parts among {', '.join(SWITCHES)}; got {name!r}")
        options |= SWITCHES[name]
    return options


class VideoSignals(NamedTuple):
    """What the model computed, one row a time step: T' is about T below 30 frames a second.

    Attributes:
        inputs: normalised signals of every field, `[..., T', R, C, 10]`.
        outputs: of the network, likewise.
        motion: opponent motion to the right and downward, in squared units of contrast, `[..., T', R, C, 2]`.
        presence: share of every field in which something stands out, `[..., T', R, C]`.
        noise: the threshold that a pixel's difference had to pass, median over the picture, `[..., T']`.
        level: level of the pyramid that motion was taken from, `[..., T']` int64.
        time: seconds since the first frame, `[T']` float64.
        cut: whether a new scene begins, `[..., T']` bool.
        shades: what is white, grey and black, and what has a hue, of what stands out, `[..., T', R, C, 4]`.
    """

    inputs: Tensor
    outputs: Tensor
    motion: Tensor
    presence: Tensor
    noise: Tensor
    level: Tensor
    time: Tensor
    cut: Tensor
    shades: Tensor


class VideoState(NamedTuple):
    """State of front end, normalisation (group maxima `[3]`), network and tracker; the last two are None before the
    first time step."""

    camera: CameraState
    level: Tensor
    network: NetworkState | None
    tracker: TrackerState | None


class VideoModel(BindingModel):
    """Objects over time in video of a camera that does not move.

    A batch of films goes through one after the other; its state is a tuple of their states.

    Args:
        config: constants.

    Shapes:
        frames `[..., T, C, H, W]` -> `VideoSignals`, `VideoState`.
    """

    name = "video"
    config_type = VideoConfig
    tracks = True
    trained = False
    config: VideoConfig

    def __init__(self, config: VideoConfig | None = None) -> None:
        super().__init__()
        c = self.config = config or VideoConfig()
        n = c.network
        self.camera = CameraFrontEnd(c.size, c.fps, c.camera)
        self.dt, self.settle = self.camera.dt, 0.0
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
            faint=n.quiet,
        )
        self.tracker = Tracker(self.dt, self.aspect, c.tracking)

    @property
    def aspect(self) -> float:
        """Width of the picture over its height."""
        return self.size[1] / self.size[0]

    @classmethod
    def build(cls, config: VideoConfig, first_stage: Tensor | None) -> VideoModel:
        return cls(config)

    def forward(self, frames: Tensor, state: Any = None) -> tuple[VideoSignals, Any]:
        check_dense("frames", frames)
        if frames.ndim > 4:
            return self._each(frames, state)
        signals, after = self.signals(frames, state)
        if len(signals.time) == 0:
            return signals, after
        tracker = state.tracker if state is not None else None
        return signals, after._replace(tracker=self.tracker(signals, tracker))

    def signals(self, frames: Tensor, state: VideoState | None = None) -> tuple[VideoSignals, VideoState]:
        """All but the tracks: the part that is tensors from end to end, and that `ndtorch.export` exports."""
        check_state(state, VideoState)
        seen, camera = self.camera(frames, state.camera if state is not None else None)
        level = seen.signals.new_zeros(3) if state is None else state.level
        network, tracker = (None, None) if state is None else (state.network, state.tracker)
        inputs = outputs = seen.signals
        if len(seen.time):
            inputs, level = self.normalise(seen.signals.flatten(1, 2), level)
            outputs, network = self.network(inputs, network)
            inputs, outputs = inputs.view(seen.signals.shape), outputs.view(seen.signals.shape)
        signals = VideoSignals(inputs, outputs, *seen[1:])
        return signals, VideoState(camera, level, network, tracker)

    def _each(self, frames: Tensor, state: Any) -> tuple[VideoSignals, Any]:
        """One film after the other."""
        states = states_of(state, len(frames))
        parts = [self(film, own) for film, own in zip(frames, states, strict=True)]
        columns = zip(*(signals for signals, _ in parts), strict=True)
        stacked = VideoSignals(*(torch.stack(column) for column in columns))
        return stacked._replace(time=stacked.time[0]), tuple(own for _, own in parts)

    def objects(self, state: Any) -> Nested:
        """The objects so far, in the order in which they appeared."""
        if not isinstance(state, VideoState):
            return [self.objects(own) for own in state]
        return [] if state.tracker is None else [self._bound(track) for track in self.tracker.objects(state.tracker)]

    def in_sight(self, state: Any) -> Nested:
        """What is tracked at the latest time step, objects or not (yet)."""
        if not isinstance(state, VideoState):
            return [self.in_sight(own) for own in state]
        return [] if state.tracker is None else [self._bound(track) for track in self.tracker.in_sight(state.tracker)]

    def verdict(self, state: Any) -> Nested:
        """`static` before anything was tracked, `learning` while the network learns fast, `stable` then."""
        if not isinstance(state, VideoState):
            return [self.verdict(own) for own in state]
        word: Verdict = "stable"
        if state.tracker is None or state.network is None or int(state.tracker.began) == 0:
            word = "static"
        elif self.config.network.learn and float(state.network.clock) * self.dt < self.config.network.tau_boost:
            word = "learning"
        return word

    def weights(self, state: Any) -> Tensor:
        if not isinstance(state, VideoState):
            return torch.stack([self.weights(own) for own in state])
        return torch.zeros(10, 10) if state.network is None else state.network.weights

    def _bound(self, track: Track) -> BoundObject:
        """A track as an object, in pixels of the frames."""
        height, width = self.size
        path = tuple((time, column * width, row * height) for time, row, column, _ in track.path.tolist())
        down, right = track.velocity.tolist()
        _, *place = path[-1]
        right_sum, down_sum = track.heading.tolist()
        return BoundObject(
            FEATURES[track.index],
            track.index,
            track.features(self.config.tracking.smallest),
            place=(place[0], place[1]),
            velocity=(right * width, down * height),
            first_seen=track.first_seen,
            last_seen=track.last_seen,
            track=track.number,
            heading=(right_sum, down_sum),
            fields=len(track.fields),
            path=path,
            shade=track.shade,
        )
