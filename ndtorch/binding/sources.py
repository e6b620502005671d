"""Number and features of the sources in the ten sums: AMUSE for the number, SOBI for the features.

The sums before normalisation are a mixture `x(t) = A s(t) + noise` of the brightness s of the objects. White noise has
no covariance with its own past, so the rank of the lagged covariance `M = mean_l E[x(t) x(t - l)^T]` of the three color
sums is the number of colors among the sources (AMUSE; Tong, Soon, Huang and Liu 1990). An eigenvalue w_j of M with
eigenvector v_j counts if it exceeds the error of a covariance of T samples,

    w_j > k (n_j / sqrt(T) + sqrt(n_j w_max / T)) + relative_error^2,    n_j = v_j^T N v_j,

N being the covariance of second differences over 6, which is the noise that a smooth signal leaves.

Sources of one hue, and a fourth one, add no rank. But motion of a single source is `m(t) = a s(t) LP s(t)`, so motion
of as many sources as colors is a linear function of products `c_i LP c_j` of color sums. What these leave of the motion
sums means one source more; not over a lit ground, where what is darker or lighter moves alike. Two bars in step add no
rank either; but then a single source moves two opposite ways.

Features are those of the mixing A, by joint diagonalisation of lagged covariances (SOBI; Belouchrani, Abed-Meraim,
Cardoso and Moulines 1997). Delays do not separate two sources of one spectrum; the network's weights do.
"""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import torch
from torch import Tensor, nn

from ndtorch.arguments import has_values
from ndtorch.binding.network import settled
from ndtorch.binding.normalise import divide, group_max, spread_groups
from ndtorch.binding.objects import ObjectTable, features_by_group
from ndtorch.config import Constants, constant
from ndtorch.utils.tensors import safe_state
from ndtorch.vision.features import GROUPS
from ndtorch.vision.temporal import FilterState, HighPass, LowPass, smoothing_factor

MOTION, COLOR = GROUPS["motion"], GROUPS["color"]
TAU_DELAY = 0.05  # Delay filter of the motion detectors, seconds.
STILL = 2e-5  # Deviation of the color sums over their mean below which nothing fluctuates.
QUIET = 0.5  # Ratio of the seconds with the smallest residual of motion that is used: in the others bars meet.
REGRESSORS = 1e-4  # Smallest eigenvalue of the covariance of color products that is used, over the largest.
ERRORS = (0.3, 0.02)  # Relative errors of orientation and of color sums as linear mixtures.
DELAYS = (0.05, 0.1, 0.2, 0.3, 0.45, 0.6, 0.8)  # Of the covariances that are diagonalised, seconds.
SWEEPS = 12  # Rounds of rotations of the joint diagonalisation.
ALIKE = 0.003  # Difference of two sources' profiles of covariance below which delays do not separate them.
OPPOSED = 0.65  # Motion of a source against its largest, over that, from which on it is two in step.
NEARLY, EXPLAINED = 0.3, 0.1  # Residual of motion over its limit above which one color, or three, may hide a source.
ABSENT, EXTREME = 0.003, 3.0  # Power of changes in a second, over the mean, of sources that leave or enter.
DOUBTFUL = 4  # Seconds after that in which a number is not certain.
MOST = 4  # Largest number of sources: three colors and one more.
CLEAR = 2.0  # Decades of a margin beyond which more makes no difference.
WEIGHTS = (-3.02, 3.34, 1.55, 4.32, 1.38, -0.69, 1.13)
"""Logistic regression of "the number is right" on `evidence`, on the split tune of `ndtorch benchmark over-time`."""


class SourceParams(Constants):
    """Constants of the number of sources."""

    duration: float = constant(14.0, "Seconds of signals in which motion and features are looked at.", gt=0, le=60)
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


@safe_state
class SourceState(NamedTuple):
    """State of `SourceEstimator`.

    Attributes:
        delay, low: of the color delay and the high-pass.
        history: high-passed sums, delayed colors and products of the latest `duration` seconds, `[..., W, 22]` double.
        votes: leaky sum of the numbers 0 to `MOST` of each second, `[..., MOST + 1]` double.
        margins: leaky mean of the margins of each second; the last, whether it is doubtful, fades. `[..., 5]` double.
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
        self.a_high = smoothing_factor(p.tau_high, dt)
        self.delay, self.high_pass = LowPass(TAU_DELAY, dt, 1), HighPass(p.tau_high, dt, 1)
        self.register_buffer("first_stage", first_stage)

    def forward(self, sums: Tensor, state: SourceState | None = None) -> SourceState:
        x = sums.detach().double()
        delayed, delay = self.delay.scan(x[..., COLOR], state and FilterState(state.delay))
        products = (x[..., COLOR].unsqueeze(-1) * delayed.unsqueeze(-2)).flatten(-2)
        every = torch.cat([x, delayed, products], -1)
        high, low = self.high_pass.scan(every, state and FilterState(state.low))
        if state is None:
            votes, margins = x.new_zeros(*x.shape[:-2], MOST + 1), x.new_zeros(*x.shape[:-2], 5)
            history, steps = high.new_zeros(*high.shape[:-2], self.samples, 22), torch.zeros((), dtype=torch.int64)
        else:
            _, _, history, votes, margins, steps = state
        known, taken = torch.cat([history, high], -2), x.shape[-2]
        after = SourceState(delay.low, low.low, known[..., -self.samples :, :], votes, margins, steps + taken)
        if not has_values(sums):
            return after  # an exported program keeps the signals, and whoever reads its state counts
        votes, margins, start = votes.clone(), margins.clone(), int(steps)
        trials = (known.reshape(-1, *known.shape[-2:]), every.reshape(-1, *every.shape[-2:]))
        for past, x, vote, margin in zip(*trials, votes.view(-1, MOST + 1), margins.view(-1, 5), strict=True):
            for end in range(start // self.second + 1, (start + taken) // self.second + 1):
                upto = self.samples + end * self.second - start
                level = x[upto - self.samples - 1] - past[upto - 1]
                self.vote(past[upto - self.samples : upto], level, end * self.second, vote, margin)
        return after._replace(votes=votes, margins=margins)

    def vote(self, history: Tensor, level: Tensor, steps: int, votes: Tensor, margins: Tensor) -> None:
        """Take the number of sources at this second into the votes and margins of a trial."""
        number, now = self.count(history, level, steps)
        keep = math.exp(-1 / self.params.tau_votes) if steps > self.second else 0.0
        votes *= keep
        votes[number] += 1
        margins[:-1] += (1 - keep) * (now - margins)[:-1]
        margins[-1] = max(float(now[-1]), float(votes.argmax() != number), float(margins[-1]) - 1 / DOUBTFUL)

    def count(self, history: Tensor, level: Tensor, steps: int) -> tuple[int, Tensor]:
        """Number of sources in signals `[W, 22]`, and its margins `[5]`, see `evidence`."""
        p, samples = self.params, min(self.samples, max(4, steps))
        history = history[-samples:]
        recent = history[-min(samples, max(4, round(p.recent / self.dt))) :, COLOR]
        deviation, brightness = recent.std(0).max(), level[COLOR].mean().clamp_min(1e-12)
        ratios = self.color_ratios(recent / deviation.clamp_min(1e-12))
        colors = int((ratios > 1).sum()) if deviation > STILL * brightness else 0
        lit = bool(deviation < p.lit * brightness)
        residual = self.motion_residual(history) / (p.motion_residual * max(1, colors))
        mixing, difference = self.mixing(history[:, :10], max(1, colors))
        ways = mixing[:, MOTION].abs().view(-1, 2, 2)
        opposed = difference > ALIKE and bool((ways.amin(-1).amax(-1) > OPPOSED * ways.amax((-1, -2))).any())
        more = (residual > 1 or (opposed and colors == 1)) and not lit and colors > 0
        alike = opposed if colors == 2 else residual > (NEARLY if colors == 1 else EXPLAINED)
        alike = ((alike and not lit) or (lit and colors == 3)) and not more
        decades = float(ratios.clamp_min(1e-9).log10().abs().min().clamp_max(CLEAR))
        moved = 0.0 if more or lit else min(CLEAR, abs(math.log10(max(residual, 1e-9))))
        return colors + more, level.new_tensor([decades, moved, more, lit, alike or self.changing(recent, colors)])

    def changing(self, color: Tensor, count: int) -> bool:
        """Whether changes of one of so many sources of colors `[T, 3]` were absent or extreme in the latest second."""
        changes = color[1:] / (1 - self.a_high) - color[:-1]  # those before the high-pass
        lag = max(1, min(round(self.params.lag / self.dt), len(changes)))
        changes = nn.functional.avg_pool1d(changes.mT.unsqueeze(0), lag, 1)[0].mT
        size, vectors = torch.linalg.eigh(changes.mT @ changes / len(changes))
        white = changes[-self.second :] @ (vectors / size.clamp_min(1e-14).sqrt())[:, 3 - count :]
        power = torch.linalg.eigvalsh(white.mT @ white / len(white))
        return count > 0 and not ABSENT < float(power[0]) <= float(power[-1]) < EXTREME

    def color_ratios(self, color: Tensor) -> Tensor:
        """Eigenvalues of the lagged covariance of colors `[T, 3]` over their noise floors, `[3]`."""
        scaled, samples = color / self.params.relative_error, len(color)
        size, vectors = torch.linalg.eigh(self.lagged(scaled, samples)[0])
        second = scaled[2:] - 2 * scaled[1:-1] + scaled[:-2]
        noise = (second @ vectors).square().sum(0) / (6 * max(1, samples - 2))
        error = noise / math.sqrt(samples) + (noise * size[-1].clamp_min(0) / samples).sqrt()
        ratios: Tensor = size / (1 + self.params.noise * error)
        return ratios

    def motion_residual(self, history: Tensor) -> float:
        """Ratio of motion that products of colors do not explain, in the quiet half of the seconds."""
        motion, others = history[:, MOTION], history[:, COLOR.start :]
        motion, others = motion / motion.std(0).max().clamp_min(1e-12), others / others.std(0).clamp_min(1e-12)
        seconds = self.lagged(torch.cat([motion, others], -1), self.second)
        mean = seconds.mean(0)
        size, vectors = torch.linalg.eigh(mean[4:, 4:])
        used = size > REGRESSORS * size[-1]
        inverse = vectors * torch.where(used, 1 / size.abs().clamp_min(1e-12), 0.0) @ vectors.mT
        residue = torch.cat([torch.eye(4).to(mean), -mean[:4, 4:] @ inverse], -1)
        left, given = (
            part.diagonal(0, -2, -1).sum(-1) for part in (residue @ seconds @ residue.mT, seconds[:, :4, :4])
        )
        quiet = left.argsort()[: max(1, round(QUIET * len(left)))]
        return float(left[quiet].sum() / given[quiet].sum().clamp_min(1e-12))

    def lagged(self, signals: Tensor, block: int) -> Tensor:
        """Covariances of signals `[T, N]` with the mean of their past up to `lag`, symmetric, of each block of samples,
        `[B, N, N]`."""
        lag = max(1, min(round(self.params.lag / self.dt), len(signals) // 2))
        past, now = nn.functional.avg_pool1d(signals[:-1].mT.unsqueeze(0), lag, 1)[0].mT, signals[lag:]
        block = min(block, len(now))
        used = len(now) // block * block
        now, past = (part[-used:].reshape(-1, block, part.shape[-1]) for part in (now, past))
        product = now.mT @ past / block
        return (product + product.mT) / 2

    def number(self, state: SourceState) -> Tensor:
        """The number of sources with most votes, `[...]` int64."""
        return self.voted(state)[0].argmax(-1)

    def voted(self, state: SourceState) -> tuple[Tensor, Tensor]:
        """Votes and margins, those of this moment where no second is over yet."""
        votes, margins = state.votes.clone(), state.margins.clone()
        if not bool(votes.any()):
            trials = (state.history.reshape(-1, self.samples, 22), state.low.reshape(-1, 22))
            for history, low, vote, margin in zip(*trials, votes.view(-1, MOST + 1), margins.view(-1, 5), strict=True):
                self.vote(history, low, max(4, int(state.steps)), vote, margin)
        return votes, margins

    def evidence(self, state: SourceState) -> Tensor:
        """What the confidence weighs, `[..., 7]`: 1; ratio of votes for the number; decades of eigenvalues over their
        floor and of the residual of motion over its limit, where they count; and whether there is a source more than
        colors, the ground is lit, and the latest seconds were doubtful."""
        votes, margins = self.voted(state)
        decades, moved, more, lit, doubt = margins.unbind(-1)
        sure, one = (doubt <= 0).double(), torch.ones_like(doubt)
        ratio = votes.amax(-1) / votes.sum(-1)
        return torch.stack([one, ratio, decades * (1 - more) * sure, moved * sure, more, lit, 1 - sure], -1)

    def confidence(self, state: SourceState) -> Tensor:
        """Probability that the number is right, `[...]`."""
        evidence = self.evidence(state)
        return torch.sigmoid((evidence * evidence.new_tensor(WEIGHTS)).sum(-1))

    def table(self, state: SourceState, weights: Tensor) -> ObjectTable:
        """Objects with the features of the sources. Each has a neuron of its own: of those of its features, the one
        that inhibits most by `weights` `[..., 10, 10]`. Two sources of one spectrum have the features of these."""
        numbers = self.number(state).flatten().tolist()
        samples = max(4, min(self.samples, int(state.steps)))
        history = state.history[..., -samples:, :10].reshape(-1, samples, 10)
        owners = torch.zeros(len(numbers), 10, dtype=torch.bool, device=history.device)
        rows, inhibition = history.new_zeros(len(numbers), 10, 10), weights.reshape(-1, 10, 10).clamp_min(0).sum(-2)
        for trial, (count, signals) in enumerate(zip(numbers, history, strict=True)):
            mixing, difference = self.mixing(signals, max(1, count))
            mixing = mixing[mixing.square().sum(-1).argsort(descending=True)]
            refined = features_by_group(mixing, 0.0) @ settled(self.first_stage.double()).mT
            if count == 2 and difference < ALIKE:
                # Columns of the neurons that send most inhibition, with themselves.
                columns = weights.reshape(-1, 10, 10)[trial].mT + torch.eye(10).to(weights)
                refined = columns[inhibition[trial].topk(count).indices]
            for row in features_by_group(refined, self.params.smallest)[:count].to(rows):
                k = int(torch.where(owners[trial], -1.0, row * (inhibition[trial] + 1e-3)).argmax())
                owners[trial, k], rows[trial, k] = True, row
        batch = state.votes.shape[:-1]
        return ObjectTable(owners.reshape(*batch, 10), rows.float().reshape(*batch, 10, 10))

    def mixing(self, signals: Tensor, count: int) -> tuple[Tensor, float]:
        """Mixing `[count, 10]` of sources in signals `[T, 10]`, and smallest difference, 0 to 1, of two sources'
        covariances with their past."""
        scale = spread_groups(group_max(signals.std(-2)))
        signals = divide(signals, scale.expand_as(signals))
        weighted = signals[:, MOTION.stop :] / signals.new_tensor(ERRORS).repeat_interleave(3)
        size, vectors = torch.linalg.eigh(self.lagged(weighted, len(signals))[0])
        white = weighted @ (vectors / size.clamp_min(1e-9).sqrt())[:, -count:]
        delays = [max(1, min(round(delay / self.dt), len(white) // 2)) for delay in DELAYS]
        lagged = torch.stack([white[delay:].mT @ white[:-delay] / len(white) for delay in delays])
        rotation = diagonalise((lagged + lagged.mT) / 2)
        sources = white @ rotation
        profiles = nn.functional.normalize((rotation.mT @ lagged @ rotation).diagonal(dim1=-2, dim2=-1), dim=0)
        difference = float(1 - (profiles.mT @ profiles).fill_diagonal_(0).max())
        shared = self.lagged(torch.cat([sources, signals], -1), len(signals))[0, :count, count:]
        # Brightness adds to orientations and colors.
        return shared * shared[:, MOTION.stop :].sum(-1, keepdim=True).sign(), difference


def diagonalise(matrices: Tensor) -> Tensor:
    """The rotation `[N, N]` that makes symmetric matrices `[K, N, N]` as diagonal as one can: Jacobi rotations of each
    pair by the angle of Cardoso and Souloumiac (1996)."""
    eye = torch.eye(matrices.shape[-1]).to(matrices)
    rotation = eye
    for p, q in SWEEPS * list(itertools.combinations(range(len(eye)), 2)):
        difference, both = matrices[:, p, p] - matrices[:, q, q], 2 * matrices[:, p, q]
        on, off = difference @ difference - both @ both, 2 * difference @ both
        angle = 0.5 * torch.atan2(off, on + torch.hypot(on, off))
        turn = eye.clone()
        turn[p, p] = turn[q, q] = angle.cos()
        turn[q, p], turn[p, q] = angle.sin(), -angle.sin()
        matrices, rotation = turn.mT @ matrices @ turn, rotation @ turn
    return rotation
