"""C7: which weights solve a mixture, how many there are, and which are stable. [C §5.3]"""

from __future__ import annotations

import itertools
import math
from typing import Any

import torch
from torch import Tensor

from ndtorch.binding import InhibitoryNetwork, separated, solutions, spectral_radius
from ndtorch.binding.theory import count_solutions, largest_free_weight
from ndtorch_train.plots import BLUE, ORANGE, letters, panels
from ndtorch_train.reproduce.context import Context, judged
from ndtorch_train.reproduce.outcome import Outcome
from ndtorch_train.reproduce.two_neurons import DT


def theory(context: Context, largest: int, mixtures: int, seed: int) -> Outcome:
    """Every solution of random mixtures: does it separate, is it counted right, is stability predicted right?"""
    generator = torch.Generator().manual_seed(seed)
    sizes = [(n, m) for n in range(2, largest + 1) for m in range(1, n + 1)]
    rows: list[dict[str, Any]] = []
    for at, (n, m) in enumerate(sizes):
        row: dict[str, Any] = {"neurons": n, "sources": m, "solutions": math.perm(n, m), "paper": count_solutions(n, m)}
        found = stable = separate = 0
        looked_at: list[Tensor] = []
        for _ in range(mixtures):
            mixing = torch.rand(n, m, generator=generator, dtype=torch.float64) * 0.9 + 0.1
            all_of_it = solutions(mixing)
            found += len(all_of_it)
            stable += sum(s.stable for s in all_of_it)
            separate += sum(is_separated(separated(mixing, s.weights)) for s in all_of_it)
            looked_at += [s.weights for s in all_of_it]
        weights = torch.stack(looked_at)
        radius = torch.stack([spectral_radius(w) for w in looked_at])
        clear = (radius - 1).abs() > 0.02  # nearer ones take longer to show what they do
        tried = int(clear.sum())
        agree = int((stays_bounded_all(weights[clear]) == (radius[clear] < 1)).sum())
        row |= {"found": found / mixtures, "stable": stable / mixtures}
        row |= {"all separate": separate == found, "stability right": agree, "of": tried}
        rows.append(row)
        context.report(0.8 * (at + 1) / len(sizes))
    bounds = [bound_error(generator, n) for n in (2, 3, 4) for _ in range(4)]

    figure, axes = panels(1, 2, 12, 4.6)
    names = [f"{r['neurons']},{r['sources']}" for r in rows]
    x = range(len(rows))
    axes[0].bar([k - 0.2 for k in x], [r["found"] for r in rows], 0.4, color=BLUE, label="solutions")
    axes[0].bar([k + 0.2 for k in x], [r["stable"] for r in rows], 0.4, color=ORANGE, label="temporally stable")
    axes[0].set_yscale("symlog", linthresh=1)
    axes[0].set_xticks(list(x), names)
    axes[0].set(title="solutions of a mixture, mean", xlabel="neurons, sources", ylabel="number")
    axes[0].legend(frameon=False)
    grid = torch.linspace(0, 1.5, 31, dtype=torch.float64)
    weights = torch.zeros(31, 31, 2, 2, dtype=torch.float64)
    weights[..., 0, 1], weights[..., 1, 0] = grid[None, :], grid[:, None]
    bounded = stays_bounded_all(weights.reshape(-1, 2, 2)).reshape(31, 31)
    axes[1].pcolormesh(grid, grid, bounded, cmap="Blues", vmin=0, vmax=2, shading="nearest")
    curve = torch.linspace(0.67, 1.5, 100)
    axes[1].plot(curve, 1 / curve, color=ORANGE, lw=2.5, label="T12 T21 = 1")
    axes[1].set(title="blue: outputs stay bounded", xlabel="T12", ylabel="T21", xlim=(0, 1.5), ylim=(0, 1.5))
    axes[1].legend(frameon=False)
    letters(axes)
    caption = "How many weight matrices solve a random mixture, how many are stable, and the limit for two neurons."
    context.draw("C-theory", figure, "C §5.3", caption, mixtures=mixtures, seed=seed)
    agree, tried = sum(r["stability right"] for r in rows), sum(r["of"] for r in rows)
    numbers = {"rows": rows, "bounds, largest relative error": max(bounds)}
    parts = {
        "every solution separates its mixture": all(r["all separate"] for r in rows),
        "N!/(N-m)! solutions of a mixture": all(r["found"] == r["solutions"] for r in rows),
        "stability as predicted": agree == tried,
        "limits on free weights as predicted (1 %)": max(bounds) < 0.01,
    }
    ours = f"all {sum(r['found'] for r in rows) * mixtures:.0f} solve; stability right {agree} of {tried}"
    why = "N!/(N-m)! for one mixture; the square counts also which sources are present. Eq. 34 bounds T21, not T12."
    return judged(context, ours, why, parts, numbers)


def is_separated(gains: Tensor) -> bool:
    """One source in every column, at most one in every row."""
    there = gains.abs() > 1e-9 * gains.abs().max()
    return bool((there.sum(0) == 1).all() and (there.sum(1) <= 1).all())


def stays_bounded_all(weights: Tensor, steps: int = 1500) -> Tensor:
    """Whether the network with fixed weights `[B, N, N]` comes to rest after a push, `[B]`."""
    network = InhibitoryNetwork(weights.shape[-1], DT, None, tau_in=math.inf)
    inputs = torch.zeros(len(weights), steps, weights.shape[-1], dtype=weights.dtype)
    inputs[:, 0] = 1.0
    with torch.inference_mode():
        state = network.start(inputs[:, 0])._replace(weights=weights)
        out, _ = network(inputs, state)
    early, late = out[:, 1 : weights.shape[-1] + 1], out[:, -weights.shape[-1] :]
    bounded: Tensor = (late.abs().amax((-1, -2)) < early.abs().amax((-1, -2))) & torch.isfinite(late).all(-1).all(-1)
    return bounded


def bound_error(generator: torch.Generator, n: int) -> float:
    """How far the radius is from 1 when a free weight takes its predicted limit."""
    weights = torch.rand(n, n, generator=generator, dtype=torch.float64) * (0.8 / n)
    weights.fill_diagonal_(0)
    row, column = next(pair for pair in itertools.permutations(range(n), 2))
    weights[row, column] = largest_free_weight(weights, row, column)
    return abs(float(spectral_radius(weights)) - 1)
