"""What is compared: learning rules with their read-outs, and offline separation of the same signals."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import torch
from torch import Tensor

import ndtorch
from ndtorch.binding import BindingInputs, PublishedModel, ScaleFreeModel, alternation, object_table
from ndtorch.binding.feedback import settled
from ndtorch.binding.models.whole_field import BindingState
from ndtorch.binding.normalise import divide, group_max, spread_groups
from ndtorch.optional import need
from ndtorch.vision import LowPass
from ndtorch_train.score.truth import by_group, present

TAU_SMOOTH = 0.05
"""Low-pass on the sums, seconds."""
FILTERS_SETTLE = 1.0
EMPTY = 1e-9
"""Power under which there is nothing to separate."""


@dataclass(frozen=True)
class Reading:
    """What a method says of many scenes at one moment.

    Attributes:
        found: features of the objects of every scene, `[objects, 10]` bool each.
        alternating: scenes whose outputs flip sign from step to step, `[B]` bool.
    """

    found: list[Tensor]
    alternating: Tensor


class Method(Protocol):
    """Takes sums `[B, T, 10]` at `fps` and says what is in view at `times`, seconds from the first frame."""

    online: bool

    def __call__(self, sums: Tensor, fps: float, times: Sequence[float]) -> list[Reading]:
        """One reading for each of `times`, which ascend."""
        ...


def first_stage() -> Tensor:
    """The trained first-stage weights, `[10, 10]`."""
    weights = ndtorch.load("published").first_stage()
    assert weights is not None
    return weights


class Learned:
    """The published model with one of its rules, learning while it looks."""

    online = True

    def __init__(self, rule: str) -> None:
        self.rule = rule

    def __call__(self, sums: Tensor, fps: float, times: Sequence[float]) -> list[Reading]:
        model = ndtorch.load("published", fps=fps, rule=self.rule)
        assert isinstance(model, PublishedModel)
        readings, state, done = [], None, 0
        with torch.inference_mode():
            for time in times:
                upto = round(time * fps)
                _, state = model.from_sums(sums[:, done:upto], state)
                readings.append(self.read(state, model.config.readout.alternating))
                done = upto
        return readings

    @staticmethod
    def read(state: BindingState, alternating: float) -> Reading:
        """The published table [C §4.1], whatever the verdict on the weights would be."""
        table = object_table(state.second.weights)
        found = [rows[own] > 0 for rows, own in zip(table.rows, table.owners, strict=True)]
        return Reading(found, ~(alternation(state.second) <= alternating))


class Signals:
    """The preprocessing of the scale-free rule: low-pass 50 ms, high-pass and group maxima, settled first stage."""

    def __init__(self, fps: float) -> None:
        self.smooth = LowPass(TAU_SMOOTH, 1 / fps, 1)
        self.inputs = BindingInputs(1 / fps)
        self.refine = settled(first_stage()).T
        self.states: tuple[Any, Any] = (None, None)

    def __call__(self, sums: Tensor) -> Tensor:
        """The next piece `[B, T, 10]`; goes on where the last one ended."""
        smooth, low = self.smooth(sums, self.states[0])
        (inputs, _), state = self.inputs(smooth, self.states[1])
        self.states = (low, state)
        refined: Tensor = inputs @ self.refine
        return refined


class ScaleFree:
    """The scale-free model at the rate of the frames, with one of its read-outs.

    Args:
        readout: "owners" or "sums".
    """

    online = True

    def __init__(self, readout: str) -> None:
        self.readout = readout

    def __call__(self, sums: Tensor, fps: float, times: Sequence[float]) -> list[Reading]:
        model = ndtorch.load("scale-free", fps=fps, readout=self.readout)
        assert isinstance(model, ScaleFreeModel)
        readings, state, done = [], None, 0
        with torch.inference_mode():
            for time in times:
                upto = round(time * fps)
                _, state = model.from_sums(sums[:, done:upto], state)
                table = model.table(state)
                found = [rows[own] > 0 for rows, own in zip(table.rows, table.owners, strict=True)]
                # Outputs of a settled network are a fixed mixture of its inputs: they cannot alternate.
                readings.append(Reading(found, torch.zeros(len(sums), dtype=torch.bool)))
                done = upto
        return readings


class Offline:
    """A method that gets all signals so far at once, scene by scene."""

    online = False

    def separate(self, signals: Tensor) -> Tensor:
        """Mixing of the sources in signals `[T, 10]`: `[sources, 10]`."""
        raise NotImplementedError

    def __call__(self, sums: Tensor, fps: float, times: Sequence[float]) -> list[Reading]:
        refined = Signals(fps)(sums)
        # The low-pass leaves nothing between samples 50 ms apart.
        stride = max(1, round(TAU_SMOOTH * fps))
        none = torch.zeros(len(sums), dtype=torch.bool)
        # Before this the filters still settle.
        start = round(FILTERS_SETTLE * fps)
        return [
            Reading([present(self.separate(s[start : round(time * fps) : stride])) for s in refined], none)
            for time in times
        ]


class Ica(Offline):
    """FastICA with as many components as the covariance has eigenvalues over a share of the largest."""

    def __init__(self, rank_threshold: float = 0.02) -> None:
        self.rank_threshold = rank_threshold

    def separate(self, signals: Tensor) -> Tensor:
        fast_ica = decomposition().FastICA
        centered = (signals - signals.mean(0)).double()
        values = torch.linalg.eigvalsh(centered.mT @ centered)
        if float(values[-1]) < EMPTY * len(centered):
            return torch.zeros(0, 10)
        rank = int((values >= self.rank_threshold * values[-1]).sum())
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            ica = fast_ica(rank, whiten="unit-variance", random_state=0, max_iter=400)
            try:
                ica.fit(centered.numpy())
                mixing = torch.from_numpy(ica.mixing_).float().T
            except ValueError:
                # It does not converge to numbers: the count holds, and the principal components are its mixing.
                vectors = torch.linalg.eigh(centered.mT @ centered)[1]
                mixing = vectors[:, -rank:].mT.float()
        # The sign of a component is free: its largest feature is positive.
        largest = mixing.gather(-1, mixing.abs().argmax(-1, keepdim=True))
        return mixing * largest.sign()


class Greedy(Offline):
    """Owners one by one: the neuron with most power left takes its signal out of all others, until little is left.

    What the competitive rule converges to: with the owners' columns of T at the regression of every signal on the
    owner's, all other outputs are what is left.
    """

    def __init__(self, strength: float = 0.35) -> None:
        self.strength = strength

    def separate(self, signals: Tensor) -> Tensor:
        centered = (signals - signals.mean(0)).double()
        left = centered.mT @ centered / max(1, len(centered))
        first = left.diagonal().amax()
        found: list[Tensor] = []
        while len(found) < len(left):
            k = int(left.diagonal().argmax())
            power = left[k, k]
            if float(first) < EMPTY or float(power) < self.strength**2 * float(first):
                break
            column = left[:, k] / power
            found.append(column.float())
            left = left - torch.outer(column, left[k])
        return torch.stack(found) if found else torch.zeros(0, 10)


class Nmf:
    """Non-negative matrix factorisation of the raw sums, told how many bars there are."""

    online = False

    def __init__(self, counts: Sequence[int]) -> None:
        self.counts = counts

    def __call__(self, sums: Tensor, fps: float, times: Sequence[float]) -> list[Reading]:
        stride = max(1, round(TAU_SMOOTH * fps))
        refine = settled(first_stage()).T
        none = torch.zeros(len(sums), dtype=torch.bool)
        readings = []
        for time in times:
            found = []
            for scene, count in zip(sums[:, : round(time * fps) : stride], self.counts, strict=True):
                columns = self.factors(by_scale(scene), count)
                found.append(present(by_group(columns) @ refine))
            readings.append(Reading(found, none))
        return readings

    @staticmethod
    def factors(signals: Tensor, count: int) -> Tensor:
        """`count` factors `[count, 10]` of signals `[T, 10]`."""
        if count == 0:
            return torch.zeros(0, 10)
        model = decomposition().NMF(count, init="nndsvda", random_state=0, max_iter=400)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            model.fit(signals.clamp_min(0).double().numpy())
        return torch.from_numpy(model.components_).float()


def by_scale(sums: Tensor) -> Tensor:
    """Sums `[T, 10]`, each group over its largest value."""
    return divide(sums, spread_groups(group_max(sums.amax(0))))


def decomposition() -> Any:
    """scikit-learn's decompositions, imported when they are wanted: that takes a second."""
    return need("sklearn.decomposition", "ica and nmf")
