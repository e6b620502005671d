"""Trials of a sweep: their parameters, and functions that run many of them at once."""

from __future__ import annotations

import functools
import math
from collections import defaultdict
from collections.abc import Hashable, Sequence
from dataclasses import asdict, dataclass
from typing import Annotated, Any, Literal

import torch
from pydantic import Field
from torch import Tensor

import ndtorch
from ndtorch.binding import PublishedModel, alternation, weight_change
from ndtorch.binding.models.whole_field import BindingState, second_stage
from ndtorch.navigation import FeatureParams, MatchParams
from ndtorch.utils.tensors import mapped
from ndtorch.vision import FEATURES
from ndtorch_train.recorded import from_arrays, map_of, quality, ranges_of, record_drive, score_of
from ndtorch_train.superposed import Stimuli, film_bars

Positive = Annotated[float, Field(ge=0)]
Result = dict[str, Any]
SETTLE, BATCH = 4.0, 512
WANTED = ("red", "green", "blue")


@dataclass(frozen=True)
class BindingTrial:
    """One trial of the model `published` on superposed bars.

    Attributes:
        phase: lead of the green bar over the red one, degrees. offset: start of the blue bar, px.
        bars: number of bars, 1 to 3.
        noise: deviation of white noise on every sum, as a ratio of the sum's mean. seed: of the noise.
        seconds: of learning.
    """

    phase: float = 290.0
    offset: float = 20.0
    bars: Annotated[int, Field(ge=1, le=3)] = 2
    noise: Positive = 0.0
    seed: int = 0
    gamma: Positive = 0.5
    rule: Literal["competitive", "cooperative", "hebbian"] = "competitive"
    order: Literal["filter-first", "printed"] = "filter-first"
    f: str = "cube"
    g: str = "tanh-pi"
    tau_in: Positive = 1.0
    tau_out: Positive = 0.5
    window: Annotated[float, Field(ge=0.01)] = 2.0
    floor: Positive = 0.01
    tau_onset: Positive = 2.0
    radius_limit: Annotated[float, Field(gt=0, lt=1)] = 0.95
    seconds: Annotated[float, Field(gt=0, le=3600)] = 15.0

    def together(self) -> Hashable:
        """Trials with equal values of this can be one batch."""
        batched = {"phase", "offset", "bars", "noise", "seed", "gamma"}
        return tuple(value for name, value in asdict(self).items() if name not in batched)


@dataclass(frozen=True)
class DrivingTrial:
    """One simulated drive, and a map of the rows of its first half minute.

    Attributes:
        features: in each frame. reach: R_b of the beams, m. [A eq. A.7]
        min_motion, min_difference: T_min and T_sim. min_disparity, max_disparity: px.
    """

    arena: str = "hallway"
    seed: Annotated[int, Field(ge=0)] = 0
    controller: Literal["published", "ranging", "goal"] = "published"
    seconds: Annotated[float, Field(gt=0)] = 30.0
    odometry: Literal["true", "noisy"] = "true"
    features: Annotated[int, Field(ge=1, le=64)] = 5
    reach: Annotated[float, Field(gt=0)] = 3.0
    min_motion: Positive = 0.01
    min_difference: Positive = 0.008
    min_disparity: Positive = 60.0
    max_disparity: Positive = 200.0
    angle: Literal["atan", "linear"] = "atan"

    def drive(self) -> dict[str, Any]:
        """Options of the drive; trials that differ in others share it."""
        names = ("arena", "seed", "controller", "seconds", "odometry")
        return {name: getattr(self, name) for name in names}

    def together(self) -> Hashable:
        """Trials with equal values of this share one drive."""
        return tuple(self.drive().values())


Trial = BindingTrial | DrivingTrial
KINDS: dict[str, type[BindingTrial] | type[DrivingTrial]] = {"binding": BindingTrial, "driving": DrivingTrial}
RESULTS = {
    "binding": ("success", "objects", "share", "largest", "alternation", "change"),
    "driving": (
        "quality", "precision", "recall", "position_error_cm", "spacing_error_percent", "ranges_a_frame",
        "collisions", "stops", "turns", "distance_m", "free_area_passed",
    ),
}  # fmt: skip
"""Results that are numbers, by kind of sweep."""


def blocks(trials: Sequence[Trial], jobs: int) -> list[list[Trial]]:
    """Trials that are computed together, and at least one block for each process."""
    groups: dict[Hashable, list[Trial]] = defaultdict(list)
    for trial in trials:
        groups[trial.together()].append(trial)
    size = max(1, min(BATCH, -(-len(trials) // jobs)))
    return [group[k : k + size] for group in groups.values() for k in range(0, len(group), size)]


def run_block(trials: Sequence[Any], device: str = "cpu") -> list[Result]:
    """Results of the trials of one block, in their order."""
    return bind(trials, device) if isinstance(trials[0], BindingTrial) else drive(trials)


@functools.cache
def film() -> Stimuli:
    """The three bars alone, filmed once a process."""
    return film_bars()


def sums_of(trial: BindingTrial) -> Tensor:
    """Sums of the ten features, `[T, 10]`."""
    stimuli, seconds = film(), SETTLE + trial.seconds
    sums = stimuli.red(seconds).clone()
    if trial.bars > 1:
        sums += stimuli.green([trial.phase], seconds)[0]
    if trial.bars > 2:
        sums += stimuli.blue([trial.offset], seconds)[0]
    if trial.noise:
        generator = torch.Generator().manual_seed(trial.seed)
        sums += trial.noise * sums.mean(0) * torch.randn(sums.shape, generator=generator)
    return sums


def bind(trials: Sequence[BindingTrial], device: str) -> list[Result]:
    """Results of trials as one batch; scenes that several share pass the first stage once."""
    first = trials[0]
    names = ("rule", "order", "f", "g", "tau_in", "tau_out", "window", "floor", "tau_onset", "radius_limit")
    options: dict[str, Any] = {name: getattr(first, name) for name in names}
    model = ndtorch.load("published", **options, tau_sums=first.tau_in).to(device)
    assert isinstance(model, PublishedModel)
    scene_of = [(t.phase, t.offset, t.bars, t.noise, t.seed) for t in trials]
    scenes = {scene: n for n, scene in enumerate(dict.fromkeys(scene_of))}
    which = torch.tensor([scenes[scene] for scene in scene_of], device=device)
    second = second_stage(model.config, torch.tensor([t.gamma for t in trials], device=device)).to(device)
    with torch.inference_mode():
        sums = torch.stack([sums_of(trials[scene_of.index(scene)]) for scene in scenes]).to(device)
        inputs_state = stage = state = None
        for part in torch.split(sums, 100, -2):
            (inputs, _), inputs_state = model.inputs(part, inputs_state)
            refined, stage = model.first(inputs, stage)
            _, state = second(refined[which], state)
    assert state is not None
    resample = model.resample(sums[0, :1])[1]
    locked, change = alternation(state), weight_change(state)
    results = []
    for k, trial in enumerate(trials):
        parts = [pick(inputs_state, int(which[k])), pick(stage, int(which[k])), pick(state, k)]
        one = BindingState(None, resample, *parts)
        owners, weights = [obj.neuron for obj in model.objects(one)], state.weights[k]
        columns = [FEATURES.index(name) for name in WANTED[: trial.bars]]
        numbers = {
            "share": float(weights[:, columns].sum() / weights.sum().clamp_min(1e-30)),
            "largest": float(weights.max()),
            "alternation": float(locked[k]),
            "change": float(change[k]),
        }
        results.append(
            {
                "success": float(owners == list(WANTED[: trial.bars])),
                "objects": len(owners),
                **{name: value if math.isfinite(value) else None for name, value in numbers.items()},
                "owners": "+".join(owners),
                "verdict": model.verdict(one),
            }
        )
    return results


def pick(state: Any, index: int) -> Any:
    """The state of one trial of a batch."""
    return mapped(state, lambda _, part: part[index] if part.ndim else part)


def drive(trials: Sequence[DrivingTrial]) -> list[Result]:
    """Results of trials of one drive: one set of ranges for each feature detector, one map for each R_b."""
    first = trials[0]
    recorded = from_arrays(record_drive(first.drive()), first.arena, first.seed)
    summary = recorded.summary
    common = {"collisions": len(recorded.collisions), "stops": len(recorded.stops)}
    common |= {name: summary[name] for name in ("turns", "distance_m", "free_area_passed")}
    results = []
    for trial in trials:
        features = FeatureParams(count=trial.features, min_motion=trial.min_motion, min_difference=trial.min_difference)
        ranges = ranges_of(recorded, features, MatchParams(trial.min_disparity, trial.max_disparity), trial.angle)
        score = score_of(recorded, map_of(recorded, ranges, trial.reach))
        rate = float(ranges.valid.double().sum(-1).mean())
        results.append({"quality": quality(score), **score, "ranges_a_frame": rate, **common})
    return results
