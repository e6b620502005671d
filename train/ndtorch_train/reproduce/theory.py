"""C4 to C7: two neurons that learn from mixed sinusoids [C §5.4]; solutions of a mixture, and stable ones [C §5.3]."""

from __future__ import annotations

import itertools
import math
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ndtorch.binding import InhibitoryNetwork, learning_rule, separated, solutions, spectral_radius
from ndtorch.binding.theory import count_solutions, largest_free_weight
from ndtorch_train.plots import BLACK, BLUE, GREEN, ORANGE, panels
from ndtorch_train.reproduce.experiment import Context, Outcome, judged

DT = 0.001
ONE = ((0.0, 0.7), (0.0, 0.6))
"""Mixing matrix of one source. [C eq. 44]"""
TWO = ((0.6, 0.7), (0.7, 0.6))
"""Mixing matrix of two sources. [C eq. 51]"""
LIMITS = (0.7 / 0.6, 0.6 / 0.7)
"""Largest T[1,2] and T[2,1] of a stable solution of one source. [C eq. 47-48]"""
EVERY = 20
"""Steps between kept weights."""


class Learned(NamedTuple):
    """Outputs `[T, 2]` of the first trial; weights `[samples, B, 2, 2]` and their times."""

    outputs: Tensor
    times: Tensor
    weights: Tensor


def mixed(mixing: Any, seconds: float, dtype: torch.dtype = torch.float64) -> Tensor:
    """Mixture of sinusoids of 2 Hz and 1 Hz, `[T, 2]`. [C eq. 42-43]"""
    t = torch.arange(round(seconds / DT), dtype=torch.float64) * DT
    sources = torch.stack([torch.sin(2 * math.pi * 2 * t), torch.sin(2 * math.pi * t)], -1)
    return (sources @ torch.tensor(mixing, dtype=torch.float64).T).to(dtype)


def learn(rule: str, inputs: Tensor, start: Tensor, onset: float) -> Learned:
    """Learn from the same inputs `[T, 2]` with each of the starting weights `[B, 2, 2]`."""
    network = InhibitoryNetwork(
        2,
        DT,
        learning_rule(rule, gamma=5.0, tau_onset=onset, radius_limit=math.inf),
        tau_in=math.inf,
        tau_out=2.0,
        settle=0.0,
    )
    outputs, weights = [], []
    with torch.inference_mode():
        state = network.start(inputs[0].expand(len(start), 2))._replace(weights=start.to(inputs.dtype))
        for part in torch.split(inputs, EVERY):
            out, state = network(part.expand(len(start), -1, -1), state)
            outputs.append(out[0])
            weights.append(state.weights)
    times = torch.arange(1, len(weights) + 1) * (EVERY * DT)
    return Learned(torch.cat(outputs), times, torch.stack(weights))


def outputs_panel(axes: Any, outputs: Tensor, title: str, until: float) -> None:
    """Both outputs over time."""
    t = torch.arange(len(outputs)) * DT
    shown = t <= until
    step = max(1, int(shown.sum()) // 6000)
    for k, (color, name) in enumerate(((BLUE, "o1"), (ORANGE, "o2"))):
        axes.plot(t[shown][::step], outputs[shown][::step, k], color=color, lw=0.8, label=name)
    axes.set(title=title, xlabel="time (s)", ylabel="output", xlim=(0, until))
    axes.legend(loc="upper right", ncols=2, framealpha=0.9, fontsize=8)


def plane(axes: Any, learned: Learned, title: str) -> None:
    """Trajectory of the two weights, with the theoretical limits."""
    w = learned.weights[:, 0]
    axes.axvline(LIMITS[0], color=GREEN, lw=1.5, ls="--")
    axes.axhline(LIMITS[1], color=GREEN, lw=1.5, ls="--", label=f"limits {LIMITS[0]:.2f}, {LIMITS[1]:.2f}")
    axes.plot(w[:, 0, 1], w[:, 1, 0], color=BLACK, lw=1)
    axes.plot(w[-1, 0, 1], w[-1, 1, 0], "o", mfc="none", mec=ORANGE, mew=2, ms=11, label="end")
    x = torch.linspace(0.8, 1.35, 50)
    axes.plot(x, 1 / x, color="0.6", lw=1, label="T12 T21 = 1")
    axes.set(title=title, xlabel="T12 (from neuron 2 to 1)", ylabel="T21 (from neuron 1 to 2)")
    axes.set(xlim=(-0.03, 1.35), ylim=(-0.03, 1.1))
    axes.legend(frameon=False, fontsize=8, loc="center")


def competitive_one(context: Context, seconds: float) -> Outcome:
    """One source, competitive rule."""
    learned = learn("competitive", mixed(ONE, seconds), torch.zeros(1, 2, 2), 2.0)
    figure, axes = panels(1, 2, 12, 4.6)
    plane(axes[0], learned, "weights, competitive rule")
    outputs_panel(axes[1], learned.outputs, "outputs, competitive rule", seconds)
    caption = "Two neurons, one source, competitive rule: weights against each other and outputs."
    context.draw("C7-competitive", figure, "C fig. 7e, f", caption, first="e", gamma=5, mixing=ONE, seconds=seconds)
    at = {s: learned.weights[int((learned.times <= s).sum()) - 1, 0] for s in (5.0, seconds)}
    w = at[5.0]
    numbers: dict[str, Any] = {f"T at {s:g} s": v for s, v in at.items()}
    radius = float((learned.weights[:, 0, 0, 1] * learned.weights[:, 0, 1, 0]).sqrt().max())
    numbers["largest spectral radius"] = radius
    end = at[seconds]
    last = learned.outputs[-1000:].abs().amax(0)
    numbers["outputs at the end"] = last
    parts = {
        "T12 .20 within .02 at 5 s": abs(float(w[0, 1]) - 0.20) <= 0.02,
        "T21 .86 within .02 at 5 s": abs(float(w[1, 0]) - 0.86) <= 0.02,
        "never unstable": radius < 1,
    }
    ours = f"[[0, {float(w[0, 1]):.3f}], [{float(w[1, 0]):.3f}, 0]] at 5 s"
    then = f"[[0, {float(end[0, 1]):.3f}], [{float(end[1, 0]):.3f}, 0]]"
    why = f"{then} at {seconds:g} s; o2 falls to {float(last[1]):.3f}."
    return judged(context, ours, why, parts, numbers)


def unstable_times(learned: Learned, trial: int = 0) -> list[float]:
    """When the spectral radius rose beyond 1, each time."""
    radius = (learned.weights[:, trial, 0, 1] * learned.weights[:, trial, 1, 0]).sqrt()
    beyond = radius > 1
    rises = beyond & ~torch.cat([torch.zeros(1, dtype=torch.bool), beyond[:-1]])
    times, last = list[float](), None
    for t in learned.times[rises].tolist():
        # A crisis swings beyond 1 more than once, a second or so apart.
        if last is None or t - last > 5.0:
            times.append(round(t, 2))
        last = t
    return times


def cooperative_one(context: Context, seconds: float, trials: int) -> Outcome:
    """One source, cooperative rule, with and without the soft start; and from starts that differ by 1e-12."""
    start = torch.zeros(trials, 2, 2, dtype=torch.float64)
    start[:, 0, 1] = 1e-12 * torch.arange(trials)
    soft = learn("cooperative", mixed(ONE, seconds), start, 2.0)
    learned = learn("cooperative", mixed(ONE, seconds), start, 0.0)

    figure, axes = panels(2, 2, 13, 8)
    until = min(60.0, seconds)
    outputs_panel(axes[0], learned.outputs, "outputs, cooperative rule, no soft start", until)
    axes[0].set_ylim(-2.5, 2.5)
    w = learned.weights[:, 0]
    axes[1].plot(learned.times, w[:, 0, 1], color=BLUE, lw=1.5, label="T12")
    axes[1].plot(learned.times, w[:, 1, 0], color=ORANGE, lw=1.5, ls="--", label="T21")
    axes[1].set(title="weights", xlabel="time (s)", ylabel="weight", xlim=(0, until), ylim=(0, None))
    axes[1].legend(frameon=False)
    root = (w[:, 0, 1] * w[:, 1, 0]).sqrt()
    for sign, style in ((1, "-"), (-1, "--")):
        axes[2].plot(learned.times, sign * root, style, color=BLUE, lw=1.5)
        axes[2].axhline(sign, color="0.5", ls=":")
    axes[2].set(title="eigenvalues of T (dotted: 1)", xlabel="time (s)", ylabel="eigenvalue", xlim=(0, until))
    plane(axes[3], learned, f"weights over {seconds:g} s, cooperative rule")
    caption = "Two neurons, one source, cooperative rule. Green: theoretical limits on the two weights."
    context.draw("C7-cooperative", figure, "C fig. 7a-d", caption, gamma=5, mixing=ONE, seconds=seconds)

    def ends(found: Learned) -> dict[str, int]:
        last = found.weights[-1]
        first = (last[:, 1, 0] - LIMITS[1]).abs() < 0.03
        second = (last[:, 0, 1] - LIMITS[0]).abs() < 0.03
        return {
            "T21 = .86": int(first.sum()),
            "T12 = 1.17": int(second.sum()),
            "neither": int((~first & ~second).sum()),
        }

    figure, (one,) = panels(1, 1, 7.5, 4.5)
    for found, mark, color, name in ((learned, "o", BLUE, "without soft start"), (soft, "x", ORANGE, "with it")):
        last = found.weights[-1]
        one.plot(last[:, 0, 1], last[:, 1, 0], mark, mfc="none", color=color, mew=1.8, label=name)
    one.axvline(LIMITS[0], color=GREEN, ls="--", lw=1)
    one.axhline(LIMITS[1], color=GREEN, ls="--", lw=1)
    one.set(title=f"weights after {seconds:g} s from starts that differ by 1e-12", xlabel="T12", ylabel="T21")
    one.legend(frameon=False)
    caption = f"Where the cooperative rule ends: {trials} starts that differ by 1e-12, with and without the soft start."
    context.draw("C7-rounding", figure, "after C fig. 7d", caption, trials=trials, seconds=seconds)

    times, softly = unstable_times(learned), unstable_times(soft)
    counts, counts_soft = ends(learned), ends(soft)
    numbers = {
        "unstable at, without soft start": times,
        "unstable at, with it": softly,
        "ends, without soft start": counts,
        "ends, with it": counts_soft,
        "T at the end": learned.weights[-1],
        "T at the end, soft start": soft.weights[-1],
    }

    def near(found: list[float]) -> bool:
        printed = (9.0, 25.0, 45.0)
        return len(found) == 3 and all(abs(t - p) <= 0.1 * p for t, p in zip(found, printed, strict=True))

    parts = {
        "unstable at about 9, 25, 45 s (within 10 %) without soft start": near(times),
        "and with the soft start of eq. 4": near(softly),
        "ends at T21 = .86 whatever the rounding": counts["T21 = .86"] == trials,
    }
    words = ", ".join(f"{t:.1f}" for t in times)
    ours = f"unstable at {words} s; T21 = .86 in {counts['T21 = .86']} of {trials}"
    why = (
        f"Starts that differ by 1e-12 part at the third instability: {counts}. With the soft start: unstable at "
        f"{', '.join(f'{t:.1f}' for t in softly)} s only, {counts_soft}."
    )
    return judged(context, ours, why, parts, numbers)


def two_sources(context: Context, seconds: float) -> Outcome:
    """Two sources, both rules."""
    both = {}
    zero = torch.zeros(1, 2, 2)
    for rule in ("cooperative", "competitive"):
        both[rule] = learn(rule, mixed(TWO, seconds), zero, 2.0)
    figure, axes = panels(2, 2, 13, 7.5)
    for k, (rule, learned) in enumerate(both.items()):
        outputs_panel(axes[2 * k], learned.outputs, f"outputs, {rule} rule", seconds)
        w = learned.weights[:, 0]
        one = axes[2 * k + 1]
        one.plot(learned.times, w[:, 0, 1], color=BLUE, lw=1.5, label="T12")
        one.plot(learned.times, w[:, 1, 0], color=ORANGE, ls="--", lw=1.5, label="T21")
        one.axhline(0.6 / 0.7, color=GREEN, ls=":", label="solution, .857")
        one.set(title=f"weights, {rule} rule", xlabel="time (s)", ylabel="weight")
        one.legend(frameon=False)
    caption = "Two neurons, two sources: the cooperative rule finds them, the competitive one suppresses a neuron."
    context.draw("C-two-sources", figure, "C §5.4", caption, gamma=5, mixing=TWO, seconds=seconds)
    w = both["cooperative"].weights[-1, 0]
    rms = both["competitive"].outputs[-2000:].square().mean(0).sqrt()
    before = mixed(TWO, 2.0).square().mean(0).sqrt()
    left = (rms / before).tolist()
    numbers: dict[str, Any] = {
        "T cooperative": w,
        "T competitive": both["competitive"].weights[-1, 0],
        "rms o/i competitive": left,
    }
    parts = {
        "cooperative: both weights .86 within .10": bool(((w[[0, 1], [1, 0]] - 0.86).abs() <= 0.10).all()),
        "competitive: o2 under 20 % of its input": left[1] < 0.2,
    }
    ours = f".{100 * float(w[0, 1]):.0f} / .{100 * float(w[1, 0]):.0f}; competitive leaves {100 * left[1]:.0f} % of o2"
    why = f"Competitive: o1 keeps {100 * left[0]:.0f} %, T = {numbers['T competitive'].tolist()[0][1]:.2f}, "
    why += f"{numbers['T competitive'].tolist()[1][0]:.2f}; weights ripple with the inputs."
    return judged(context, ours, why, parts, numbers)


def solutions_of_mixtures(context: Context, largest: int, mixtures: int, seed: int) -> Outcome:
    """Every solution of random mixtures: does it separate, is it counted right, is stability predicted right?"""
    generator = torch.Generator().manual_seed(seed)
    sizes = [(n, m) for n in range(2, largest + 1) for m in range(1, n + 1)]
    rows: list[dict[str, Any]] = []
    for n, m in sizes:
        row: dict[str, Any] = {"neurons": n, "sources": m, "solutions": math.perm(n, m), "paper": count_solutions(n, m)}
        found = stable = separate = 0
        matrices: list[Tensor] = []
        for _ in range(mixtures):
            mixing = torch.rand(n, m, generator=generator, dtype=torch.float64) * 0.9 + 0.1
            all_of_it = solutions(mixing)
            found += len(all_of_it)
            stable += sum(s.stable for s in all_of_it)
            separate += sum(is_separated(separated(mixing, s.weights)) for s in all_of_it)
            matrices += [s.weights for s in all_of_it]
        weights = torch.stack(matrices)
        radius = torch.stack([spectral_radius(w) for w in matrices])
        clear = (radius - 1).abs() > 0.02  # nearer ones take longer to show what they do
        tried = int(clear.sum())
        agree = int((stays_bounded_all(weights[clear]) == (radius[clear] < 1)).sum())
        row |= {"found": found / mixtures, "stable": stable / mixtures}
        row |= {"all separate": separate == found, "stability right": agree, "of": tried}
        rows.append(row)
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
    axes[1].pcolormesh(grid.numpy(), grid.numpy(), bounded.numpy(), cmap="Blues", vmin=0, vmax=2, shading="nearest")
    curve = torch.linspace(0.67, 1.5, 100)
    axes[1].plot(curve, 1 / curve, color=ORANGE, lw=2.5, label="T12 T21 = 1")
    axes[1].set(title="blue: outputs stay bounded", xlabel="T12", ylabel="T21", xlim=(0, 1.5), ylim=(0, 1.5))
    axes[1].legend(frameon=False)
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
