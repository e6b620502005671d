"""C4 to C7, C10, C11: two neurons that learn from mixed sinusoids [C §5.4]; solutions of a mixture, and stable ones, of
the network and of the learning rule [C §5.3]."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ndtorch.binding import InhibitoryNetwork, learning_rule, separated, solutions, spectral_radius
from ndtorch.binding.theory import count_solutions, largest_free_weight, mean_update, skewness
from ndtorch_train.plots import BLACK, BLUE, GREEN, ORANGE, panels
from ndtorch_train.reproduce.experiment import Context, Outcome

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
    """Inputs and outputs `[T, 2]` of the first trial; weights `[samples, B, 2, 2]` and their times."""

    inputs: Tensor
    outputs: Tensor
    times: Tensor
    weights: Tensor

    @property
    def radius(self) -> Tensor:
        """Spectral radius of the weights, `[samples, B]`."""
        return (self.weights[..., 0, 1] * self.weights[..., 1, 0]).sqrt()


def learn(rule: str, mixing: Any, seconds: float, onset: float = 2.0, start: Tensor | None = None) -> Learned:
    """Learn from mixed sinusoids of 2 Hz and 1 Hz with each of the starting weights `[B, 2, 2]`. [C eq. 42-43]"""
    t = torch.arange(round(seconds / DT), dtype=torch.float64) * DT
    sources = torch.stack([torch.sin(2 * math.pi * 2 * t), torch.sin(2 * math.pi * t)], -1)
    inputs = sources @ torch.tensor(mixing, dtype=torch.float64).T
    rules = learning_rule(rule, gamma=5.0, tau_onset=onset, radius_limit=math.inf)
    network = InhibitoryNetwork(2, DT, rules, tau_in=math.inf, tau_out=2.0, settle=0.0)
    start = torch.zeros(1, 2, 2, dtype=torch.float64) if start is None else start
    outputs, weights = [], []
    with torch.inference_mode():
        state = network.start(inputs[0].expand(len(start), 2))._replace(weights=start)
        for part in torch.split(inputs, EVERY):
            out, state = network(part.expand(len(start), -1, -1), state)
            outputs.append(out[0])
            weights.append(state.weights)
    times = torch.arange(1, len(weights) + 1) * (EVERY * DT)
    return Learned(inputs, torch.cat(outputs), times, torch.stack(weights))


def outputs_panel(axes: Any, learned: Learned, title: str, until: float) -> None:
    """Both outputs over time."""
    shown = slice(0, round(until / DT), max(1, round(until / DT / 6000)))
    t = torch.arange(len(learned.outputs)) * DT
    axes.plot(t[shown], learned.outputs[shown, 0], color=BLUE, lw=0.8, label="o1")
    axes.plot(t[shown], learned.outputs[shown, 1], color=ORANGE, lw=0.8, label="o2")
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


def competitive_one(context: Context) -> Outcome:
    """One source, competitive rule."""
    learned = learn("competitive", ONE, 15.0)
    figure, axes = panels("ef", 12, 4.6)
    plane(axes[0], learned, "weights, competitive rule")
    outputs_panel(axes[1], learned, "outputs, competitive rule", 15.0)
    caption = "Two neurons, one source, competitive rule: weights against each other and outputs."
    context.draw("C7-competitive", figure, "C fig. 7e, f", caption, first="e")
    (t12, t21), (end12, end21) = (
        learned.weights[int((learned.times <= s).sum()) - 1, 0][[0, 1], [1, 0]].tolist() for s in (5.0, 15.0)
    )
    criteria = {
        "T12 .20 within .02 at 5 s": abs(t12 - 0.20) <= 0.02,
        "T21 .86 within .02 at 5 s": abs(t21 - 0.86) <= 0.02,
        "never unstable": float(learned.radius.max()) < 1,
    }
    last = float(learned.outputs[-1000:, 1].abs().max())
    why = f"[[0, {end12:.3f}], [{end21:.3f}, 0]] at 15 s; o2 falls to {last:.3f}."
    numbers = {"largest spectral radius": float(learned.radius.max())}
    return Outcome(f"[[0, {t12:.3f}], [{t21:.3f}, 0]] at 5 s", why, criteria, numbers)


def unstable_times(learned: Learned) -> list[float]:
    """When the spectral radius of the first trial rose beyond 1, each time."""
    beyond = learned.radius[:, 0] > 1
    rises = learned.times[1:][beyond[1:] & ~beyond[:-1]].tolist()
    # A crisis swings beyond 1 more than once, a second or so apart.
    return [t for last, t in zip([-math.inf, *rises], rises, strict=False) if t - last > 5.0]


def cooperative_one(context: Context, seconds: float = 90.0, trials: int = 12) -> Outcome:
    """One source, cooperative rule, with and without the soft start; and from starts that differ by 1e-12."""
    start = torch.zeros(trials, 2, 2, dtype=torch.float64)
    start[:, 0, 1] = 1e-12 * torch.arange(trials)
    soft, learned = (learn("cooperative", ONE, seconds, onset, start) for onset in (2.0, 0.0))
    figure, axes = panels("ab;cd", 13, 8)
    outputs_panel(axes[0], learned, "outputs, cooperative rule, no soft start", 60.0)
    axes[0].set_ylim(-2.5, 2.5)
    w, root = learned.weights[:, 0], learned.radius[:, 0]
    axes[1].plot(learned.times, w[:, 0, 1], color=BLUE, lw=1.5, label="T12")
    axes[1].plot(learned.times, w[:, 1, 0], color=ORANGE, lw=1.5, ls="--", label="T21")
    axes[1].set(title="weights", xlabel="time (s)", ylabel="weight", xlim=(0, 60), ylim=(0, None))
    axes[1].legend(frameon=False)
    axes[2].plot(learned.times, torch.stack([root, -root], -1), color=BLUE, lw=1.5)
    axes[2].hlines([-1, 1], 0, 60, color="0.5", ls=":")
    axes[2].set(title="eigenvalues of T (dotted: 1)", xlabel="time (s)", ylabel="eigenvalue", xlim=(0, 60))
    plane(axes[3], learned, f"weights over {seconds:g} s, cooperative rule")
    caption = "Two neurons, one source, cooperative rule. Green: theoretical limits on the two weights."
    context.draw("C7-cooperative", figure, "C fig. 7a-d", caption)

    def ends(found: Learned) -> dict[str, int]:
        last = found.weights[-1]
        first = (last[:, 1, 0] - LIMITS[1]).abs() < 0.03
        second = (last[:, 0, 1] - LIMITS[0]).abs() < 0.03
        return {
            "T21 = .86": int(first.sum()),
            "T12 = 1.17": int(second.sum()),
            "neither": int((~first & ~second).sum()),
        }

    def near(found: list[float]) -> bool:
        return len(found) == 3 and all(abs(t - p) <= 0.1 * p for t, p in zip(found, (9.0, 25.0, 45.0), strict=True))

    times, softly, counts = unstable_times(learned), unstable_times(soft), ends(learned)
    criteria = {
        "unstable at about 9, 25, 45 s (within 10 %) without soft start": near(times),
        "and with the soft start of eq. 4": near(softly),
        "ends at T21 = .86 whatever the rounding": counts["T21 = .86"] == trials,
    }
    words, soft_words = (", ".join(f"{t:.1f}" for t in several) for several in (times, softly))
    ours = f"unstable at {words} s; T21 = .86 in {counts['T21 = .86']} of {trials}"
    why = f"Starts that differ by 1e-12 part at the third instability: {counts}. With the soft start: unstable at "
    why += f"{soft_words} s only, {ends(soft)}."
    return Outcome(ours, why, criteria, {"T at the end": learned.weights[-1], "with soft start": soft.weights[-1]})


def two_sources(context: Context, seconds: float = 30.0) -> Outcome:
    """Two sources, both rules."""
    cooperative, competitive = (learn(rule, TWO, seconds) for rule in ("cooperative", "competitive"))
    t12, t21 = cooperative.weights[-1, 0][[0, 1], [1, 0]].tolist()
    rms = [part.square().mean(0).sqrt() for part in (competitive.outputs[-2000:], competitive.inputs[:2000])]
    left1, left2 = (100 * rms[0] / rms[1]).tolist()
    criteria = {
        "cooperative: both weights .86 within .10": max(abs(t12 - 0.86), abs(t21 - 0.86)) <= 0.10,
        "competitive: o2 under 20 % of its input": left2 < 20,
    }
    c12, c21 = competitive.weights[-1, 0][[0, 1], [1, 0]].tolist()
    why = f"Competitive: o1 keeps {left1:.0f} %, T = {c12:.2f}, {c21:.2f}; weights ripple with the inputs."
    ours = f".{100 * t12:.0f} / .{100 * t21:.0f}; competitive leaves {left2:.0f} % of o2"
    return Outcome(ours, why, criteria)


def solutions_of_mixtures(context: Context, largest: int = 4, mixtures: int = 4) -> Outcome:
    """Every solution of random mixtures: does it separate, is it counted right, is stability predicted right?"""
    generator = torch.Generator().manual_seed(0)
    rows, agree, tried, separate = list[dict[str, Any]](), 0, 0, True
    for n, m in ((k, j) for k in range(2, largest + 1) for j in range(1, k + 1)):
        every = []
        for _ in range(mixtures):
            mixing = torch.rand(n, m, generator=generator, dtype=torch.float64) * 0.9 + 0.1
            every += solutions(mixing)
            separate &= all(is_separated(separated(mixing, s.weights)) for s in every[-math.perm(n, m) :])
        weights = torch.stack([s.weights for s in every])
        radius = torch.stack([spectral_radius(s.weights) for s in every])
        clear = (radius - 1).abs() > 0.02  # nearer ones take longer to show what they do
        tried += int(clear.sum())
        agree += int((stays_bounded(weights[clear]) == (radius[clear] < 1)).sum())
        counted = {"found": len(every) / mixtures, "stable": sum(s.stable for s in every) / mixtures}
        rows.append(
            {"neurons": n, "sources": m, "paper": count_solutions(n, m), "expected": math.perm(n, m), **counted}
        )
    errors = []
    for n in (2, 3, 4) * 4:  # the radius is 1 where a free weight takes its predicted limit
        weights = torch.rand(n, n, generator=generator, dtype=torch.float64) * (0.8 / n)
        weights.fill_diagonal_(0)
        weights[0, 1] = largest_free_weight(weights, 0, 1)
        errors.append(abs(float(spectral_radius(weights)) - 1))
    criteria = {
        "every solution separates its mixture": separate,
        "N!/(N-m)! solutions of a mixture": all(row["found"] == row["expected"] for row in rows),
        "stability as predicted": agree == tried,
        "limits on free weights as predicted (1 %)": max(errors) < 0.01,
    }
    ours = f"all {sum(r['found'] for r in rows) * mixtures:.0f} solve; stability right {agree} of {tried}"
    why = "N!/(N-m)! for one mixture; the square counts also which sources are present. Eq. 34 bounds T21, not T12."
    return Outcome(ours, why, criteria, {"rows": rows, "limits, largest relative error": max(errors)})


def rule_stability(context: Context, samples: int = 400_000, trials: int = 20) -> Outcome:
    """Mean update of solved weights, where outputs are independent sources of zero mean, with and without skewness."""
    generator, rule = torch.Generator().manual_seed(0), learning_rule("competitive")

    def uniform() -> Tensor:
        return 1.2 * torch.rand(samples, generator=generator, dtype=torch.float64) - 0.6

    def skewed() -> Tensor:
        return -0.35 * (1 + torch.rand(samples, generator=generator, dtype=torch.float64).log())

    kinds = {"neither": (uniform, uniform), "one": (uniform, skewed), "both": (skewed, skewed)}
    ratios, products, means, skews = dict[str, float](), 0.0, 0.0, []
    for name, makers in kinds.items():
        found = []
        for _ in range(trials):
            x = torch.stack([make() for make in makers], -1)
            a, b = rule.row(x), rule.column(x)  # type: ignore[attr-defined]
            mean, size = mean_update(rule, x), a.abs().mean(0)[:, None] * b.abs().mean(0)
            found.append(torch.stack([mean[0, 1] / size[0, 1], mean[1, 0] / size[1, 0]]))
            if name == "both":
                products += float(a[:, 0].mean() * b[:, 1].mean())
                means += float(mean[0, 1])
                skews.append(skewness(x).tolist())
        ratios[name] = float(torch.stack(found).mean(0).abs().max())
    figure, (one,) = panels("a", 5, 3.4)
    one.bar(list(ratios), [100 * ratio for ratio in ratios.values()], color=BLUE)
    one.set(xlabel="sources with skewness", ylabel="mean over size of updates (%)")
    context.draw("C-skewness", figure, "C §5.3.4", "Mean update of weights that solve the mixture.")
    criteria = {
        "zero mean (1 % of its size) without skewness": ratios["neither"] < 0.01,
        "and with that of one source": ratios["one"] < 0.01,
        "not zero with that of both": ratios["both"] > 0.1,
        "the mean is the product of E[g] and E[f] (5 %)": abs(products / means - 1) < 0.05,
    }
    ours = "mean over size of updates: " + ", ".join(f"{name} skewed {100 * r:.1f} %" for name, r in ratios.items())
    why = f"Independent sources, uniform or exponential (skewness {sum(s[0] for s in skews) / trials:.1f})."
    return Outcome(ours, why, criteria, {"product over mean": products / means})


def weight_against_ratio(context: Context, seconds: float = 15.0) -> Outcome:
    """One source, competitive rule: both weights against the ratio of the two mixing weights."""
    mixed = (0.65, 0.7, 0.8, 0.9, 1.0)
    ends = torch.stack([learn("competitive", ((0.0, a), (0.0, 0.6)), seconds).weights[-1, 0] for a in mixed])
    ratio, t12, t21 = torch.tensor(mixed) / 0.6, ends[:, 0, 1], ends[:, 1, 0]
    figure, (one,) = panels("a", 6, 3.6)
    one.plot(ratio, t12, ".-", color=BLUE, ms=10, label="T12")
    one.plot(ratio, t21, ".-", color=ORANGE, ms=10, label="T21")
    one.plot(ratio, 1 / ratio, color=BLACK, ls=":", label="1 / ratio")
    one.set(xlabel="ratio of the mixing weights", ylabel="weight", ylim=(0, None))
    one.legend(frameon=False)
    context.draw("C-ratio", figure, "C §5.4", "One source, competitive rule: weights after learning.")
    criteria = {
        "T12 falls": bool((t12.diff() < 0).all()),
        "T21 = 1 / ratio within 2 %": bool((t21 * ratio - 1).abs().max() < 0.02),
    }
    ours = f"T12 {', '.join(f'{w:.3f}' for w in t12.tolist())}"
    why = (
        f"At ratios {', '.join(f'{r:.2f}' for r in ratio.tolist())}; T21 {', '.join(f'{w:.2f}' for w in t21.tolist())}."
    )
    return Outcome(ours, why, criteria)


def is_separated(gains: Tensor) -> bool:
    """One source in every column, at most one in every row."""
    there = gains.abs() > 1e-9 * gains.abs().max()
    return bool((there.sum(0) == 1).all() and (there.sum(1) <= 1).all())


def stays_bounded(weights: Tensor, steps: int = 1500) -> Tensor:
    """Whether the network with fixed weights `[B, N, N]` comes to rest after a push, `[B]`."""
    n = weights.shape[-1]
    network = InhibitoryNetwork(n, DT, None, tau_in=math.inf)
    inputs = torch.zeros(len(weights), steps, n, dtype=weights.dtype)
    inputs[:, 0] = 1.0
    with torch.inference_mode():
        out, _ = network(inputs, network.start(inputs[:, 0])._replace(weights=weights))
    early, late = out[:, 1 : n + 1].abs().amax((-1, -2)), out[:, -n:].abs().amax((-1, -2))
    bounded: Tensor = (late < early) & torch.isfinite(late)
    return bounded
