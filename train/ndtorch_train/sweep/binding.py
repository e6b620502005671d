"""Trials of the binding model: superposed sums in, whether the right objects came out."""

from __future__ import annotations

import functools
import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor

import ndtorch
from ndtorch.binding import ACTIVATIONS, RULES, PublishedModel, alternation, object_table, weight_change
from ndtorch.binding.models.published import second_stage
from ndtorch.binding.models.whole_field import BindingState
from ndtorch.utils.packages import MODELS
from ndtorch.utils.tensors import mapped
from ndtorch.vision import FEATURES
from ndtorch_train.superposed import Bars, Stimuli, film_bars
from ndtorch_train.sweep.parameters import Parameter, Trial

SETTLE = 4.0

PARAMETERS: Mapping[str, Parameter] = {
    "phase": Parameter(290.0, -360, 720),
    "offset": Parameter(20.0, -1000, 1000),
    "bars": Parameter(2, 1, 3),
    "noise": Parameter(0.0, 0, 10),
    "seed": Parameter(0, 0, 2**31 - 1),
    "gamma": Parameter(0.5, 0, 1000),
    "rule": Parameter("competitive", words=tuple(name for name in RULES if name != "scale-free")),
    "order": Parameter("filter-first", words=("filter-first", "printed")),
    "f": Parameter("cube", words=tuple(ACTIVATIONS)),
    "g": Parameter("tanh-pi", words=tuple(ACTIVATIONS)),
    "tau_in": Parameter(1.0, 0),
    "tau_out": Parameter(0.5, 0),
    "window": Parameter(2.0, 0.01),
    "floor": Parameter(0.01, 0),
    "tau_onset": Parameter(2.0, 0),
    "radius_limit": Parameter(0.95, 0.01, 0.999999),
    "seconds": Parameter(15.0, 0.1, 3600),
}
"""Lead of green over red (degrees), start of blue (px), number of bars, white noise on every sum as a share of its
mean and its seed, and options of the model published."""

TOGETHER = ("phase", "offset", "bars", "noise", "seed", "gamma")
"""Parameters that may differ within a batch; trials that differ in others are computed apart."""

RESULTS: tuple[str, ...] = ("success", "objects", "share", "largest", "alternation", "change")
"""Results that are numbers; besides, there are `owners` and `verdict`."""

BATCH = 512
"""Trials of one batch: the cost of a step is the calls up to some hundreds."""

WANTED = ("red", "green", "blue")

USES = (
    "ndtorch.vision",
    "ndtorch.scenes",
    "ndtorch.binding",
    "ndtorch.loading",
    MODELS,
    "ndtorch_train.superposed",
    "ndtorch_train.sweep.binding",
)
"""Code that a trial depends on."""


def blocks(trials: Sequence[Trial], jobs: int, batch: int = BATCH) -> list[list[Trial]]:
    """Trials that can be computed together, in batches, and at least one batch for each process."""
    groups: dict[tuple[Any, ...], list[Trial]] = defaultdict(list)
    for trial in trials:
        groups[tuple(value for key, value in trial.items() if key not in TOGETHER)].append(trial)
    size = max(1, min(batch, -(-len(trials) // jobs)))
    return [group[k : k + size] for group in groups.values() for k in range(0, len(group), size)]


@functools.cache
def film() -> Bars:
    """The three bars alone, filmed once a process."""
    return film_bars()


def sums_of(trials: Sequence[Trial]) -> Tensor:
    """Sums of the ten features, `[trials, T, 10]`."""
    stimuli = Stimuli(film())
    seconds = SETTLE + float(trials[0]["seconds"])
    count = [int(t["bars"]) for t in trials]
    phases = [float(t["phase"]) for t in trials]
    offsets = [float(t["offset"]) for t in trials]
    sums = stimuli.red(seconds).expand(len(trials), -1, -1).clone()
    for least, unique, make in ((2, phases, stimuli.green), (3, offsets, stimuli.blue)):
        values = sorted({v for v, n in zip(unique, count, strict=True) if n >= least})
        if values:
            made = make(values, seconds)
            for k, (value, n) in enumerate(zip(unique, count, strict=True)):
                if n >= least:
                    sums[k] += made[values.index(value)]
    for k, trial in enumerate(trials):
        if trial["noise"]:
            generator = torch.Generator().manual_seed(int(trial["seed"]))
            scale = float(trial["noise"]) * sums[k].mean(0)
            sums[k] += scale * torch.randn(sums[k].shape, generator=generator)
    return sums


def model_of(trial: Trial) -> PublishedModel:
    """The shipped model with a trial's options."""
    names = ("rule", "order", "f", "g", "tau_in", "tau_out", "window", "floor", "tau_onset", "radius_limit")
    options: dict[str, Any] = {name: trial[name] for name in names}
    # One constant of the paper, one key for each of its two filters.
    model = ndtorch.load("published", **options, tau_sums=trial["tau_in"])
    assert isinstance(model, PublishedModel)
    return model


def run_block(trials: Sequence[Trial], device: str = "cpu") -> list[dict[str, Any]]:
    """Results of trials that differ only in `TOGETHER`, as one batch of networks.

    Scenes that several trials share (same bars, other learning rate) pass the input stage and the first stage once.
    """
    model = model_of(trials[0]).to(device)
    keys = [tuple(t[name] for name in TOGETHER if name != "gamma") for t in trials]
    scenes = list(dict.fromkeys(keys))
    first = [trials[keys.index(scene)] for scene in scenes]
    which = torch.tensor([scenes.index(key) for key in keys], device=device)
    gamma = torch.tensor([float(t["gamma"]) for t in trials], device=device)
    second = second_stage(model.config, gamma).to(device)
    with torch.inference_mode():
        sums = sums_of(first).to(device)
        inputs_state = stage = state = None
        for part in torch.split(sums, 100, -2):  # pieces, so that a thousand trials fit into memory
            (inputs, _), inputs_state = model.inputs(part, inputs_state)
            refined, stage = model.first(inputs, stage)
            _, state = second(refined[which], state)
    assert inputs_state is not None
    assert stage is not None
    assert state is not None
    resample = model.resample(sums[0, :1])[1]
    found = []
    table = object_table(state.weights)
    locked, change = alternation(state), weight_change(state)
    for k, trial in enumerate(trials):
        scene = int(which[k])
        one = BindingState(None, resample, pick(inputs_state, scene), pick(stage, scene), pick(state, k))
        names = [obj.neuron for obj in model.objects(one)]
        weights = state.weights[k]
        wanted = WANTED[: int(trial["bars"])]
        total = float(weights.sum())
        columns = [FEATURES.index(name) for name in wanted]
        found.append(
            {
                "success": float(names == list(wanted)),
                "objects": len(names),
                "share": finite(float(weights[:, columns].sum()) / total if total > 0 else 0.0),
                "largest": finite(float(weights.max())),
                "alternation": finite(float(locked[k])),
                "change": finite(float(change[k])),
                "owners": "+".join(FEATURES[j] for j in table.owners[k].nonzero().flatten().tolist()),
                "verdict": model.verdict(one),
            }
        )
    return found


def finite(value: float) -> float | None:
    """The value, None where a network has diverged."""
    return value if math.isfinite(value) else None


def pick(state: Any, index: int) -> Any:
    """The state of one trial of a batch."""
    return mapped(state, lambda _, part: part[index] if part.ndim else part)
