"""What the model `figures` is made from, gives and remembers."""

from __future__ import annotations

from typing import Literal, NamedTuple

from pydantic import Field
from torch import Tensor

from ndtorch.binding.learning import NetworkState
from ndtorch.binding.models.scale_free import RuleConstants
from ndtorch.binding.tracking.figure_params import FigureParams
from ndtorch.binding.tracking.figures import FigureTable
from ndtorch.binding.tracking.many import Comings
from ndtorch.binding.tracking.shades import ShadeParams
from ndtorch.config import Constants, ModelConfig, Size
from ndtorch.vision.camera.figure_signals import FieldsState, SignalParams
from ndtorch.vision.camera.ground import GroundParams, GroundState


class FieldNormalise(Constants):
    """Signals over the largest of their group in any field lately."""

    memory: float = Field(20.0, gt=0, description="of the group maxima")
    floor: float = Field(0.02, gt=0, description="smallest divisor: compressed contrast")


class SharedNetwork(RuleConstants):
    """One scale-free network shared by all fields. Its clock stands still while nothing happens."""

    learn: bool = Field(True, description="false keeps the weights at zero: what is the network worth?")
    quiet: float = Field(0.05, ge=0, description="fluctuations below which nothing happens")


class FiguresConfig(ModelConfig):
    """Constants of the model."""

    model: Literal["figures"] = Field("figures", description="kind of the model")
    size: Size = Field((224, 398), description="height and width of the frames, pixels")
    fps: float = Field(30.0, gt=0, le=100_000, description="frames a second")
    fastest: float = Field(30.5, gt=0, description="frames a second beyond which successive frames are averaged")
    ground: GroundParams = Field(default_factory=GroundParams)
    fields: SignalParams = Field(default_factory=SignalParams)
    normalise: FieldNormalise = Field(default_factory=FieldNormalise)
    network: SharedNetwork = Field(default_factory=SharedNetwork)
    tracking: FigureParams = Field(default_factory=FigureParams)
    shades: ShadeParams = Field(default_factory=ShadeParams)


class FiguresSignals(NamedTuple):
    """What the model computed, one row a time step.

    Attributes:
        inputs: normalised signals of every receptive field, that of track n in field n % K, `[..., T', K, 10]`.
        outputs: of the network, likewise.
        silhouettes: number of the track of every pixel of the working image plus one, 0 for none, `[..., T', h, w]`
            int32.
        mask: 1 where a track is that was known to be an object by then, 0 elsewhere, `[..., T', h, w]` uint8.
        time: seconds since the first frame, `[T']` float64.
        cut: whether a new scene begins, `[T']` bool: nothing of it is known yet, and nothing stands out.
    """

    inputs: Tensor
    outputs: Tensor
    silhouettes: Tensor
    mask: Tensor
    time: Tensor
    cut: Tensor


class SeenState(NamedTuple):
    """What the eye remembers.

    Attributes:
        ground: background, noise, and what moved.
        silhouettes: of the step before, `[h, w]` int32.
        kept: where the ground is not learned, `[h, w]`.
        gone: how many tracks came and went at each place without having become objects, `[rows, columns]` float32.
        come: tracks that came lately: number, time, row, column and size of each.
        fields: of the motion detectors.
    """

    ground: GroundState
    silhouettes: Tensor
    kept: Tensor
    gone: Tensor
    come: Comings
    fields: FieldsState | None


class FiguresState(NamedTuple):
    """State of the model.

    Attributes:
        seen: None before the first time step.
        waiting: sum of the frames of an unfinished group, `[3, h, w]`.
        frames: frames seen, and began: tracks begun, int64 scalars.
        level: group maxima `[3]`.
        network: of all fields, None before the first time step.
        open, closed: tracks that may be in sight, and objects that are gone.
        time: of the latest step, seconds, float64 scalar.
    """

    seen: SeenState | None
    waiting: Tensor
    frames: Tensor
    began: Tensor
    level: Tensor
    network: NetworkState | None
    open: FigureTable
    closed: FigureTable
    time: Tensor
