"""Methods that find objects in ten sums: our models, and offline and online separation of the same signals.

Picard is the package of that name. SOBI, MM-ICA and EASI are written here from their published equations.
"""

from __future__ import annotations

import warnings
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

import ndtorch
from ndtorch.binding import BindingInputs, PublishedModel, alternation, object_table
from ndtorch.binding.learning import settled
from ndtorch.binding.models.base import Nested
from ndtorch.binding.models.whole_field import BindingState, WholeFieldModel
from ndtorch.binding.normalise import divide, group_max, spread_groups
from ndtorch.binding.readout.joint_diagonalisation import diagonalise
from ndtorch.utils.packages import need
from ndtorch.vision import LowPass
from ndtorch_train.benchmark.bar_scenes import by_group, first_stage, present

Array = npt.NDArray[np.float64]

RANK_THRESHOLD = 0.02
"""Ratio to the largest eigenvalue that makes a source: the one that is best for FastICA on the random scenes."""
TAU_SMOOTH = 0.05
"""Low-pass on the sums, seconds."""
FILTERS_SETTLE = 1.0
EMPTY = 1e-9
"""Power under which there is nothing to separate."""


@dataclass(frozen=True)
class Reading:
    """What a method finds in many scenes at one moment.

    Attributes:
        found: features of the objects of every scene, `[objects, 10]` bool each.
        alternating: scenes whose outputs flip sign from step to step, `[B]` bool.
        confidence: that the number is right, of every scene; None of methods that do not say.
    """

    found: list[Tensor]
    alternating: Tensor
    confidence: Nested = None


class Method(Protocol):
    """Takes sums `[B, T, 10]` at `fps` and gives the objects at `times`, seconds from the first frame."""

    online: bool

    def __call__(self, sums: Tensor, fps: float, times: Sequence[float]) -> list[Reading]:
        """One reading for each of `times`, which ascend."""
        ...


class Online:
    """A model over the whole field that learns from the sums.

    Args:
        name: of the model; options: constants of it.
    """

    online = True

    def __init__(self, name: str, **options: Any) -> None:
        self.name, self.options = name, options

    def __call__(self, sums: Tensor, fps: float, times: Sequence[float]) -> list[Reading]:
        model = ndtorch.load(self.name, fps=fps, **self.options)
        assert isinstance(model, WholeFieldModel)
        readings, state, done = [], None, 0
        with torch.inference_mode():
            for time in times:
                upto = round(time * fps)
                _, state = model.from_sums(sums[:, done:upto], state)
                readings.append(self.read(model, state))
                done = upto
        return readings

    @staticmethod
    def read(model: WholeFieldModel, state: BindingState) -> Reading:
        """The objects of the model's table; of the published one whatever its verdict on the weights would be."""
        alternating = torch.zeros(len(state.second.weights), dtype=torch.bool)
        if isinstance(model, PublishedModel):
            table = object_table(state.second.weights)
            alternating = ~(alternation(state.second) <= model.config.readout.alternating)
        else:
            # Outputs of a settled network are a fixed mixture of its inputs: they cannot alternate.
            table = model.table(state)
        found = [rows[own] > 0 for rows, own in zip(table.rows, table.owners, strict=True)]
        return Reading(found, alternating, model.confidence(state))


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

    def separate(self, signals: Tensor) -> Tensor:
        fast_ica = need("sklearn.decomposition", "ica").FastICA
        centered = (signals - signals.mean(0)).double()
        values = torch.linalg.eigvalsh(centered.mT @ centered)
        if float(values[-1]) < EMPTY * len(centered):
            return torch.zeros(0, 10)
        rank = int((values >= RANK_THRESHOLD * values[-1]).sum())
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
        return upright(mixing)


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
    """Non-negative matrix factorisation of the raw sums, with the number of bars given."""

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
        model = need("sklearn.decomposition", "nmf").NMF(count, init="nndsvda", random_state=0, max_iter=400)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            model.fit(signals.clamp_min(0).double().numpy())
        return torch.from_numpy(model.components_).float()


def by_scale(sums: Tensor) -> Tensor:
    """Sums `[T, 10]`, each group over its largest value."""
    return divide(sums, spread_groups(group_max(sums.amax(0))))


def upright(mixing: Tensor) -> Tensor:
    """Mixing `[sources, 10]` with every source's largest entry positive: the sign of a source is free."""
    return mixing * mixing.gather(-1, mixing.abs().argmax(-1, keepdim=True)).sign()


def subspace(covariance: Tensor, samples: int) -> tuple[Tensor, Tensor]:
    """Deviations `[m]` and directions `[10, m]` of the sources, from the sums of squares of `samples` samples."""
    values, vectors = torch.linalg.eigh(covariance)
    if float(values[-1]) < EMPTY * samples:
        return values[:0], vectors[:, :0]
    take = values >= RANK_THRESHOLD * values[-1]
    return (values[take] / samples).sqrt(), vectors[:, take]


class Picard(Offline):
    """Preconditioned ICA for real data (Ablin, Cardoso and Gramfort 2018), with the count of FastICA."""

    def separate(self, signals: Tensor) -> Tensor:
        picard = need("picard", "the method picard").picard
        centered = (signals - signals.mean(0)).double()
        size, basis = subspace(centered.mT @ centered, len(centered))
        if len(size) < 2:
            return upright((basis * size).mT.float())
        white = (centered @ basis) / size
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            _, unmixing, _ = picard(white.mT.numpy(), ortho=False, extended=True, whiten=False, random_state=0)
        mixing = (basis * size) @ torch.linalg.inv(torch.from_numpy(unmixing))
        return upright(mixing.mT.float())


class Sobi(Offline):
    """Second-order blind identification (Belouchrani et al. 1997), with covariances at 1 to 20 samples."""

    def separate(self, signals: Tensor) -> Tensor:
        centered = (signals - signals.mean(0)).double()
        size, basis = subspace(centered.mT @ centered, len(centered))
        if len(size) < 2:
            return upright((basis * size).mT.float())
        white = (centered @ basis) / size
        lagged = []
        for lag in range(1, min(20, len(white) // 2) + 1):
            product = white[lag:].mT @ white[:-lag] / (len(white) - lag)
            lagged.append((product + product.mT) / 2)
        rotation, _ = diagonalise(torch.stack(lagged).unsqueeze(0), sweeps=50)
        return upright(((basis * size) @ rotation[0]).mT.float())


class OnlineSeparation:
    """A separation that takes one sample after the other; scene by scene.

    The signals of a scene are projected on the directions of their running covariance that hold sources, as FastICA
    counts them, and made white; once a second the directions are computed again.
    """

    online = True

    @abstractmethod
    def start(self, sources: int) -> None:
        """Start again for that number of sources."""

    @abstractmethod
    def learn(self, sample: Array, unmixing: Array) -> Array:
        """The unmixing `[m, m]` after one more white sample `[m]`."""

    def __call__(self, sums: Tensor, fps: float, times: Sequence[float]) -> list[Reading]:
        refined, stride = Signals(fps)(sums), max(1, round(TAU_SMOOTH * fps))
        start, none = round(FILTERS_SETTLE * fps), torch.zeros(len(sums), dtype=torch.bool)
        asked = [round(time * fps) for time in times]
        found: list[list[Tensor]] = [[] for _ in times]
        for scene in refined.double().numpy():
            for into, mixing in zip(found, self.follow(scene, start, stride, asked), strict=True):
                into.append(present(upright(torch.from_numpy(mixing).float())))
        return [Reading(one, none) for one in found]

    def follow(self, signals: Array, start: int, stride: int, asked: Sequence[int]) -> list[Array]:
        """Mixing `[sources, 10]` after every asked number of samples of signals `[T, 10]`."""
        total, mean = np.zeros((10, 10)), np.zeros(10)
        whiten, color, unmixing = np.zeros((0, 10)), np.zeros((10, 0)), np.zeros((0, 0))
        again = max(1, round(1.0 / TAU_SMOOTH))
        readings: list[Array] = []
        for taken, at in enumerate(range(start, len(signals), stride), 1):
            while len(readings) < len(asked) and at >= asked[len(readings)]:
                readings.append((color @ np.linalg.pinv(unmixing)).T)
            mean += (signals[at] - mean) / taken
            high = signals[at] - mean
            total += np.outer(high, high)
            if taken % again == 0:
                size, basis = (part.numpy() for part in subspace(torch.from_numpy(total), taken))
                old = color
                whiten, color = (basis / size).T, basis * size
                if len(size) == len(unmixing):
                    # The same sources in the new coordinates.
                    unmixing = unmixing @ np.linalg.pinv(old) @ color
                else:
                    unmixing = np.eye(len(size))
                    self.start(len(size))
            if len(unmixing):
                unmixing = self.learn(whiten @ high, unmixing)
        while len(readings) < len(asked):
            readings.append((color @ np.linalg.pinv(unmixing)).T)
        return readings


class MmIca(OnlineSeparation):
    """Majorisation-minimisation ICA, online (Ablin, Gramfort, Cardoso and Bach 2019), written from the paper.

    For every source i, `A_i` is a running mean of `u(y_i) x x^T`, u(y) = G'(y) / y, with G Huber's function for
    super-Gaussian sources. Row i of the unmixing then becomes `(W A_i W^T)^-1 e_i`, normalised, times W.
    """

    forget = 0.7
    """The n-th sample has the weight `n^-forget`."""

    def start(self, sources: int) -> None:
        self.seen, self.means = 0, np.repeat(np.eye(sources)[None], sources, 0)

    def learn(self, sample: Array, unmixing: Array) -> Array:
        self.seen += 1
        share = max(self.seen, 20) ** -self.forget
        sources = unmixing @ sample
        weight = 1 / np.maximum(np.abs(sources), 1.0)
        self.means += share * (weight[:, None, None] * np.outer(sample, sample) - self.means)
        for i in range(len(unmixing)):
            inner = unmixing @ self.means[i] @ unmixing.T
            row = np.linalg.solve(inner + 1e-9 * np.eye(len(inner)), np.eye(len(inner))[i])
            unmixing[i] = row @ unmixing / np.sqrt(max(row[i], 1e-12))
        return unmixing


class Easi(OnlineSeparation):
    """Equivariant separation by independence (Cardoso and Laheld 1996), in its normalised form."""

    rate = 0.02

    def start(self, sources: int) -> None:
        pass

    def learn(self, sample: Array, unmixing: Array) -> Array:
        y = unmixing @ sample
        # Fluctuations of bars are flatter than Gaussian: a cube.
        g = y**3
        white = (np.outer(y, y) - np.eye(len(y))) / (1 + self.rate * (y @ y))
        turn = (np.outer(g, y) - np.outer(y, g)) / (1 + self.rate * np.abs(y @ g))
        return unmixing - self.rate * (white + turn) @ unmixing


METHODS: Mapping[str, Callable[[Sequence[Tensor]], Method]] = {
    "published": lambda truth: Online("published", rule="competitive"),
    "cooperative": lambda truth: Online("published", rule="cooperative"),
    "hebbian": lambda truth: Online("published", rule="hebbian"),
    "scale-free, owners": lambda truth: Online("scale-free", readout="owners"),
    "scale-free": lambda truth: Online("scale-free", readout="sums"),
    "greedy": lambda truth: Greedy(),
    "ica": lambda truth: Ica(),
    "nmf": lambda truth: Nmf([len(features) for features in truth]),
    "picard": lambda truth: Picard(),
    "sobi": lambda truth: Sobi(),
    "mm-ica": lambda truth: MmIca(),
    "easi": lambda truth: Easi(),
}
"""Every method by its name, made with the true features of the scenes; only nmf uses them, for the number."""
