"""What others use to separate sources, on the signals that the scale-free rule sees: Picard, SOBI, MM-ICA, EASI.

Picard is the package of that name. SOBI, MM-ICA and EASI are written here from their published equations.
"""

from __future__ import annotations

import warnings
from abc import abstractmethod
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from ndtorch.binding.readout.delays import diagonalise
from ndtorch.optional import need
from ndtorch_train.score.methods import EMPTY, FILTERS_SETTLE, TAU_SMOOTH, Offline, Reading, Signals
from ndtorch_train.score.truth import present

Array = npt.NDArray[np.float64]

RANK_THRESHOLD = 0.02
"""Share of the largest eigenvalue that makes a source: the one that is best for FastICA on the random scenes."""


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
    counts them, and made white; once a second the directions are looked at anew.
    """

    online = True

    @abstractmethod
    def start(self, sources: int) -> None:
        """Begin anew for so many sources."""

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
                readings.append(mixing_of(color, unmixing))
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
            readings.append(mixing_of(color, unmixing))
        return readings


def mixing_of(color: Array, unmixing: Array) -> Array:
    """Mixing `[sources, 10]`."""
    mixing: Array = (color @ np.linalg.pinv(unmixing)).T
    return mixing


class MmIca(OnlineSeparation):
    """Majorisation-minimisation ICA, online (Ablin, Gramfort, Cardoso and Bach 2019), written anew from the paper.

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
