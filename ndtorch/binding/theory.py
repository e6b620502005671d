"""The theory of the network as blind source separation: which weights solve a mixture, and which are stable.

Inputs are a mixture `i = M s`; the weights W solve it where every output of `o = (I + W)^-1 i` is a scaled copy of
one source, or silent. [C §5.3, §5.5.1]
"""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import torch
from torch import Tensor

from ndtorch.arguments import check_dense, check_tensor
from ndtorch.binding.rules import Rule
from ndtorch.binding.spectrum import check_square, spectral_radius
from ndtorch.errors import InputError


class Solution(NamedTuple):
    """Weights that separate a mixture.

    Attributes:
        owners: `owners[j]` is the neuron whose output becomes source j.
        weights: `[N, N]`; columns of neurons that own no source are free, and zero here.
        stable: whether the network with these weights is temporally stable (spectral radius below 1).
    """

    owners: tuple[int, ...]
    weights: Tensor
    stable: bool


MOST_SOLUTIONS = 10**6
"""Sets of owners that are tried."""


def solutions(mixing: Tensor) -> list[Solution]:
    """All weights that separate the mixture `mixing`, `[N, m]` with m <= N sources. [C eq. 21, 24, 27-30]

    Give every source an owner; the owner k of source j then needs `W[n, k] = M[n, j] / M[k, j]`, which leaves
    one copy of the source, in its owner. Owners that do not receive their source at all solve nothing and are
    left out. There are at most N! / (N - m)! solutions.

    Raises:
        InputError: not a matrix, more sources than neurons, a source that reaches no neuron, or columns that are
            not independent, which nothing can separate.
    """
    check_dense("mixing", mixing)
    mixing = mixing if mixing.is_floating_point() else mixing.double()
    check_tensor("mixing", mixing, half=False)
    if mixing.ndim != 2 or mixing.shape[1] > mixing.shape[0]:
        raise InputError(f"mixing must be [N, m] with m <= N sources, got {tuple(mixing.shape)}")
    neurons, sources = mixing.shape
    if (mixing == 0).all(0).any():
        raise InputError("mixing has a source that reaches no neuron (a column of zeros): leave it out")
    if int(torch.linalg.matrix_rank(mixing)) < sources:
        raise InputError("mixing has sources that reach the neurons in the same proportions: nothing separates them")
    if math.perm(neurons, sources) > MOST_SOLUTIONS:
        raise InputError(f"mixing has {math.perm(neurons, sources):.3g} sets of owners; {MOST_SOLUTIONS} are the most")
    found = []
    for owners in itertools.permutations(range(neurons), sources):
        own = mixing[list(owners), range(sources)]
        if (own == 0).any():
            continue
        weights = torch.zeros(neurons, neurons, dtype=mixing.dtype)
        weights[:, list(owners)] = mixing / own
        weights.fill_diagonal_(0)
        found.append(Solution(owners, weights, bool(spectral_radius(weights) < 1)))
    return found


def count_solutions(neurons: int, sources: int) -> int:
    """Number of solutions the paper counts: N! for m = N, else (N! / (N - m)!)^2. [C §5.3.1-5.3.2]

    The square counts, besides the owners of the sources, which of N possible sources are the m present ones
    and in which order; for one given mixture there are N! / (N - m)! (see `solutions`).
    """
    if not 1 <= sources <= neurons:
        raise InputError(f"sources must be between 1 and the {neurons} neurons, got {sources}")
    arrangements = math.perm(neurons, sources)
    return arrangements if sources == neurons else arrangements**2


def mean_update(rule: Rule, outputs: Tensor) -> Tensor:
    """Mean change of each weight that a rule makes of fluctuations o' of outputs, `E[a(o'_n) b(o'_k)]`. [C eq. 37-40]

    Weights are a stable state of the learning rule where it is zero. For independent sources it is the product of
    `E[a(s'_n)]` and `E[b(s'_k)]`, which is zero where one of the two has no `skewness` [C §5.3.4].

    Args:
        outputs: high-passed, `[T, N]`.

    Returns:
        `[N, N]`, zero on the diagonal, in units of the learning rate.
    """
    power = outputs.square().sum(0)
    change = rule.change(outputs, power, outputs.new_zeros(outputs.shape[-1], outputs.shape[-1]), len(outputs))
    return change - torch.diag(change.diagonal())


def skewness(x: Tensor) -> Tensor:
    """Third moment of signals `[T, N]` about zero over the cube of their root mean square, `[N]`. [C §5.3.4]

    >>> skewness(torch.tensor([[-1.0], [-1.0], [2.0]])).round(decimals=3)
    tensor([0.7070])
    """
    return x.pow(3).mean(0) / x.square().mean(0).pow(1.5)


def largest_free_weight(weights: Tensor, row: int, column: int) -> float:
    """How large `weights[row, column]` may become before the network is temporally unstable. [C eq. 33-36]

    For non-negative weights the radius reaches 1 where `det(I - W) = 0`. With the weight in question set to
    zero that gives `1 / ((I - W)^-1)[column, row]`: for two neurons, one over the other weight. (In print, eq. 34
    bounds T[1,2] where the free weight is T[2,1].) Infinite where the weight closes no loop, zero where the
    network is unstable without it.

    Args:
        weights: `[N, N]`, non-negative.
    """
    rest = weights.double().clone()
    rest[row, column] = 0
    if float(spectral_radius(rest)) >= 1:
        return 0.0
    gain = float(torch.linalg.inv(torch.eye(len(rest), dtype=rest.dtype) - rest)[column, row])
    # Rounding leaves 1e-17 where there is no way from the one to the other.
    return 1 / gain if gain > 1e-12 else math.inf


def mixing_from_weights(weights: Tensor, owners: Tensor) -> Tensor:
    """Mixing coefficients of the objects, each column up to scale: the owners' columns of `I + W`. [C eq. 58]

    Args:
        weights: `[N, N]`; owners: bool `[N]`, as `object_table` gives them.

    Returns:
        `[N, m]`, one column an object, 1 at its owner.
    """
    return (weights + torch.eye(weights.shape[-1], dtype=weights.dtype, device=weights.device))[:, owners]


def separated(mixing: Tensor, weights: Tensor) -> Tensor:
    """Gain from every source to every output, `(I + W)^-1 M`, `[N, m]`. [C eq. 56]

    W solves the mixture where each row has at most one entry that is not zero, and each column exactly one.

    Raises:
        InputError: matrices of another shape or type, or that hold NaN or infinite values.

    >>> separated(torch.tensor([[1.0, 0.5], [0.0, 1.0]]), torch.tensor([[0.0, 0.5], [0.0, 0.0]]))
    tensor([[1., 0.],
            [0., 1.]])
    """
    check_square("weights", weights)
    check_tensor("mixing", mixing, half=False)
    if mixing.ndim < 2 or mixing.shape[-2] != weights.shape[-1]:
        raise InputError(f"mixing must be [N, m] with N = {weights.shape[-1]}, got {tuple(mixing.shape)}")
    eye = torch.eye(weights.shape[-1], dtype=weights.dtype, device=weights.device)
    gains: Tensor = torch.linalg.solve(eye + weights, mixing)
    return gains
