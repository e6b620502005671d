"""Sums and runs of the binding model that several experiments share: 4 s to settle, 15 s to learn."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

import ndtorch
from ndtorch.binding import PublishedModel, object_table
from ndtorch.binding.models.whole_field import BindingState, second_stage
from ndtorch.scenes import make_scene
from ndtorch.vision import FEATURES
from ndtorch_train.plots import feature_legend, matrix_panel, output_panel, panels
from ndtorch_train.reproduce.experiment import Context
from ndtorch_train.superposed import LoneBar, Stimuli, film_bars, rendered_sums

PAIR = ["red", "green"]
N_RED, N_GREEN = FEATURES.index("red"), FEATURES.index("green")


def rendered(context: Context, name: str, **options: Any) -> Tensor:
    """Sums of a named scene, from full 500 x 500 frames; computed once for everybody."""
    key = {"scene": name, **options}
    made = context.stored("sums", key, lambda: {"sums": rendered_sums(make_scene(name, **options)).numpy()})
    return torch.from_numpy(made["sums"])


def superposed(
    context: Context, phases: Sequence[float], offsets: Sequence[float], seconds: float = 19.0
) -> tuple[Tensor, Tensor, Tensor]:
    """Sums of lone bars: red `[T, 10]`, green `[phases, T, 10]`, blue `[offsets, T, 10]`. See `train.superposed`."""

    def make() -> dict[str, Any]:
        bars = film_bars().bars
        places = np.array([(bar.x, bar.speed) for bar in bars])
        return {f"{n}": bar.sums.numpy() for n, bar in enumerate(bars)} | {"places": places}

    got = context.stored("bars", {}, make)
    red, green, blue = (LoneBar(torch.from_numpy(got[f"{n}"]), *at) for n, at in enumerate(got["places"].tolist()))
    stimuli = Stimuli((red, green, blue))
    return stimuli.red(seconds), stimuli.green(phases, seconds), stimuli.blue(offsets, seconds)


class LearningRun(NamedTuple):
    """The second stage over one or many trials.

    Attributes:
        model: that ran.
        time: of the outputs, seconds since learning began.
        outputs: `[..., T, 10]`.
        weight_time, weights: a sample every tenth of a second, `[samples]` and `[..., samples, 10, 10]`.
        state: at the end.
    """

    model: PublishedModel
    time: Tensor
    outputs: Tensor
    weight_time: Tensor
    weights: Tensor
    state: BindingState

    @property
    def final(self) -> Tensor:
        """Weights at the end, `[..., 10, 10]`."""
        weights: Tensor = self.state.second.weights
        return weights


def learn(sums: Tensor, model: PublishedModel | None = None, gamma: float | None = None, **options: Any) -> LearningRun:
    """Run the model over sums `[..., T, 10]`, sampling the weights ten times a second.

    Args:
        sums: one trial or a batch.
        model: instead of the shipped one with `options`.
        gamma: another learning rate.
    """
    if model is None:
        loaded = ndtorch.load("published", **options)
        assert isinstance(loaded, PublishedModel)
        model = loaded
    if gamma is not None:
        model.second = second_stage(model.config, torch.tensor(gamma))
    state, outputs, weights = None, [], []
    with torch.inference_mode():
        for part in torch.split(sums, 10, -2):
            signals, state = model.from_sums(part, state)
            outputs.append(signals.outputs)
            weights.append(state.second.weights)
    assert state is not None
    out = torch.cat(outputs, -2)
    time = torch.arange(out.shape[-2], dtype=torch.float64) * model.dt - model.settle
    ends = torch.arange(1, len(weights) + 1, dtype=torch.float64) * 10 * model.dt - model.settle
    return LearningRun(model, time, out, ends, torch.stack(weights, -3), state)


def owners(weights: Tensor, threshold: float | None = None) -> list[str]:
    """Names of the neurons that own an object by the printed read-out alone. [C §4.1]"""
    table = object_table(weights) if threshold is None else object_table(weights, threshold)
    return [FEATURES[k] for k in table.owners.nonzero().flatten().tolist()]


def draw_runs(context: Context, runs: dict[str, LearningRun], name: str, title: str, caption: str) -> None:
    """A row for each run: its outputs, those of owners bold, for ten seconds; and its simplified weights."""
    rows = [[f"{k}", f"{k} weights"] for k in range(len(runs))]
    figure, axes = panels(rows, 13, 4.7 * len(runs), width_ratios=[1.5, 1])
    for k, (words, run) in enumerate(runs.items()):
        output_panel(axes[2 * k], run.time, run.outputs, f"outputs, {words}", owners(run.final), 10.0)
        matrix_panel(axes[2 * k + 1], run.final, f"weights, {words}", simplified=True)
    feature_legend(figure)
    context.draw(name, figure, title, caption)
