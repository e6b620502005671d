"""The two-stage binding model: frames or sums in, signals and a table of objects out."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple, Self

import torch
from torch import Tensor, nn

from ndtorch.binding.config import BindingConfig, read_config, validated
from ndtorch.binding.feedback import settled
from ndtorch.binding.models.contract import Verdict
from ndtorch.binding.models.scale_free import ScaleFreeStage, StageState
from ndtorch.binding.network import InhibitoryNetwork, NetworkState, alternation, weight_change
from ndtorch.binding.normalise import BindingInputs, InputState
from ndtorch.binding.objects import BoundObject, ObjectTable, bound_objects
from ndtorch.binding.readout.weights import object_table
from ndtorch.binding.rules import ScaleFreeRule, learning_rule
from ndtorch.errors import InputError
from ndtorch.vision.features import GROUPS, VisualFeatures
from ndtorch.vision.motion import Border, MotionState
from ndtorch.vision.resample import Resample, ResampleState

SCALE_FREE = "scale-free"
"""Name of the rule that comes with a network and a read-out of its own."""

# Share of alternating power beyond which the one-step delay, not the scene, makes the outputs: smooth signals have
# 0.001, white noise 0.5, a locked network 0.96 and more.
ALTERNATING = 0.25


class BindingSignals(NamedTuple):
    """What the model computed, one row per step of the networks.

    Attributes:
        sums: the ten spatial sums, `[..., T', 10]`.
        inputs: group-normalised inputs of the first stage.
        refined: outputs of the first stage; with the scale-free rule, settled ones.
        outputs: outputs of the second stage.
        scale: each group's recent maximum, n(t) of [C eq. 11].
        time: seconds since the first frame, `[T']`.
    """

    sums: Tensor
    inputs: Tensor
    refined: Tensor
    outputs: Tensor
    scale: Tensor
    time: Tensor


class BindingState(NamedTuple):
    """Everything of `VisualBinding` that changes: nested tuples of tensors, see `ndtorch.binding.saving`.

    With the scale-free rule `first` is None, for a settled first stage has no state.
    """

    motion: MotionState | None
    resample: ResampleState
    inputs: InputState
    first: NetworkState | None
    second: NetworkState | StageState


class VisualBinding(nn.Module):
    """Frames -> ten wide-field signals -> three refining networks -> one binding network -> objects. [B, C]

    Args:
        first_stage: `[10, 10]` weights of the three first-stage networks on the diagonal blocks.
        config: constants of the model.
        size: height and width of the frames in pixels.
        fps: frames per second. The published networks run at their own step (`config.dt`, 10 ms), and signals of
            slower or faster video are interpolated; the scale-free rule runs at the rate of the frames.
        border: "wrap" for the toroidal scenes, "reflect" for real video.
        exact: orientation sums at full resolution (slower, differs by < 0.5 %).
        fused: compile the motion sums (see `VisualFeatures`).

    Shapes:
        frames `[..., T, C, H, W]` -> `BindingSignals` with T' rows, `BindingState`. T' = T at 100 frames a
        second. `state=None` starts at rest, settled on the first frame; the second stage begins to learn
        after `config.settle` seconds. Chunks of any length give the same result.

    Raises:
        InputError: frames, weights or options that do not fit, with a message that says which.
    """

    def __init__(
        self,
        first_stage: Tensor,
        config: BindingConfig | None = None,
        size: tuple[int, int] = (500, 500),
        fps: float = 100.0,
        border: Border = "wrap",
        exact: bool = False,
        fused: bool = False,
    ) -> None:
        super().__init__()
        c = config or BindingConfig()
        if not 0 < fps <= 100_000:
            raise InputError(f"fps must be a positive number of frames a second, got {fps}")
        self.config, self.fps = c, fps
        self.scale_free = c.rule == SCALE_FREE
        # A settled network has no delay of one step that a long step could make unstable.
        self.dt = 1 / fps if self.scale_free else c.dt
        self.features = VisualFeatures(size, 1 / fps, c.tau_motion_high, c.tau_motion_low, border, exact, fused)
        self.resample = Resample(1 / fps, self.dt)
        self.inputs = BindingInputs(self.dt, c.order, c.tau_in, c.window, c.floor)
        # The inputs come high-passed. The three networks are one with weights inside the groups only.
        self.first = InhibitoryNetwork(10, c.dt, None, tau_in=float("inf"), initial=check_first_stage(first_stage))
        self.second: InhibitoryNetwork | ScaleFreeStage
        if self.scale_free:
            rule = ScaleFreeRule(c.scale_free_gamma, radius_limit=c.radius_limit)
            self.second = ScaleFreeStage(
                first_stage, self.dt, rule, c.readout, c.tau_smooth, c.scale_free_settle, c.stable_window, c.stable_mean
            )
            return
        self.second = second_stage(c)

    @classmethod
    def load(cls, path: str | Path, **options: Any) -> Self:
        """Load a trained model from its folder (config.toml, weights.safetensors).

        Args:
            path: the folder.
            options: `size`, `fps`, `border`, `exact`, `fused`, and any field of `BindingConfig`, in place of what the
                folder says.

        Raises:
            InputError: folder or file missing, weights missing or of the wrong shape, unknown option.
        """
        folder = Path(path)
        if not folder.is_dir():
            raise InputError(f"{folder} is not a model folder")
        own = {name: options.pop(name) for name in ("size", "fps", "border", "exact", "fused") if name in options}
        config = read_config(folder / "config.toml")
        config = validated({**config.model_dump(), **options}, "options")
        return cls(read_first_stage(folder / "weights.safetensors"), config, **own)

    def forward(self, frames: Tensor, state: BindingState | None = None) -> tuple[BindingSignals, BindingState]:
        motion = state.motion if state is not None else None
        if state is not None and motion is None:
            raise InputError("state comes from from_sums and has no motion filters: go on with from_sums")
        sums, motion = self.features(frames, motion)
        signals, state = self.from_sums(sums, state)
        return signals, state._replace(motion=motion)

    def from_sums(self, sums: Tensor, state: BindingState | None = None) -> tuple[BindingSignals, BindingState]:
        """The model from the ten spatial sums on, `[..., T, 10]`, one row a frame.

        For sums that were stored or superposed: many trials of many scenes make one batch.
        """
        sums, resample = self.resample(sums, state.resample if state is not None else None)
        if sums.shape[-2] == 0:
            assert state is not None
            empty = torch.zeros_like(sums)
            time = torch.zeros(0, dtype=torch.float64)
            return BindingSignals(sums, empty, empty, empty, empty, time), state._replace(resample=resample)
        if not torch.isfinite(sums).all():
            raise InputError("sums must be finite, got NaN or infinite values")
        (inputs, scale), input_state = self.inputs(sums, state.inputs if state is not None else None)
        first: NetworkState | None = None
        if self.scale_free:
            assert self.first.initial is not None
            refined = inputs @ settled(self.first.initial.to(inputs.dtype)).mT
        else:
            refined, first = self.first(inputs, state.first if state is not None else None)
        outputs, second = self.second(refined, state.second if state is not None else None)
        steps = sums.shape[-2]
        time = (torch.arange(steps, dtype=torch.float64) + (int(second.steps) - steps)) * self.dt
        signals = BindingSignals(sums, inputs, refined, outputs, scale, time)
        motion = state.motion if state is not None else None
        return signals, BindingState(motion, resample, input_state, first, second)

    def verdict(self, state: BindingState) -> Verdict:
        """What the weights of one trial are worth at this moment.

        `static`: fewer than two groups of features fluctuate, so there is nothing to bind. `alternating`: the
        outputs flip sign from step to step, a fault of the one-step delay at high learning rates; the weights mean
        nothing (never with the scale-free rule, which has no such delay). `learning`: the mean weights still change by
        more than `stable_change` per `stable_window` [C eq. 5], or, with the published rules, no weight has grown far
        enough to silence another neuron. `stable`: none of these.
        """
        c = self.config
        if state.second.weights.ndim != 2:
            raise InputError(
                f"verdict takes the state of one trial, got a batch of {tuple(state.second.weights.shape)}"
            )
        if int(fluctuating_groups(state.inputs, c.floor)) < 2:
            return "static"
        second = state.second
        # Written so that NaN never counts as stable.
        if isinstance(second, StageState):
            return "stable" if float(second.network.changes.sum(-1)) <= c.stable_change else "learning"
        if not float(alternation(second)) <= ALTERNATING:
            return "alternating"
        unchanged = float(weight_change(second)) <= c.stable_change
        return "stable" if unchanged and float(second.weights.max()) >= c.learned_weight else "learning"

    def objects(self, state: BindingState) -> list[BoundObject]:
        """The objects in view of one trial. [C §4.1]

        None while the verdict is `static` or `alternating`, and none before any weight has reached
        `learned_weight`: the read-out divides by the largest weight, and makes a table of the noise of a
        network that has learned nothing.
        """
        if self.verdict(state) in ("static", "alternating"):
            return []
        return bound_objects(self.table(state))

    def table(self, state: BindingState) -> ObjectTable:
        """The table of the objects, of one trial or a batch, whatever the verdict: by weights [C §4.1], zero until they
        mean something, or by the read-out of the scale-free rule."""
        second = state.second
        if isinstance(second, StageState):
            assert isinstance(self.second, ScaleFreeStage)
            return self.second.table(second)
        learned = second.weights.amax((-1, -2), keepdim=True) >= self.config.learned_weight
        return object_table(torch.where(learned, second.weights, 0.0))

    @property
    def settle(self) -> float:
        """Seconds before the second stage learns."""
        return self.config.scale_free_settle if self.scale_free else self.config.settle


def second_stage(config: BindingConfig, gamma: float | Tensor | None = None) -> InhibitoryNetwork:
    """The second stage of the published model, untrained.

    Args:
        gamma: learning rates `[...]` in place of the configuration's, one for every trial of a batch.
    """
    c = config
    return InhibitoryNetwork(
        10,
        c.dt,
        learning_rule(
            c.rule,
            f=c.f,
            g=c.g,
            gamma=c.gamma if gamma is None else gamma,
            tau_onset=c.tau_onset,
            radius_limit=c.radius_limit,
        ),
        tau_in=c.tau_in,
        tau_out=c.tau_out,
        settle=c.settle,
        window=c.stable_window,
        tau_mean=c.stable_mean,
    )


def fluctuating_groups(state: InputState, floor: float) -> Tensor:
    """How many of the three groups fluctuated by more than `floor` of their level recently, `[...]`."""
    if state.sums.shape[-2] == 0:
        # A memory of a single step has nothing to compare: give every group the benefit of the doubt.
        return torch.full(state.sums.shape[:-2], state.sums.shape[-1])
    return (state.fluctuations.amax(-2) > floor * state.sums.amax(-2)).sum(-1)


def check_first_stage(weights: Tensor) -> Tensor:
    """The `[10, 10]` first-stage weights if they are usable: finite, non-negative, zero outside the groups."""
    if weights.shape != (10, 10):
        raise InputError(f"first-stage weights must be [10, 10], got {tuple(weights.shape)}")
    inside = torch.zeros(10, 10, dtype=torch.bool)
    for group in GROUPS.values():
        inside[group, group] = True
    inside.fill_diagonal_(False)
    if not torch.isfinite(weights).all() or (weights < 0).any() or weights[~inside].any():
        raise InputError(
            "first-stage weights must be finite, non-negative, and zero on the diagonal and between groups"
        )
    return weights


def read_first_stage(path: Path) -> Tensor:
    """The `[10, 10]` first-stage weights in a weights.safetensors with the keys motion, orientation and color."""
    from safetensors import SafetensorError
    from safetensors.torch import load_file

    if not path.is_file():
        raise InputError(f"{path} is missing")
    try:
        tensors = load_file(path)
    except (SafetensorError, OSError) as error:
        raise InputError(f"{path} is not a safetensors file: {error}") from None
    weights = torch.zeros(10, 10)
    for name, group in GROUPS.items():
        n = group.stop - group.start
        if name not in tensors:
            raise InputError(f"{path} has no weights called {name!r}; it has {', '.join(sorted(tensors)) or 'none'}")
        if tensors[name].shape != (n, n):
            raise InputError(f"{path}: {name} must be [{n}, {n}], got {tuple(tensors[name].shape)}")
        weights[group, group] = tensors[name].float()
    return weights
