"""Number and features of the sources in the ten sums: AMUSE for the number, SOBI for the features.

The sums before normalisation are a mixture `x(t) = A s(t) + noise` of the brightness s of the objects. White noise has
no covariance with its own past, so the rank of the lagged covariance `M = mean_l E[x(t) x(t - l)^T]` of the three color
sums is the number of colors among the sources (AMUSE; Tong, Soon, Huang and Liu 1990). An eigenvalue w_j of M with
eigenvector v_j counts if it exceeds the error of a covariance of T samples,

    w_j > k (n_j / sqrt(T) + sqrt(n_j w_max / T)) + relative_error^2,    n_j = v_j^T N v_j,

N being the covariance of second differences over 6, which is the noise that a smooth signal leaves.

Sources of one hue, and a fourth one, add no rank. But motion of a single source is `m(t) = a s(t) LP s(t)`, so motion
of as many sources as colors is a linear function of products `c_i LP c_j` of color sums. What these leave of the motion
sums means that there is one source more. Over a lit ground it means nothing: what is darker or lighter moves alike.

Features are those of the mixing A, by joint diagonalisation of lagged covariances (SOBI; Belouchrani, Abed-Meraim,
Cardoso and Moulines 1997).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor, nn

from ndtorch.arguments import has_values
from ndtorch.binding.learning import settled
from ndtorch.binding.normalise import divide, group_max, spread_groups
from ndtorch.binding.objects import ObjectTable
from ndtorch.binding.readout.owners import features_by_group
from ndtorch.config import Constants, constant
from ndtorch.vision.features import GROUPS
from ndtorch.vision.temporal import FilterState, HighPass, LowPass

MOTION, COLOR = GROUPS["motion"], GROUPS["color"]
TAU_DELAY = 0.05
"""Delay filter of the motion detectors, seconds."""
STILL = 2e-5
"""Deviation of the color sums over their mean below which nothing fluctuates."""
QUIET = 0.5
"""Ratio of the seconds, those with the smallest residual of motion, that are looked at: in the others bars meet."""
REGRESSORS = 1e-4
"""Smallest eigenvalue of the covariance of color products that is used, over the largest."""
ERRORS = (0.3, 0.02)
"""Relative errors of orientation and of color sums as linear mixtures, for the subspace of the sources."""
DELAYS = (0.05, 0.1, 0.2, 0.3, 0.45, 0.6, 0.8)
"""Delays of the covariances that are diagonalised, seconds."""
SWEEPS = 12
"""Rounds of rotations of the joint diagonalisation."""
MOST = 4
"""Largest number of sources: three colors and one more."""
CLEAR = 2.0
"""Decades of a margin beyond which more makes no difference."""
WEIGHTS = (-3.88, 4.14, 1.46, 0.95, -1.57, -0.66)
"""Logistic regression of "the number is right" on `evidence`, on the split tune of `ndtorch benchmark over-time`."""


class SourceParams(Constants):
    """Constants of the number of sources."""

    duration: float = constant(10.0, "Seconds of signals in which motion and features are looked at.", gt=0, le=60)
    recent: float = constant(5.0, "Seconds of signals in which colors are counted.", gt=0, le=60)
    tau_high: float = constant(0.7, "High-pass of the sums, seconds.", gt=0)
    lag: float = constant(0.1, "Largest lag of the covariances, seconds.", gt=0, le=1)
    noise: float = constant(3.0, "Factor k of the noise floor.", ge=0)
    relative_error: float = constant(0.01, "Deviation, over the largest of a color, that is no source.", gt=0)
    motion_residual: float = constant(0.0045, "Ratio of motion, for each color, that means one more source.", gt=0)
    lit: float = constant(0.03, "Deviation of the colors over their mean below which the ground is lit.", ge=0)
    tau_votes: float = constant(2.0, "Memory of the numbers of the seconds before, seconds.", gt=0)
    smallest: float = constant(1 / 3, "Ratio to the largest of its group from which on a feature is one.", ge=0)
    certain: float = constant(0.9, "Confidence from which on a number is stable.", ge=0, le=1)


class SourceState(NamedTuple):
    """State of `SourceEstimator`.

    Attributes:
        delay, low: of the color delay and the high-pass.
        history: high-passed sums, delayed colors and products of the latest `duration` seconds, `[..., W, 22]` double.
        votes: leaky sum of the numbers 0 to `MOST` of each second, `[..., MOST + 1]` double.
        margins: leaky mean of the margins of each second, `[..., 4]` double.
        steps: time steps taken, int64 scalar.
    """

    delay: Tensor
    low: Tensor
    history: Tensor
    votes: Tensor
    margins: Tensor
    steps: Tensor


class SourceEstimator(nn.Module):
    """Number, confidence and features of the sources in the ten sums; the number is looked at once a second.

    Args:
        dt: seconds between samples.
        first_stage: weights `[10, 10]`, through which features are read.
        params: constants.

    Shapes:
        sums `[..., T, 10]` -> `SourceState`; None starts settled on the first sample.
    """

    first_stage: Tensor

    def __init__(self, dt: float, first_stage: Tensor, params: SourceParams | None = None) -> None:
        super().__init__()
        p = self.params = params or SourceParams()
        self.dt, self.second = dt, max(1, round(1 / dt))
        self.samples = max(4, round(p.duration / dt))
        self.delay, self.high_pass = LowPass(TAU_DELAY, dt, 1), HighPass(p.tau_high, dt, 1)
        self.register_buffer("first_stage", first_stage)

    def forward(self, sums: Tensor, state: SourceState | None = None) -> SourceState:
        x = sums.detach().double()
        delayed, delay = self.delay.scan(x[..., COLOR], state and FilterState(state.delay))
        products = (x[..., COLOR].unsqueeze(-1) * delayed.unsqueeze(-2)).flatten(-2)
        every = torch.cat([x, delayed, products], -1)
        high, low = self.high_pass.scan(every, state and FilterState(state.low))
        if state is None:
            votes, margins = x.new_zeros(*x.shape[:-2], MOST + 1), x.new_zeros(*x.shape[:-2], 4)
            history, steps = high.new_zeros(*high.shape[:-2], self.samples, 22), torch.zeros((), dtype=torch.int64)
        else:
            _, _, history, votes, margins, steps = state
        known = torch.cat([history, high], -2)
        taken = x.shape[-2]
        after = SourceState(delay.low, low.low, known[..., -self.samples :, :], votes, margins, steps + taken)
        if not has_values(sums):
            return after  # an exported program keeps the signals, and whoever reads its state counts
        start = int(steps)
        for end in range(start // self.second + 1, (start + taken) // self.second + 1):
            upto = self.samples + end * self.second - start
            level = every[..., end * self.second - start - 1, :] - known[..., upto - 1, :]
            number, margin = self.count(known[..., upto - self.samples : upto, :], level, end * self.second)
            keep = math.exp(-1 / self.params.tau_votes)
            votes = keep * votes + nn.functional.one_hot(number, MOST + 1)
            share = 1 - keep if end > 1 else 1.0
            margins = margins + share * (margin - margins)
        return after._replace(votes=votes, margins=margins)

    def count(self, history: Tensor, level: Tensor, steps: int) -> tuple[Tensor, Tensor]:
        """Number of sources `[...]` in signals `[..., W, 22]`, and its margins `[..., 4]`, see `evidence`."""
        p, samples = self.params, min(self.samples, steps)
        history = history[..., -samples:, :]
        recent = history[..., -min(samples, round(p.recent / self.dt)) :, :]
        color = recent[..., COLOR]
        deviation = color.std(-2).amax(-1)
        brightness = level[..., COLOR].mean(-1).clamp_min(1e-12)
        ratios = self.color_ratios(color / deviation.clamp_min(1e-12)[..., None, None])
        fluctuates = deviation > STILL * brightness
        colors = (ratios > 1).sum(-1) * fluctuates
        lit = deviation < p.lit * brightness
        residual = self.motion_residual(history) / (p.motion_residual * colors.clamp_min(1))
        more = (residual > 1) & ~lit & (colors > 0)
        # Decades between the eigenvalues and their floor, and of the residual.
        decades = ratios.clamp_min(1e-9).log10().abs().amin(-1).clamp_max(CLEAR)
        moved = residual.clamp_min(1e-9).log10().abs().clamp_max(CLEAR)
        flags = (more.double(), lit.double())
        return colors + more, torch.stack([decades, torch.where(more | lit, 0.0, moved), *flags], -1)

    def color_ratios(self, color: Tensor) -> Tensor:
        """Eigenvalues of the lagged covariance of colors `[..., T, 3]` over their noise floors, `[..., 3]`."""
        p = self.params
        scaled = color / p.relative_error
        samples = scaled.shape[-2]
        size, vectors = torch.linalg.eigh(self.lagged(scaled, samples).squeeze(-3))
        second = scaled[..., 2:, :] - 2 * scaled[..., 1:-1, :] + scaled[..., :-2, :]
        covariance = second.mT @ second / (6 * max(1, samples - 2))
        noise = (vectors.mT @ covariance @ vectors).diagonal(dim1=-2, dim2=-1).clamp_min(0)
        largest = size[..., -1:].clamp_min(0)
        ratios: Tensor = size / (1 + p.noise * (noise / math.sqrt(samples) + (noise * largest / samples).sqrt()))
        return ratios

    def motion_residual(self, history: Tensor) -> Tensor:
        """Ratio of motion that products of colors do not explain, in the quiet half of the seconds, `[...]`."""
        motion, others = history[..., MOTION], history[..., COLOR.start :]
        motion = motion / motion.std(-2).amax(-1).clamp_min(1e-12)[..., None, None]
        others = others / others.std(-2, keepdim=True).clamp_min(1e-12)
        seconds = self.lagged(torch.cat([motion, others], -1), self.second)
        mean = seconds.mean(-3)
        size, vectors = torch.linalg.eigh(mean[..., 4:, 4:])
        used = size > REGRESSORS * size[..., -1:]
        inverse = vectors * torch.where(used, 1 / size.abs().clamp_min(1e-12), 0.0).unsqueeze(-2) @ vectors.mT
        residue = torch.cat([torch.eye(4).to(mean).expand(*mean.shape[:-2], 4, 4), -mean[..., :4, 4:] @ inverse], -1)
        left = (residue.unsqueeze(-3) @ seconds @ residue.mT.unsqueeze(-3)).diagonal(dim1=-2, dim2=-1).sum(-1)
        given = seconds[..., :4, :4].diagonal(dim1=-2, dim2=-1).sum(-1)
        quiet = left.argsort(-1)[..., : max(1, round(QUIET * left.shape[-1]))]
        return left.gather(-1, quiet).sum(-1) / given.gather(-1, quiet).sum(-1).clamp_min(1e-12)

    def lagged(self, signals: Tensor, block: int) -> Tensor:
        """Covariances with the mean of the past up to `lag`, symmetric, of each block of samples, `[..., B, N, N]`."""
        lag = max(1, min(round(self.params.lag / self.dt), signals.shape[-2] // 2))
        flat = signals.reshape(-1, *signals.shape[-2:])[:, :-1].mT
        past = nn.functional.avg_pool1d(flat, lag, 1).mT.reshape(*signals.shape[:-2], -1, signals.shape[-1])
        now = signals[..., lag:, :]
        count = max(1, now.shape[-2] // block)
        block = min(block, now.shape[-2])
        now, past = (
            part[..., -count * block :, :].reshape(*part.shape[:-2], count, block, part.shape[-1])
            for part in (now, past)
        )
        product = now.mT @ past / block
        symmetric: Tensor = (product + product.mT) / 2
        return symmetric

    def number(self, state: SourceState) -> Tensor:
        """The number of sources with most votes, `[...]` int64."""
        return self.voted(state)[0].argmax(-1)

    def voted(self, state: SourceState) -> tuple[Tensor, Tensor]:
        """Votes and margins, those of this moment where no second is over yet."""
        if bool(state.votes.any()):
            return state.votes, state.margins
        number, margins = self.count(state.history, state.low, max(4, int(state.steps)))
        return nn.functional.one_hot(number, MOST + 1).double(), margins

    def evidence(self, state: SourceState) -> Tensor:
        """What the confidence weighs, `[..., 6]`: 1, the ratio of votes for the number, decades between eigenvalues and
        their floor and between the residual of motion and its own, and means of whether there is a source more than
        colors and whether the ground is lit.
        """
        votes, margins = self.voted(state)
        ratio = votes.amax(-1) / votes.sum(-1)
        return torch.cat([torch.ones_like(ratio).unsqueeze(-1), ratio.unsqueeze(-1), margins], -1)

    def confidence(self, state: SourceState) -> Tensor:
        """Probability that the number is right, `[...]`."""
        evidence = self.evidence(state)
        return torch.sigmoid((evidence * evidence.new_tensor(WEIGHTS)).sum(-1))

    def table(self, state: SourceState) -> ObjectTable:
        """Objects with the features of the sources; each has a neuron of its own, the strongest that is free."""
        numbers = self.number(state).flatten().tolist()
        samples = max(4, min(self.samples, int(state.steps)))
        history = state.history[..., -samples:, :10].reshape(-1, samples, 10)
        owners = torch.zeros(len(numbers), 10, dtype=torch.bool, device=history.device)
        rows = history.new_zeros(len(numbers), 10, 10)
        for trial, (count, signals) in enumerate(zip(numbers, history, strict=True)):
            for row in self.mixing(signals, count) if count else ():
                free = torch.where(owners[trial], -1.0, row)
                k = int(free.argmax())
                owners[trial, k], rows[trial, k] = True, row
        batch = state.votes.shape[:-1]
        return ObjectTable(owners.reshape(*batch, 10), rows.float().reshape(*batch, 10, 10))

    def mixing(self, signals: Tensor, count: int) -> Tensor:
        """Features of so many sources in signals `[T, 10]`, `[count, 10]`, strongest source first."""
        scale = spread_groups(group_max(signals.std(-2)))
        signals = divide(signals, scale.expand_as(signals))
        errors = signals.new_tensor([ERRORS[0]] * 3 + [ERRORS[1]] * 3)
        weighted = signals[:, MOTION.stop :] / errors
        size, vectors = torch.linalg.eigh(self.lagged(weighted, len(signals))[0])
        white = weighted @ (vectors / size.clamp_min(1e-9).sqrt())[:, -count:]
        delays = [max(1, min(round(delay / self.dt), len(white) // 2)) for delay in DELAYS]
        lagged = torch.stack([white[delay:].mT @ white[:-delay] / len(white) for delay in delays])
        sources = white @ diagonalise((lagged + lagged.mT) / 2)
        shared = self.lagged(torch.cat([sources, signals], -1), len(signals))[0, :count, count:]
        # Brightness adds to orientations and colors.
        shared = shared * shared[:, MOTION.stop :].sum(-1, keepdim=True).sign()
        order = shared.square().sum(-1).argsort(descending=True)
        refined = features_by_group(shared[order], 0.0) @ settled(self.first_stage.double()).mT
        return features_by_group(refined, self.params.smallest)


def diagonalise(matrices: Tensor) -> Tensor:
    """The rotation that makes symmetric matrices `[K, N, N]` as diagonal as one rotation can, `[N, N]`.

    Jacobi rotations of each pair by the angle of Cardoso and Souloumiac (1996).
    """
    count = matrices.shape[-1]
    rotation = torch.eye(count, dtype=matrices.dtype, device=matrices.device)
    for _ in range(SWEEPS):
        for p in range(count):
            for q in range(p + 1, count):
                difference = matrices[:, p, p] - matrices[:, q, q]
                both = 2 * matrices[:, p, q]
                on, off = difference @ difference - both @ both, 2 * difference @ both
                angle = 0.5 * torch.atan2(off, on + torch.hypot(on, off))
                turn = torch.eye(count, dtype=matrices.dtype, device=matrices.device)
                turn[p, p] = turn[q, q] = angle.cos()
                turn[q, p], turn[p, q] = angle.sin(), -angle.sin()
                matrices, rotation = turn.mT @ matrices @ turn, rotation @ turn
    return rotation


__all__ = ["SourceEstimator", "SourceParams", "SourceState"]
